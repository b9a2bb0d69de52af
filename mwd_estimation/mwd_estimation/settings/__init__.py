# SPDX-License-Identifier: Apache-2.0
"""Settings of the user (tool, place, surveys, verdict), and the parameters of each filter derived from the settings."""
