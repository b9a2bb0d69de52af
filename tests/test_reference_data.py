# SPDX-License-Identifier: Apache-2.0
"""The reference data are those that SOURCES.md lists, byte for byte."""

import hashlib
import re

from project import REFERENCE_DATA


def test_reference_data_are_the_listed_files_and_no_others():
    text = (REFERENCE_DATA / "SOURCES.md").read_text(encoding="utf-8")
    listed = {name: digest for digest, name in re.findall(r"^\| ([0-9a-f]{64}) \| (\S+) \|$", text, re.MULTILINE)}
    about = {"SOURCES.md", ".gitattributes"}
    files = (path for path in REFERENCE_DATA.rglob("*") if path.is_file() and path.name not in about)
    found = {str(path.relative_to(REFERENCE_DATA)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
    assert len(listed) > 10
    assert found == listed
