# SPDX-License-Identifier: Apache-2.0
"""Commands of `mwd`, a module each; modules are imported only when a command runs, to keep `mwd --help` fast."""
