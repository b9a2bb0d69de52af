# SPDX-License-Identifier: Apache-2.0
"""Shared by all rooms of the estimator: samples, time bins, time jumps, status, error model, reference field."""
