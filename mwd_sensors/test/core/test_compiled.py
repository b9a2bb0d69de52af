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


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_changed_callee_in_another_module_is_compiled_anew(tmp_path):
    callee = "from mwd_sensors.core.compiled import compiled\n\n@compiled\ndef step(x):\n    return x + {}\n"
    (tmp_path / "mwd_callee.py").write_text(callee.format(1))
    (tmp_path / "mwd_caller.py").write_text(
        "import mwd_callee\nfrom mwd_sensors.core.compiled import compiled\n\n"
        "@compiled\ndef run(x):\n    return 10 * mwd_callee.step(x)\n\n"
        "print(run(1), len(run.stats.cache_hits))\n"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def run():
        command = [sys.executable, "mwd_caller.py"]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
        return done.stdout.split()

    assert run() == ["20", "0"]
    assert run() == ["20", "1"]
    (tmp_path / "mwd_callee.py").write_text(callee.format(22))
    assert run() == ["230", "0"]


@pytest.mark.slow
def test_an_installation_by_links_uses_the_machine_code_of_the_sources(tmp_path):
    (tmp_path / "sources").mkdir()
    (tmp_path / "sources" / "mwd_twice.py").write_text(
        "from mwd_sensors.core.compiled import compiled\n\n@compiled\ndef twice(x):\n    return 2 * x\n"
    )
    (tmp_path / "links").symlink_to("sources")
    program = "import mwd_twice; print(mwd_twice.twice(4), len(mwd_twice.twice.stats.cache_hits))"

    def run(folder):
        environment = {**os.environ, "PYTHONPATH": str(tmp_path / folder)}
        command = [sys.executable, "-c", program]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
        return done.stdout.split()

    assert run("sources") == ["8", "0"]
    assert run("links") == ["8", "1"]


@pytest.mark.slow
def test_a_kernel_is_compiled_anew_when_the_fields_of_its_parameters_change_places(tmp_path):
    params = "from typing import NamedTuple\n\nclass Params(NamedTuple):\n    {}: float\n    {}: float\n"
    (tmp_path / "mwd_params.py").write_text(params.format("low", "top"))
    (tmp_path / "mwd_user.py").write_text(
        "from mwd_params import Params\nfrom mwd_sensors.core.compiled import compiled\n\n"
        "@compiled\ndef span(p):\n    return p.top - p.low\n\nprint(span(Params(low=1.0, top=4.0)))\n"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def run():
        command = [sys.executable, "mwd_user.py"]
        return subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
        ).stdout.strip()

    assert run() == "3.0"
    (tmp_path / "mwd_params.py").write_text(params.format("top", "low"))
    assert run() == "3.0"


@pytest.mark.slow
def test_a_kernel_is_compiled_anew_when_the_module_of_its_parameters_has_another_name(tmp_path):
    params = "from typing import NamedTuple\n\nclass Params(NamedTuple):\n    low: float\n    top: float\n"
    user = (
        "from {0} import Params\nfrom mwd_sensors.core.compiled import compiled\n\n"
        "@compiled\ndef span(p):\n    return p.top - p.low\n\nprint(span(Params(low=1.0, top=4.0)))\n"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    for name in ("mwd_params_before", "mwd_params_after"):
        (tmp_path / f"{name}.py").write_text(params)
        (tmp_path / "mwd_user.py").write_text(user.format(name))
        command = [sys.executable, "mwd_user.py"]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
        assert done.stdout.strip() == "3.0"
        (tmp_path / f"{name}.py").unlink()


@pytest.mark.slow
def test_a_callee_is_compiled_once_for_a_type_whatever_the_numbers_in_the_call(tmp_path):
    (tmp_path / "mwd_powers.py").write_text(
        "from mwd_sensors.core.compiled import compiled\n\n"
        "@compiled\ndef power(base, exponent):\n    return base**exponent\n\n"
        "@compiled\ndef powers(base):\n    return power(base, 2) + power(base, 3) + power(2, base)\n\n"
        "print(powers(3), len(power.signatures))\n"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    command = [sys.executable, "mwd_powers.py"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["44", "1"]


@pytest.mark.slow
def test_that_kernels_are_being_compiled_is_reported_once_and_not_where_they_come_from_the_cache(tmp_path):
    (tmp_path / "mwd_sums.py").write_text(
        "from mwd_sensors.core.compiled import compiled, when_compiling\n\n"
        "@compiled\ndef total(n):\n    return n + 1\n\n"
        "with when_compiling(lambda: print('compiling')):\n    print(total(1), total(1.0))\n"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    command = [sys.executable, "mwd_sums.py"]
    for expected in (["compiling", "2", "2.0"], ["2", "2.0"]):
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
        assert done.stdout.split() == expected


@pytest.mark.slow
def test_processes_that_need_a_kernel_at_the_same_time_compile_it_once(tmp_path):
    (tmp_path / "mwd_shared.py").write_text(
        "from mwd_sensors.core.compiled import compiled, when_compiling\n\n"
        "@compiled\ndef part(n):\n    return n + 1\n\n"
        "@compiled\ndef whole(n):\n    return 2 * part(n)\n\n"
        "input()\n"
        "with when_compiling(lambda: print('compiling')):\n    print(whole(1))\n"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    command = [sys.executable, "mwd_shared.py"]
    begun = [
        subprocess.Popen(
            command, cwd=tmp_path, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        for _ in range(3)
    ]
    for process in begun:
        process.stdin.write("\n")
        process.stdin.flush()
    said = sorted(process.communicate()[0].split() for process in begun)
    assert said == [["4"], ["4"], ["compiling", "4"]]


@pytest.mark.slow
def test_machine_code_is_kept_for_one_version_and_for_the_user_where_the_module_cannot_have_it(tmp_path):
    source = (
        "from mwd_sensors.core.compiled import compiled\n\n"
        "@compiled\ndef step(x):\n    return x + {}\n\nprint(step(1))\n"
    )
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    environment["XDG_CACHE_HOME"] = str(tmp_path / "user")
    (tmp_path / "__pycache__").write_text("a file, so that no folder can be made here")
    for added in (1, 2):
        (tmp_path / "mwd_step.py").write_text(source.format(added))
        command = [sys.executable, "-c", "import mwd_step"]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
        assert done.stdout.split() == [str(1 + added)]
        (folder,) = (tmp_path / "user" / "mwd").glob("mwd_step-*")
        assert any(folder.rglob("*.nbc"))


@pytest.mark.slow
def test_installations_that_share_a_cache_leave_each_other_their_machine_code(tmp_path):
    source = (
        "from mwd_sensors.core.compiled import compiled\n\n"
        "@compiled\ndef step(x):\n    return x + {}\n\nprint(step(1), len(step.stats.cache_hits))\n"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def run(installation):
        command = [sys.executable, "-c", "import mwd_step"]
        folder = tmp_path / installation
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)
        return done.stdout.split()

    def folders():
        return set((tmp_path / "cache").iterdir())

    for name, added in (("one", 1), ("two", 22)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "mwd_step.py").write_text(source.format(added))
    assert [run("one"), run("two")] == [["2", "0"], ["23", "0"]]
    assert [run("one"), run("two")] == [["2", "1"], ["23", "1"]]
    # A new version replaces the former one of its own installation only.
    (tmp_path / "one" / "mwd_step.py").write_text(source.format(333))
    assert [run("one"), run("two")] == [["334", "0"], ["23", "1"]]
    assert len(folders()) == 2
    # A folder that another installation has not used for a month is removed; each use counts.
    for folder in folders():
        os.utime(folder, (0.0, 0.0))
    assert run("one") == ["334", "1"]
    assert len(folders()) == 1
