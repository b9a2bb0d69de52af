# SPDX-License-Identifier: Apache-2.0
"""Modules that all parts of the estimator use: samples, time bins, time jumps, status, error model, reference field."""
