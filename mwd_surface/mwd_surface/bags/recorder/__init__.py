# SPDX-License-Identifier: Apache-2.0
"""The crash-proof recorder."""
