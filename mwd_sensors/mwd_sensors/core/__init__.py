# SPDX-License-Identifier: Apache-2.0
"""Units, frames, Earth models, message layouts, compiled kernels and settings, used by every package."""
