# SPDX-License-Identifier: Apache-2.0
"""`mwd version`: versions of this project and its dependencies."""

from __future__ import annotations

import os

from mwd_surface import __version__
from mwd_surface.commands import terminal


def version() -> None:
    """
    Print the versions of mwd, Python, ROS and packages for a bug report.

    \b
    Example:
      mwd version
    """
    terminal.tell(*version_lines())


def version_lines() -> list[str]:
    """Return lines with the versions of mwd, Python, ROS and the main packages."""
    import importlib.metadata
    import platform

    lines = [
        f"mwd {__version__}",
        f"Python {platform.python_version()} on {platform.platform()}",
        f"ROS {_distribution()}",
    ]
    for name in ("ros-jazzy-rclpy", "numpy", "numba", "mcap", "rosbags"):
        try:
            lines.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            lines.append(f"{name} not found as a Python package")
    return lines


def _distribution() -> str:
    """Return the name of the ROS distribution, "jazzy (wheels)" without an installation, or "is not installed"."""
    import importlib.util

    if importlib.util.find_spec("rclpy") is None:
        return "is not installed"
    return os.environ.get("ROS_DISTRO", "jazzy (wheels)")
