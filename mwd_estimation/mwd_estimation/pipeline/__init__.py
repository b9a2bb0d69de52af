# SPDX-License-Identifier: Apache-2.0
"""The processing stages of the estimator, in the order of the signal, and their output."""
