# SPDX-License-Identifier: Apache-2.0
"""The linters of a ROS package: line length and exceptions stand in setup.cfg."""

from pathlib import Path

import pytest
from ament_flake8.main import main_with_errors
from ament_pep257.main import main as pep257

pytestmark = pytest.mark.slow

PACKAGE = Path(__file__).resolve().parents[1]
PATHS = [str(PACKAGE / name) for name in (PACKAGE.name, "launch", "setup.py")]


def test_flake8(capsys):
    found, errors = main_with_errors(argv=["--config", str(PACKAGE / "setup.cfg"), *PATHS])
    assert found == 0, "\n".join(errors)


def test_pep257(capsys):
    ignored = ("--convention", "numpy", "--add-ignore", "D105", "D301", "D401", "D403", "--")
    assert pep257(argv=[*ignored, PATHS[0]]) == 0, capsys.readouterr().out
