# SPDX-License-Identifier: Apache-2.0
"""Air interface between tool and surface (words, sequences, pulse codes, serial frames), imported by both ends."""
