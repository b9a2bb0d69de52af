# SPDX-License-Identifier: Apache-2.0
"""Words from a phase-modulated carrier: marker search, block decoder and error-correcting code."""
