# SPDX-License-Identifier: Apache-2.0
"""The commands of `mwd`, one module each; they import what they need when they run, so that `mwd --help` is quick."""
