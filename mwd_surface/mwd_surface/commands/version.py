"""`mwd version`: versions of this project and of what it stands on."""

from __future__ import annotations


def version() -> None:
    """
    Versions of mwd, Python, ROS and the packages that matter for a bug report.

    \b
    Example:
      mwd version
    """
    import importlib.metadata
    import os
    import platform

    from mwd_surface.commands import terminal

    console = terminal.output()
    console.print(f"mwd {importlib.metadata.version('mwd-surface')}", markup=False)
    console.print(f"Python {platform.python_version()} on {platform.platform()}", markup=False)
    console.print(f"ROS {os.environ.get('ROS_DISTRO', 'jazzy (wheels)')}", markup=False)
    for name in ("ros-jazzy-rclpy", "numpy", "numba", "mcap", "rosbags"):
        try:
            console.print(f"{name} {importlib.metadata.version(name)}", markup=False)
        except importlib.metadata.PackageNotFoundError:
            console.print(f"{name} not found as a Python package", markup=False)
