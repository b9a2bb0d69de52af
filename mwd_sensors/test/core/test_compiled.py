# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels: what was cached of a callee that has changed since is not used."""

import os
import subprocess
import sys
import tracemalloc
from typing import NamedTuple

import numpy as np
import pytest

from mwd_sensors.core.compiled import compiled


@compiled
def _sum(n):
    total = 0
    for k in range(n):
        total += k
    return total


def test_a_kernel_gives_what_the_function_gives():
    assert _sum(1000) == 499500


class _Columns(NamedTuple):
    """Enough names that numba before 0.61 would confuse its layouts."""

    first_of_three: np.ndarray
    second_of_three: np.ndarray
    third_of_three: np.ndarray


@compiled
def _total(columns, k):
    return columns.first_of_three[k] + columns.second_of_three[k] + columns.third_of_three[k]


@pytest.mark.slow(3)
def test_a_kernel_tells_apart_the_layouts_of_columns_and_keeps_nothing_of_a_call():
    table = np.arange(12.0).reshape(4, 3)
    spread, packed = _Columns(*table.T), _Columns(*np.ascontiguousarray(table.T))
    first = _Columns(packed.first_of_three, spread.second_of_three, spread.third_of_three)
    assert [[_total(columns, k) for k in range(4)] for columns in (spread, packed, first)] == [[3, 12, 21, 30]] * 3
    kept = []
    tracemalloc.start()
    # At first the interpreter keeps freed tuples for the next ones.
    for _ in range(2):
        for _ in range(5000):
            assert _total(spread, 1) == _total(packed, 1) == _total(first, 1) == 12
        kept.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert kept[1] - kept[0] < 5000


KERNEL = "from mwd_sensors.core.compiled import compiled, when_compiling\n\n"
PARAMS = "from typing import NamedTuple\n\nclass Params(NamedTuple):\n    {}: float\n    {}: float\n"
SPAN = KERNEL + (
    "from {} import Params\n\n@compiled\ndef span(p):\n    return p.top - p.low\n\n"
    "print(span(Params(low=1.0, top=4.0)))\n"
)


class Sources:
    """Modules in a folder, and what a process writes that imports one of them."""

    def __init__(self, folder, **environment):
        folder.mkdir(exist_ok=True)
        self.folder, self.environment = folder, {**os.environ, **environment}

    def write(self, **modules):
        for name, text in modules.items():
            (self.folder / f"{name}.py").write_text(text)

    def start(self, module, **pipes):
        words = [sys.executable, "-c", f"import {module}"]
        return subprocess.Popen(
            words, cwd=self.folder, env=self.environment, stdout=subprocess.PIPE, text=True, **pipes
        )

    def run(self, module):
        process = self.start(module)
        said = process.communicate()[0].split()
        assert process.returncode == 0
        return said


