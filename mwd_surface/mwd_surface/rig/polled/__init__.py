# SPDX-License-Identifier: Apache-2.0
"""Unit on a polled serial line that the surface unit of another maker asks for values."""
