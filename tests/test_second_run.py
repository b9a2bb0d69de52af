# SPDX-License-Identifier: Apache-2.0
"""A test that waits for real nodes and fails is run a second time, with a graph of its own."""

import subprocess
import sys

from project import ROOT

MODULE = """
import pytest

STARTS = []

@pytest.fixture(scope="module")
def graph():
    STARTS.append(len(STARTS))
    yield STARTS[-1]
    print("ended", len(STARTS))

@pytest.mark.ros
def test_first(graph):
    assert graph == 0

@pytest.mark.ros
def test_what_the_first_graph_did_not_show(graph):
    assert graph == 1

@pytest.mark.ros
def test_what_follows_takes_the_graph_that_runs(graph):
    assert graph == 1

def test_what_computes_has_one_run(graph):
    assert graph == 2
"""


def test_a_second_run_has_a_new_graph_and_what_computes_has_none(tmp_path):
    (tmp_path / "test_module.py").write_text(MODULE)
    (tmp_path / "conftest.py").write_text((ROOT / "conftest.py").read_text())
    words = [sys.executable, "-m", "pytest", "-c", ROOT / "pyproject.toml", "-p", "no:xdist", "-s", tmp_path]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert "1 failed, 3 passed, 1 rerun" in done.stdout, done.stdout + done.stderr
    (failed,) = (line for line in done.stdout.splitlines() if line.startswith("FAILED "))
    assert "::test_what_computes_has_one_run" in failed
    assert "ended 1" in done.stdout
    assert "ended 2" in done.stdout
    assert "ended 3" not in done.stdout
