# SPDX-License-Identifier: Apache-2.0
"""The surface: recording, survey list and well path, live page, rig protocols, reports, the mwd command."""

__version__ = "0.1.0"
