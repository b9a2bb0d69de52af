# SPDX-License-Identifier: Apache-2.0
"""Entry point of the `mwd` command, which names a missing package. No other module is imported at the top."""

from __future__ import annotations

import sys

# Import name and installation name of the packages where the two differ.
_PACKAGES = {"yaml": "PyYAML", "fpdf": "fpdf2", "serial": "pyserial", "PIL": "pillow", "dateutil": "python-dateutil"}


def main() -> None:
    """Run `cli.main` and end the process; exit with status 2 if a package is missing or cannot be loaded."""
    try:
        from mwd_surface import cli

        cli.main()
    except ImportError as error:
        sys.stderr.write(f"mwd: {_remedy(error)}\n")
        sys.exit(2)


def _remedy(error: ImportError) -> str:
    """Return a sentence with the package that is missing and the command that installs it."""
    module = (error.name or "").partition(".")[0]
    if not module:
        return str(error)
    if module.startswith("mwd_"):
        install, package = "pip install ./mwd_sensors ./mwd_estimation ./mwd_surface", module
    else:
        package = _PACKAGES.get(module, module)
        install = f"pip install {package}"
    if isinstance(error, ModuleNotFoundError):
        return f"the package {package} is not installed for {sys.executable}: {install}"
    return f"the package {package} cannot be loaded ({error}): {install} --force-reinstall"


if __name__ == "__main__":
    main()
