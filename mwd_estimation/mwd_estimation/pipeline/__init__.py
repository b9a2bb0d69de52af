# SPDX-License-Identifier: Apache-2.0
"""The stages that a sample goes through, in the order of the signal, and what they put out."""
