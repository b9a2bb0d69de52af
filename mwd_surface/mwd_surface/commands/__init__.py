# SPDX-License-Identifier: Apache-2.0
"""The commands of `mwd`, one module each; each imports what it needs only when it runs, to keep `mwd --help` fast."""
