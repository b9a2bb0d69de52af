# SPDX-License-Identifier: Apache-2.0
"""
Survey stations drawn from physics and the OWSG tool code, to judge the survey decision by.

Nothing here reads the estimator's error model: `tool_code` and `truth` say what a tool, a hole and the Earth's field
do, `disturbances` what else there is, `judge` hands readings to the survey decision and counts what comes back.
"""
