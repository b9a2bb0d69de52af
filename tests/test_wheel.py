# SPDX-License-Identifier: Apache-2.0
"""The packages as wheels on a Python without ROS: recordings, tables and reports work; the rest says why not."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("mwd_sensors", "mwd_estimation", "mwd_surface")
GOLDEN = ROOT / "bags" / "golden" / "stations"
ROS = (
    "rclpy launch launch_ros ament_index_python mwd_msgs builtin_interfaces std_msgs std_srvs sensor_msgs nav_msgs "
    "geometry_msgs diagnostic_msgs rcl_interfaces lifecycle_msgs tf2_msgs rosgraph_msgs"
)
# A module that is None in sys.modules cannot be imported, as one that is not installed.
WITHOUT_ROS = f"import sys; sys.modules.update(dict.fromkeys({ROS!r}.split())); "
MWD = WITHOUT_ROS + "from mwd_surface.cli import main; sys.argv[0] = 'mwd'; sys.exit(main())"

pytestmark = pytest.mark.slow(3)


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Folder with the three wheels installed and nothing else."""
    folder = tmp_path_factory.mktemp("wheels")
    for package in PACKAGES:
        # A build writes beside its sources, so it gets its own.
        left_out = shutil.ignore_patterns("__pycache__", "build", "*.egg-info", "test")
        shutil.copytree(ROOT / package, folder / "source" / package, ignore=left_out)
    pip = (sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check")
    sources = [folder / "source" / package for package in PACKAGES]
    subprocess.run([*pip, "wheel", "--no-deps", "--no-build-isolation", "-w", folder / "dist", *sources], check=True)
    wheels = sorted((folder / "dist").glob("*.whl"))
    assert len(wheels) == len(PACKAGES)
    site = folder / "site"
    subprocess.run([*pip, "install", "--no-deps", "--no-compile", "--target", site, *wheels], check=True)
    for package in PACKAGES:
        _share_machine_code(ROOT / package, site, package)
    return site


def _share_machine_code(sources, site, package):
    """Give installed modules the machine code of their sources, so that none is compiled that is compiled already."""
    for module in (sources / package).rglob("*.py"):
        # The cache knows a module by its size and time.
        times = module.stat()
        os.utime(site / module.relative_to(sources), ns=(times.st_atime_ns, times.st_mtime_ns))
    for code in (sources / package).rglob("__pycache__/*.nb[ci]"):
        target = site / code.relative_to(sources)
        # A module that is gone may have left its own.
        if target.parent.parent.is_dir():
            target.parent.mkdir(exist_ok=True)
            shutil.copyfile(code, target)


def python(installed, folder, program, *words):
    """What a program prints and its exit status, in a folder that is not the source tree."""
    environment = {**os.environ, "PYTHONPATH": str(installed), "COLUMNS": "120"}
    environment.pop("AMENT_PREFIX_PATH", None)
    command = [sys.executable, "-c", program, *map(str, words)]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert "Traceback" not in done.stderr, done.stderr
    return done.stdout + done.stderr, done.returncode


def test_every_kernel_is_there_without_ros(installed, tmp_path):
    program = WITHOUT_ROS + (
        "import mwd_sensors, mwd_estimation.pipeline.pipeline, mwd_estimation.survey.survey; "
        "import mwd_surface.page.page_server; print(mwd_estimation.__file__)"
    )
    said, status = python(installed, tmp_path, program)
    assert status == 0, said
    assert said.startswith(str(installed))


def test_a_recording_is_processed_and_reported_without_ros(installed, tmp_path):
    said, status = python(installed, tmp_path, MWD, "process", GOLDEN / "bag", "-o", "rows")
    assert status == 0, said
    assert "2 surveys" in said, said
    said, status = python(installed, tmp_path, MWD, "report", "rows", "-o", "rows")
    assert status == 0, said
    assert any((tmp_path / "rows").glob("*.pdf"))


def test_a_six_axis_table_is_judged_without_ros(installed, tmp_path):
    table = ROOT / "bags" / "reference_data" / "volve" / "volve_F5_raw_sixaxis.csv"
    said, status = python(installed, tmp_path, MWD, "survey", table, "-o", "surveys.csv")
    assert status == 0, said
    stations = len(table.read_text(encoding="utf-8").splitlines()) - 1
    assert len((tmp_path / "surveys.csv").read_text(encoding="utf-8").splitlines()) == stations + 1


@pytest.mark.parametrize("words", [("run", "--no-record"), ("replay", GOLDEN / "bag")])
def test_what_needs_ros_says_so_in_one_sentence(installed, tmp_path, words):
    said, status = python(installed, tmp_path, MWD, *words)
    assert status != 0
    assert "is not installed for this Python: `mwd doctor` shows how to install it" in said
    assert len(said.strip().splitlines()) == 1


def test_the_example_of_the_documents_runs_as_it_is_printed(installed, tmp_path):
    text = (ROOT / "docs" / "guide" / "python.md").read_text(encoding="utf-8")
    example, printed = re.search(r"```python\n(.*?)```\n+```\n(.*?)```", text, re.DOTALL).groups()
    assert len([line for line in example.splitlines() if line]) == 10
    said, status = python(installed, tmp_path, WITHOUT_ROS + "exec(sys.argv[1])", example)
    assert status == 0, said
    assert said == printed
