# SPDX-License-Identifier: Apache-2.0
"""What the doctor finds on machines that lack something."""

import socket
import subprocess
import sys
from pathlib import Path

import pytest

from mwd_surface.runs import doctor
from mwd_surface.runs.doctor import CheckLevel


@pytest.mark.fault_case(97)
def test_a_missing_package_is_named_with_its_purpose_and_remedy():
    found = doctor.package("no_such_package_at_all", "every computation")
    assert found.level == CheckLevel.MISSING
    assert "every computation" in found.state
    assert found.remedy
    assert doctor.package("numpy", "every computation").level == CheckLevel.OK


def test_another_ros_is_refused():
    found = doctor.foreign_ros({"ROS_DISTRO": "humble"})
    assert found.level == CheckLevel.MISSING
    assert "humble" in found.state
    assert doctor.foreign_ros({"AMENT_PREFIX_PATH": sys.prefix}).level == CheckLevel.OK


def test_a_domain_that_is_no_number_is_named():
    assert doctor.discovery({"ROS_DOMAIN_ID": "seven"}).level == CheckLevel.MISSING
    assert doctor.discovery({"ROS_DOMAIN_ID": "7", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}).level == CheckLevel.OK
    assert doctor.discovery({}).level == CheckLevel.OK
    assert doctor.discovery({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}).level == CheckLevel.NOTE


def test_a_folder_that_cannot_be_written_is_missing():
    assert doctor.disk(Path("/proc/nowhere")).level == CheckLevel.MISSING


def test_a_folder_need_not_exist_yet(tmp_path):
    assert doctor.disk(tmp_path / "a" / "b").level in (CheckLevel.OK, CheckLevel.NOTE)
    assert not (tmp_path / "a").exists()


def test_a_port_in_use_is_noted():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        assert doctor.page_port(taken.getsockname()[1]).level == CheckLevel.NOTE
        assert doctor.rig_port("WITS", taken.getsockname()[1]).level == CheckLevel.NOTE


def test_an_interface_that_lacks_its_package_is_off_with_the_command_that_installs_it():
    found = doctor.interface("OPC UA", "no_such_package_at_all", "some-distribution")
    assert found.level == CheckLevel.NOTE
    assert "not available" in found.state
    assert found.remedy.startswith(sys.prefix)
    assert found.remedy.endswith("pip install some-distribution")
    assert doctor.interface("numbers", "numpy", "numpy").level == CheckLevel.OK


def test_every_interface_to_the_rig_is_looked_at():
    looked_at = {finding.name for finding in doctor.examine({}, Path())}
    assert {"OPC UA", "Modbus", "WITS over a serial line", "WITS port", "OPC UA port", "Modbus port"} <= looked_at


def test_a_program_that_is_not_there_is_noted_with_its_package():
    found = doctor.tool("no-such-program", "building")
    assert found.level == CheckLevel.NOTE
    assert "apt install no-such-program" in found.remedy


def test_every_finding_that_asks_for_something_says_what():
    assert all(finding.remedy for finding in doctor.examine({}, Path()) if finding.level != CheckLevel.OK)


def test_a_missing_numba_is_named():
    hidden = "import importlib.util, sys\nfind = importlib.util.find_spec\nsys.modules['numba'] = None\n"
    hidden += "importlib.util.find_spec = lambda name, *rest: None if name == 'numba' else find(name, *rest)\n"
    hidden += "from mwd_surface.cli import main\nsys.argv = ['mwd', 'doctor']\nmain()"
    done = subprocess.run([sys.executable, "-c", hidden], check=False, capture_output=True, text=True, timeout=120.0)
    assert (done.returncode, done.stderr) == (1, "")
    assert any("numba" in line and "missing" in line for line in done.stdout.splitlines())