@pytest.fixture
def sources(tmp_path):
    return Sources(tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache"))


@pytest.mark.slow(3)
def test_a_changed_callee_in_another_module_is_compiled_anew(sources):
    callee = KERNEL + "@compiled\ndef step(x):\n    return x + {}\n"
    caller = "import mwd_callee\n\n@compiled\ndef run(x):\n    return 10 * mwd_callee.step(x)\n\n"
    sources.write(mwd_callee=callee.format(1))
    sources.write(mwd_caller=f"{KERNEL}{caller}print(run(1), len(run.stats.cache_hits))\n")
    assert sources.run("mwd_caller") == ["20", "0"]
    assert sources.run("mwd_caller") == ["20", "1"]
    sources.write(mwd_callee=callee.format(22))
    assert sources.run("mwd_caller") == ["230", "0"]


@pytest.mark.slow(3)
def test_an_installation_by_links_uses_the_machine_code_of_the_sources(tmp_path):
    twice = "@compiled\ndef twice(x):\n    return 2 * x\n\nprint(twice(4), len(twice.stats.cache_hits))\n"
    Sources(tmp_path / "sources").write(mwd_twice=KERNEL + twice)
    (tmp_path / "links").symlink_to("sources")
    found = [Sources(tmp_path, PYTHONPATH=str(tmp_path / folder)).run("mwd_twice") for folder in ("sources", "links")]
    assert found == [["8", "0"], ["8", "1"]]


@pytest.mark.slow(3)
def test_a_kernel_is_compiled_anew_when_its_parameters_change_places_or_their_module_has_another_name(sources):
    for module, fields in (
        ("mwd_before", ("low", "top")),
        ("mwd_before", ("top", "low")),
        ("mwd_after", ("top", "low")),
    ):
        sources.write(**{module: PARAMS.format(*fields), "mwd_user": SPAN.format(module)})
        assert sources.run("mwd_user") == ["3.0"]
        (sources.folder / f"{module}.py").unlink()


@pytest.mark.slow(3)
def test_a_callee_is_compiled_once_for_a_type_whatever_the_numbers_in_the_call(sources):
    sources.write(
        mwd_powers=KERNEL + "@compiled\ndef power(base, exponent):\n    return base**exponent\n\n"
        "@compiled\ndef powers(base):\n    return power(base, 2) + power(base, 3) + power(2, base)\n\n"
        "print(powers(3), len(power.signatures))\n"
    )
    assert sources.run("mwd_powers") == ["44", "1"]


@pytest.mark.slow(3)
def test_kernels_being_compiled_are_reported_once_and_compiled_once_by_processes_that_need_them_together(sources):
    sources.write(
        mwd_shared=KERNEL + "@compiled\ndef part(n):\n    return n + 1\n\n"
        "@compiled\ndef whole(n):\n    return 2 * part(n)\n\n"
        "input()\nwith when_compiling(lambda: print('compiling')):\n    print(whole(1))\n",
        mwd_sums=KERNEL + "@compiled\ndef total(n):\n    return n + 1\n\n"
        "with when_compiling(lambda: print('compiling')):\n    print(total(1), total(1.0))\n",
    )
    for expected in (["compiling", "2", "2.0"], ["2", "2.0"]):
        assert sources.run("mwd_sums") == expected
    begun = [sources.start("mwd_shared", stdin=subprocess.PIPE) for _ in range(2)]
    for process in begun:
        process.stdin.write("\n")
        process.stdin.flush()
    said = sorted(process.communicate()[0].split() for process in begun)
    assert said == [["4"], ["compiling", "4"]]


STEP = KERNEL + "@compiled\ndef step(x):\n    return x + {}\n\nprint(step(1), len(step.stats.cache_hits))\n"


@pytest.mark.slow(3)
def test_machine_code_is_kept_for_one_version_and_for_the_user_where_the_module_cannot_have_it(tmp_path, monkeypatch):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    sources = Sources(tmp_path, XDG_CACHE_HOME=str(tmp_path / "user"))
    (tmp_path / "__pycache__").write_text("a file, so that no folder can be made here")
    for added in (1, 2):
        sources.write(mwd_step=STEP.format(added))
        assert sources.run("mwd_step") == [str(1 + added), "0"]
        (folder,) = (tmp_path / "user" / "mwd").glob("mwd_step-*")
        assert any(folder.rglob("*.nbc"))


@pytest.mark.slow(3)
def test_installations_that_share_a_cache_leave_each_other_their_machine_code(tmp_path):
    one, two = (Sources(tmp_path / name, NUMBA_CACHE_DIR=str(tmp_path / "cache")) for name in ("one", "two"))

    def folders():
        return set((tmp_path / "cache").iterdir())

    one.write(mwd_step=STEP.format(1))
    two.write(mwd_step=STEP.format(22))
    assert [one.run("mwd_step"), two.run("mwd_step")] == [["2", "0"], ["23", "0"]]
    # A new version replaces the former one of its own installation only.
    one.write(mwd_step=STEP.format(333))
    assert [one.run("mwd_step"), two.run("mwd_step")] == [["334", "0"], ["23", "1"]]
    assert len(folders()) == 2
    # A folder that another installation has not used for a month is removed; each use counts.
    for folder in folders():
        os.utime(folder, (0.0, 0.0))
    assert one.run("mwd_step") == ["334", "1"]
    assert len(folders()) == 1
