# SPDX-License-Identifier: Apache-2.0
"""The Python packages, built and installed into an empty environment without ROS."""

import os
import re
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("mwd_sensors", "mwd_estimation", "mwd_surface")
GOLDEN = ROOT / "bags" / "golden" / "stations"

pytestmark = pytest.mark.slow(3)


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Environment that has the wheels, made from source distributions, and what they require; nothing else."""
    folder = tmp_path_factory.mktemp("wheels")
    for package in PACKAGES:
        # A build writes beside its sources, so it gets its own.
        left_out = shutil.ignore_patterns("__pycache__", "build", "*.egg-info", "test")
        source = folder / "source" / package
        shutil.copytree(ROOT / package, source, ignore=left_out)
        sdist = (sys.executable, "setup.py", "--quiet", "sdist", "--dist-dir", folder / "sdist")
        subprocess.run(sdist, cwd=source, check=True, capture_output=True)
    quiet = ("--quiet", "--disable-pip-version-check")
    pip = (sys.executable, "-m", "pip", *quiet)
    sources = sorted((folder / "sdist").glob("*.tar.gz"))
    subprocess.run([*pip, "wheel", "--no-deps", "--no-build-isolation", "-w", folder / "wheels", *sources], check=True)
    wheels = sorted((folder / "wheels").glob("*.whl"))
    assert len(wheels) == len(PACKAGES)
    environment = folder / "environment"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", environment], check=True)
    pip = (*pip, "--python", environment / "bin" / "python")
    subprocess.run([*pip, "install", "--no-index", "--no-deps", "--no-compile", *wheels], check=True)
    link_requirements(environment)
    subprocess.run([*pip, "check"], check=True)
    share_machine_code(environment)
    return environment


def link_requirements(environment):
    """Link to the tests' own packages those that the wheels require, and those that these require; no others."""
    (packages,) = environment.glob("lib/python*/site-packages")
    waiting = list(metadata.distributions(path=[str(packages)]))
    found = {canonicalize_name(package) for package in PACKAGES}
    assert {canonicalize_name(one.name) for one in waiting} == found
    while waiting:
        for requirement in map(Requirement, waiting.pop().requires or ()):
            name = canonicalize_name(requirement.name)
            if name not in found and (requirement.marker is None or requirement.marker.evaluate({"extra": ""})):
                found.add(name)
                waiting.append(metadata.distribution(name))
                for top in {path.parts[0] for path in waiting[-1].files} - {"..", "__pycache__"}:
                    (packages / top).symlink_to(waiting[-1].locate_file(top))


def share_machine_code(environment):
    """Link the installed modules with kernels to the sources that equal them: compiling 245 kernels takes minutes."""
    for package in PACKAGES:
        (packages,) = environment.glob("lib/python*/site-packages")
        for module in (packages / package).rglob("*.py"):
            source = ROOT / package / module.relative_to(packages)
            if module.read_bytes() == source.read_bytes():
                # The machine code belongs to the times of a module and of the modules that it uses.
                os.utime(module, ns=(0, source.stat().st_mtime_ns))
                if "@compiled" in source.read_text(encoding="utf-8"):
                    module.unlink()
                    module.symlink_to(source)


def run(installed, folder, command, *words):
    """Return output and exit status of a command of the environment, run outside the source tree."""
    shadows = ("PYTHONPATH", "AMENT_PREFIX_PATH", "VIRTUAL_ENV")
    environment = {k: v for k, v in os.environ.items() if k not in shadows} | {"COLUMNS": "120"}
    done = subprocess.run(
        [installed / "bin" / command, *map(str, words)],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "Traceback" not in done.stderr, done.stderr
    return done.stdout + done.stderr, done.returncode


def test_every_kernel_is_there_without_ros(installed, tmp_path):
    program = (
        "import mwd_sensors, mwd_estimation.pipeline.pipeline, mwd_estimation.survey.survey; "
        "import mwd_surface.page.page_server; print(mwd_estimation.__file__)"
    )
    said, status = run(installed, tmp_path, "python", "-c", program)
    assert status == 0, said
    assert said.startswith(str(installed))


def test_the_version_says_that_ros_is_not_there(installed, tmp_path):
    said, status = run(installed, tmp_path, "mwd", "version")
    assert status == 0, said
    assert "ROS is not installed" in said


def test_a_recording_is_processed_and_reported_without_ros(installed, tmp_path):
    said, status = run(installed, tmp_path, "mwd", "process", GOLDEN / "bag", "-o", "rows")
    assert status == 0, said
    assert "2 surveys" in said, said
    said, status = run(installed, tmp_path, "mwd", "report", "rows", "-o", "rows")
    assert status == 0, said
    assert any((tmp_path / "rows").glob("*.pdf"))


def test_a_six_axis_table_is_judged_without_ros(installed, tmp_path):
    table = ROOT / "bags" / "reference_data" / "volve" / "volve_F5_raw_sixaxis.csv"
    said, status = run(installed, tmp_path, "mwd", "survey", table, "-o", "surveys.csv")
    assert status == 0, said
    stations = len(table.read_text(encoding="utf-8").splitlines()) - 1
    assert len((tmp_path / "surveys.csv").read_text(encoding="utf-8").splitlines()) == stations + 1


@pytest.mark.parametrize("words", [("run", "--no-record"), ("replay", GOLDEN / "bag")])
def test_what_needs_ros_says_so_in_one_sentence(installed, tmp_path, words):
    said, status = run(installed, tmp_path, "mwd", *words)
    assert status != 0
    assert "is not installed for this Python: `mwd doctor` shows how to install it" in said
    assert len(said.strip().splitlines()) == 1


def test_the_example_of_the_documents_runs_as_it_is_printed(installed, tmp_path):
    text = (ROOT / "docs" / "guide" / "python.md").read_text(encoding="utf-8")
    example, printed = re.search(r"```python\n(.*?)```\n+```\n(.*?)```", text, re.DOTALL).groups()
    assert len([line for line in example.splitlines() if line]) == 10
    said, status = run(installed, tmp_path, "python", "-c", example)
    assert status == 0, said
    assert said == printed
