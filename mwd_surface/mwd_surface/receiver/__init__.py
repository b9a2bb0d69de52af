# SPDX-License-Identifier: Apache-2.0
"""The receiver: standpipe pressure to words with confidence and sigma. Pure; nodes and commands feed it."""
