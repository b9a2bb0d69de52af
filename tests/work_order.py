# SPDX-License-Identifier: Apache-2.0
"""
Plugin of the gate: in which order the workers of pytest-xdist get the files of tests.

Files that start real nodes mostly wait for real time, so they are spread among those that compute: as few as possible
run at once, and what a waiting worker leaves of the processor the others use. Slow files come first, so that no worker
is left alone with one at the end.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import pytest

# How long a file takes without a test marked `slow`, beside one with such.
_QUICK = 0.03


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Order the files where workers share them."""
    if hasattr(config, "workerinput"):
        items[:] = itertools.chain.from_iterable(_ordered([list(of) for _, of in itertools.groupby(items, _file)]))


def _file(item: pytest.Item) -> str:
    return item.nodeid.partition("::")[0]


def _cost(file: list[pytest.Item]) -> float:
    return 1.0 if any(item.get_closest_marker("slow") for item in file) else _QUICK


def _ordered(files: list[list[pytest.Item]]) -> Iterator[list[pytest.Item]]:
    """The slow files first, those with real nodes evenly among them."""
    real = [file for file in files if file[0].get_closest_marker("ros")]
    rest = sorted((file for file in files if file not in real), key=_cost, reverse=True)
    whole, done, begun = sum(map(_cost, rest)), 0.0, 0
    for file in rest:
        while begun < len(real) and begun * whole <= done * len(real):
            yield real[begun]
            begun += 1
        yield file
        done += _cost(file)
    yield from real[begun:]
