# SPDX-License-Identifier: Apache-2.0
"""What every estimator room builds on: samples, time bins, time jumps, status, error model, reference field."""
