# SPDX-License-Identifier: Apache-2.0
"""The contract on the wire: every number has its unit beside it, and no type changes unseen."""

import csv
import json
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FILES = sorted(p for p in (ROOT / "mwd_msgs").glob("*/*") if p.suffix in (".msg", ".srv", ".action"))
# A unit of the SI or of the wire, or words that say why there is none.
UNIT = re.compile(
    r"\b(m|s|rad|T|Pa|N|kg|Hz|V|A|C|Nm|dB|degC|1/s|m3/s|bits?|bytes?|probabilit(y|ies)|SI|ratio|fraction|share|"
    r"words?|chips?|samples?|times|times real time|unit vector|quaternion|no unit|level)\b|"
    r"(m|rad|T|s|Pa)(\^|/)|%|`unit`"
)


def fields(path: Path) -> list[tuple[str, str]]:
    """Declaration of each float, and the comment that belongs to it: on its line, or the lines above and around it."""
    found, above = [], ""
    for line in path.read_text(encoding="utf-8").splitlines():
        declaration, _, comment = line.partition("#")
        if not declaration.strip():
            above = f"{above} {comment}" if comment else ""
        elif re.match(r"float(32|64)\b", declaration) and "=" not in declaration:
            found.append((declaration.strip(), comment or above))
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_every_number_has_a_unit(path):
    assert [declaration for declaration, comment in fields(path) if not UNIT.search(comment)] == []


def test_the_hash_of_every_type_is_the_one_written_down():
    """`mwd_msgs/hashes.csv` is what recordings and other nodes rely on: a change shows in the review of that file."""
    with (ROOT / "mwd_msgs/hashes.csv").open(encoding="utf-8") as file:
        written = {row["type"]: row["hash"] for row in csv.DictReader(file)}
    built = {}
    for path in FILES:
        table = json.loads(Path(sys.prefix, "share", path.relative_to(ROOT)).with_suffix(".json").read_text())
        hashes = {item["type_name"]: item["hash_string"] for item in table["type_hashes"]}
        name = f"mwd_msgs/{path.parent.name}/{path.stem}"
        built[name] = hashes[name]
    assert built == written, "a type changed: `make config`, and a line in the CHANGELOG (mwd_msgs/README.md)"
