# SPDX-License-Identifier: Apache-2.0
"""Processing of a recording to attitude and surveys: inspection, estimation, output files, comparison of two runs."""
