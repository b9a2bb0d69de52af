# SPDX-License-Identifier: Apache-2.0
"""One telemetry link: its receiver, received surveys and attitude, and the times at which the tool sends."""
