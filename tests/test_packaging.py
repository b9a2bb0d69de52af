# SPDX-License-Identifier: Apache-2.0
"""Packages: each names what its code imports, one version stands everywhere, and locks have hashes."""

import ast
import re
import sys
from importlib import metadata

import pytest
import yaml

from project import ROOT, ROS

LICENCE = "# SPDX-License-Identifier: Apache-2.0"
PACKAGES = ("mwd_sensors", "mwd_estimation", "mwd_surface")
# The distribution of a module where the two have different names.
DISTRIBUTIONS = {"yaml": "pyyaml", "fpdf": "fpdf2", "serial": "pyserial", "foxglove": "foxglove-sdk"}


def imported(package):
    names = set()
    for path in (ROOT / package / package).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                names.add(node.module.split(".")[0])
            elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith(("import_module", "optional")):
                names |= {str(a.value).split(".")[0] for a in node.args[:1] if isinstance(a, ast.Constant)}
    return {DISTRIBUTIONS.get(n, n).lower() for n in names - set(sys.stdlib_module_names) - ROS - {package}}


def required(package):
    """Names of the distributions that the installed package asks for, extras included."""
    return {re.match(r"[\w.-]+", line)[0].lower() for line in metadata.requires(package)}


@pytest.mark.slow
@pytest.mark.parametrize("package", PACKAGES)
def test_setup_names_what_the_code_imports(package):
    assert imported(package) <= required(package)


@pytest.mark.slow
@pytest.mark.parametrize("package", PACKAGES)
def test_setup_names_nothing_that_is_not_imported(package):
    # A package that is imported by a name made at run time.
    late = {"foxglove-sdk"}
    assert required(package) - imported(package) <= late


def test_one_version_stands_in_every_package_and_document():
    versions = {
        path.parent.name: re.search("<version>(.*)<", path.read_text())[1]
        for path in sorted(ROOT.glob("mwd_*/package.xml"))
    }
    assert sorted(versions) == sorted([*PACKAGES, "mwd_msgs"])
    version = versions["mwd_surface"]
    assert set(versions.values()) == {version}
    assert {metadata.version(package) for package in PACKAGES} == {version}
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))["version"] == version
    changes = [ROOT / "CHANGELOG.md", *ROOT.glob("mwd_*/CHANGELOG.rst")]
    assert all(
        re.search(rf"^\W*{re.escape(version)}\W.*\d{{4}}-\d\d-\d\d", path.read_text(), re.MULTILINE) for path in changes
    )


def test_every_source_file_says_its_licence():
    sources = [path for top in (*PACKAGES, "tests") for path in (ROOT / top).rglob("*.py")]
    texts = {path: path.read_text(encoding="utf-8") for path in sources if not path.is_symlink()}
    silent = [str(path.relative_to(ROOT)) for path, text in texts.items() if text.strip() and LICENCE not in text]
    assert silent == [], f"begin with: {LICENCE}"


LOCKS = sorted((ROOT / ".ci").glob("*.lock"))
HASH = re.compile(r"--hash=sha256:[0-9a-f]{64}")


@pytest.mark.parametrize("lock", LOCKS, ids=lambda path: path.stem)
def test_every_locked_package_has_one_version_and_its_hashes(lock):
    pins = [line.split() for line in lock.read_text().splitlines() if not line.startswith("#")]
    assert all(re.fullmatch(r"[A-Za-z0-9._-]+==[A-Za-z0-9.!+]+", pin) for pin, *_ in pins)
    assert len({pin.split("==")[0].lower().replace("_", "-") for pin, *_ in pins}) == len(pins)
    assert all(hashes and all(map(HASH.fullmatch, hashes)) for _, *hashes in pins)


def test_locked_packages_are_installed_with_their_hashes_required():
    users = [path for path in (ROOT / ".ci" / "setup", ROOT / "Makefile") if path.exists()]
    text = "".join(path.read_text() for path in users)
    installs = re.findall(r'"install",.*?"-r"|pip install .*? -r ', text, re.DOTALL)
    assert len(installs) == 3
    assert all("--require-hashes" in words for words in installs)


def test_no_file_holds_the_marks_of_an_unfinished_merge():
    tops = (*PACKAGES, "mwd_msgs", "bags/scenarios", "docs", "tests", ".ci")
    suffixes = {".py", ".md", ".js", ".css", ".html", ".po", ".yaml", ".msg", ".srv", ".action", ".csv", ".xml", ""}
    paths = [path for top in tops for path in (ROOT / top).rglob("*") if path.is_file() and path.suffix in suffixes]
    marks = re.compile(rb"^(<{7}|>{7}) ", re.MULTILINE)
    held = [
        str(path.relative_to(ROOT))
        for path in paths
        if "node_modules" not in path.parts and marks.search(path.read_bytes())
    ]
    assert held == []
