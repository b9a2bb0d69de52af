# SPDX-License-Identifier: Apache-2.0
"""The reference data are those that SOURCES.md lists, byte for byte, and a test that lacks them fails."""

import hashlib
import re

from project import REFERENCE_DATA, ROOT


def test_reference_data_are_the_listed_files_and_no_others():
    text = (REFERENCE_DATA / "SOURCES.md").read_text(encoding="utf-8")
    listed = {name: digest for digest, name in re.findall(r"^\| ([0-9a-f]{64}) \| (\S+) \|$", text, re.MULTILINE)}
    about = {"SOURCES.md", ".gitattributes"}
    files = (path for path in REFERENCE_DATA.rglob("*") if path.is_file() and path.name not in about)
    found = {str(path.relative_to(REFERENCE_DATA)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
    assert len(listed) > 10
    assert found == listed


def test_no_test_skips_where_a_reference_or_a_locked_package_is_missing():
    skips = re.compile(r"importorskip\(\s*\"([\w.]+)|skipif\(not (\S*exists|\S*is_dir|HAVE_)")
    # Without ROS the tests of nodes cannot run: it comes for one version of Python.
    allowed = ("rclpy", "mwd_msgs")
    for path in [*ROOT.glob("tests/**/*.py"), *ROOT.glob("mwd_*/test/**/*.py")]:
        for found in skips.finditer(path.read_text(encoding="utf-8")):
            assert (found[1] or "").startswith(allowed), f"{path}: {found[0]}"
