# SPDX-License-Identifier: Apache-2.0
"""A unit on a polled serial line, for the surface units of other makers."""
