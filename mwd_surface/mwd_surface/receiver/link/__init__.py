# SPDX-License-Identifier: Apache-2.0
"""A whole link: selection of the receiver, surveys, attitude, and when the tool sends."""
