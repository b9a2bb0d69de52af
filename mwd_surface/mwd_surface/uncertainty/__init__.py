# SPDX-License-Identifier: Apache-2.0
"""How well a position is known: ISCWSA error terms, position covariance, survey programme, forecast along a plan."""
