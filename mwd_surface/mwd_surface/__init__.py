# SPDX-License-Identifier: Apache-2.0
"""The surface: recording, survey list and well path, live page, rig protocols, reports, the mwd command."""


def __getattr__(name: str) -> str:
    """Read the installed version only when it is used, because importing `importlib.metadata` takes 16 ms."""
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version(__name__)
        except PackageNotFoundError:
            return "0+source"  # the sources alone, as `make setup` uses them before it links the packages
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
