# SPDX-License-Identifier: Apache-2.0
"""A network that is cut for longer than the middleware waits costs no survey and doubles none."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parent / "network_cut.py"
CUT_S = 25.0  # more than a participant of the middleware may be silent before the others forget it, 20 s


@pytest.mark.ros
@pytest.mark.slow(27)
@pytest.mark.fault_case(54)
def test_a_cut_network_costs_no_survey_and_doubles_none(tmp_path):
    done = subprocess.run(
        [sys.executable, str(SCRIPT), str(tmp_path), str(CUT_S)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        timeout=500,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    seen = json.loads(done.stdout.splitlines()[-1])
    assert seen["alive"]
    assert (seen["statuses"], seen["traceback"]) == ([0, 0, 0], False)
    # The surface was on its own, and its list stayed; the estimator went on taking surveys.
    assert seen["lonely"] == seen["before"]
    assert seen["during"]
    assert len(seen["after"]) == len(set(seen["after"])) == len(set(seen["taken"]))
    assert set(seen["after"]) == set(seen["taken"])
