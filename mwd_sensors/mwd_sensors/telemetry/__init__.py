# SPDX-License-Identifier: Apache-2.0
"""The air interface between tool and surface: words, sequences, pulse codes, serial frames. Both ends import it."""
