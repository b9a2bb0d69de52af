# SPDX-License-Identifier: Apache-2.0
"""The stages that a sample passes, in the order of the signal, and their output."""
