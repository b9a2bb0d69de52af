# SPDX-License-Identifier: Apache-2.0
"""What the doctor finds on machines that lack something."""

import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from mwd_surface.runs import doctor
from mwd_surface.runs.doctor import CheckLevel

MISSING, NOTE, OK = CheckLevel.MISSING, CheckLevel.NOTE, CheckLevel.OK
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"


NONE = "no_such_package_at_all"


@pytest.mark.fault_case(97)
@pytest.mark.parametrize(
    ("check", "level", "state", "remedy"),
    [
        (lambda: doctor.package(NONE, "every computation"), MISSING, "every computation", "."),
        (lambda: doctor.package("numpy", "every computation"), OK, "", ""),
        (lambda: doctor.foreign_ros({"ROS_DISTRO": "humble"}), MISSING, "humble", "."),
        (lambda: doctor.foreign_ros({"AMENT_PREFIX_PATH": sys.prefix}), OK, "", ""),
        (lambda: doctor.discovery({"ROS_DOMAIN_ID": "seven"}), MISSING, "", "."),
        (lambda: doctor.discovery({"ROS_DOMAIN_ID": "7", RANGE: "LOCALHOST"}), OK, "", ""),
        (lambda: doctor.discovery({}), OK, "", ""),
        (lambda: doctor.discovery({RANGE: "SUBNET"}), NOTE, "", "."),
        (lambda: doctor.disk(Path("/proc/nowhere")), MISSING, "", "."),
        (
            lambda: doctor.interface("OPC UA", NONE, "some-distribution"),
            *(NOTE, "not available", f"^{sys.prefix}.*pip install some-distribution$"),
        ),
        (lambda: doctor.interface("numbers", "numpy", "numpy"), OK, "", ""),
        (lambda: doctor.tool("no-such-program", "building"), NOTE, "", "apt install no-such-program"),
    ],
)
def test_what_a_machine_lacks_is_named_with_its_remedy(check, level, state, remedy):
    found = check()
    assert found.level == level
    assert state in found.state
    assert re.search(remedy, found.remedy)


def test_a_folder_need_not_exist_yet(tmp_path):
    assert doctor.disk(tmp_path / "a" / "b").level in (OK, NOTE)
    assert not (tmp_path / "a").exists()


def test_a_port_in_use_is_noted():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        assert doctor.page_port(taken.getsockname()[1]).level == NOTE
        assert doctor.rig_port("WITS", taken.getsockname()[1]).level == NOTE


def test_every_interface_to_the_rig_is_looked_at_and_what_asks_for_something_says_what():
    found = {finding.name: finding for finding in doctor.examine({}, Path())}
    assert {"OPC UA", "Modbus", "WITS over a serial line", "WITS port", "OPC UA port", "Modbus port"} <= found.keys()
    assert all(one.remedy for one in found.values() if one.level != OK)


def test_a_missing_numba_is_named():
    hidden = "import importlib.util, sys\nfind = importlib.util.find_spec\nsys.modules['numba'] = None\n"
    hidden += "importlib.util.find_spec = lambda name, *rest: None if name == 'numba' else find(name, *rest)\n"
    hidden += "from mwd_surface.cli import main\nsys.argv = ['mwd', 'doctor']\nmain()"
    done = subprocess.run([sys.executable, "-c", hidden], check=False, capture_output=True, text=True, timeout=120.0)
    assert (done.returncode, done.stderr) == (1, "")
    assert any("numba" in line and "missing" in line for line in done.stdout.splitlines())
