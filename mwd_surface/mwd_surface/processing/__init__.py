# SPDX-License-Identifier: Apache-2.0
"""A recording to attitude and surveys: what it holds, the estimator over it, what is written, two runs compared."""
