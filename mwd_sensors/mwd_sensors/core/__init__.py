# SPDX-License-Identifier: Apache-2.0
"""What every package builds on: units, frames, Earth models, the wire, compiled kernels, settings."""
