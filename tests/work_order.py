# SPDX-License-Identifier: Apache-2.0
"""
Plugin of the gate: in which order the workers of pytest-xdist get the files of tests.

Files that start real nodes mostly wait for real time, so they are spread among those that compute: as few as possible
run at once, and what a waiting worker leaves of the processor the others use. The files that take longest come first,
so that no worker is left alone with one at the end. How long a file takes is the sum over those of its tests that run:
a test marked `slow` counts a second, one marked `slow(20)` twenty. Tests that share a graph or a simulated run count
their parts of what the file takes.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import pytest

# Processor time, s, of a test marked `slow` that does not say more, and of one that is not; means of the suite.
_SLOW, _QUICK = 1.0, 0.03


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Order the files where workers share them; by now the tests that do not run have been left out."""
    if hasattr(config, "workerinput"):
        items[:] = itertools.chain.from_iterable(_ordered([list(of) for _, of in itertools.groupby(items, _file)]))


def _file(item: pytest.Item) -> str:
    return item.nodeid.partition("::")[0]


def _seconds(item: pytest.Item) -> float:
    slow = item.get_closest_marker("slow")
    if slow is None:
        return _QUICK
    return float(slow.args[0]) if slow.args else _SLOW


def _cost(file: list[pytest.Item]) -> float:
    return sum(map(_seconds, file))


def _ordered(files: list[list[pytest.Item]]) -> Iterator[list[pytest.Item]]:
    """The longest files first, those with real nodes evenly among them."""
    files = sorted(files, key=_cost, reverse=True)
    real = [file for file in files if any(item.get_closest_marker("ros") for item in file)]
    rest = [file for file in files if file not in real]
    whole, done, begun = sum(map(_cost, rest)), 0.0, 0
    for file in rest:
        while begun < len(real) and begun * whole <= done * len(real):
            yield real[begun]
            begun += 1
        yield file
        done += _cost(file)
    yield from real[begun:]
