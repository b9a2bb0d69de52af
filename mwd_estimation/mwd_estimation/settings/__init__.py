# SPDX-License-Identifier: Apache-2.0
"""Settings by the user (tool, place, surveys, verdict), and the parameters of each filter derived from them."""
