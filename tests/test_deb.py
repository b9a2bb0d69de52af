# SPDX-License-Identifier: Apache-2.0
"""The files of the Debian package work in another place than the environment they were copied from."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DEB = [sys.executable, str(ROOT / ".ci/deb")]
pytestmark = [
    pytest.mark.slow(3),
    pytest.mark.skipif(
        not Path(sys.prefix, "share/mwd_msgs").exists(), reason="no environment of `make setup`: make setup"
    ),
]


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The prefix with the files of the package in it, and the folder that stands for /."""
    folder = tmp_path_factory.mktemp("deb")
    root, prefix = folder / "root", folder / "opt/mwd"
    subprocess.run([*DEB, "--any-python", "--stage", root, "--prefix", prefix], check=True)
    prefix.parent.mkdir()
    shutil.move(root / prefix.relative_to("/"), prefix)
    yield prefix, root
    shutil.rmtree(prefix)


def said(prefix, *words):
    """What a program of the package prints, in an environment that knows nothing of it."""
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(prefix.parent), "LANG": "C.UTF-8"}
    done = subprocess.run(
        [prefix / "bin" / words[0], *words[1:]],
        cwd=prefix,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_command_messages_and_nodes_are_those_of_the_package(installed):
    prefix, root = installed
    assert "manifest" in said(prefix, "mwd", "rig", "--help")
    program = "import mwd_msgs.msg, rclpy, mwd_sensors, mwd_surface; print(mwd_msgs.__file__, mwd_surface.__file__)"
    assert all(path.startswith(str(prefix)) for path in said(prefix, "python", "-c", program).split())
    assert (root / "usr/bin/mwd").readlink() == prefix / "bin/mwd"
    assert (root / "usr/share/doc/mwd/copyright").exists()
    for name in ("surface", "receiver", "replay", "well"):
        first = (prefix / "lib/mwd_surface" / name).read_text().splitlines()[0]
        assert first == f"#!{prefix}/bin/python"


def test_nothing_in_it_points_back_to_where_it_was_made(installed):
    prefix, _ = installed
    links = [path for path in prefix.rglob("*") if path.is_symlink() and path.readlink().is_absolute()]
    assert {path.parent for path in links} <= {prefix / "bin"}
    for folder in ("bin", "share", "lib/mwd_sensors", "lib/mwd_estimation", "lib/mwd_surface"):
        files = [path for path in (prefix / folder).rglob("*") if path.is_file() and not path.is_symlink()]
        texts = [path for path in files if path.stat().st_size < 1 << 20]
        assert [path for path in texts if sys.prefix.encode() + b"/" in path.read_bytes()] == []


def test_what_python_writes_beside_the_files_goes_with_the_package(installed):
    prefix, root = installed
    said(prefix, "mwd", "version")
    assert any(prefix.rglob("__pycache__"))
    subprocess.run([root / "DEBIAN/prerm", "remove"], check=True)
    assert not any(prefix.rglob("__pycache__"))
    gone = (root / "DEBIAN/prerm").read_text().replace(str(prefix), str(prefix / "gone"))
    subprocess.run(["sh", "-c", gone], check=True)


def test_an_interpreter_of_this_machine_alone_is_refused_with_the_remedy(tmp_path):
    if Path(sys.executable).resolve().parent == Path("/usr/bin"):
        pytest.skip("this interpreter is the distribution's")
    done = subprocess.run([*DEB, "--stage", tmp_path / "x"], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "make PYTHON=/usr/bin/python3.12 deb" in done.stderr
