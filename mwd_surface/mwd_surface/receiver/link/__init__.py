# SPDX-License-Identifier: Apache-2.0
"""A whole link: which receiver hears, its surveys and attitude, and when the tool sends."""
