# SPDX-License-Identifier: Apache-2.0
"""Distance to other wells by the separation rule of the ISCWSA (anti-collision)."""
