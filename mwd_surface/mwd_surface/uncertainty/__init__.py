# SPDX-License-Identifier: Apache-2.0
"""Position uncertainty: ISCWSA error terms, position covariance, survey programme, forecast along a plan."""
