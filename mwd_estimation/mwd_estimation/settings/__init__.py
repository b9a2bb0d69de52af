# SPDX-License-Identifier: Apache-2.0
"""Settings of users (tool, place, surveys, verdict), and the parameters of each filter derived from them."""
