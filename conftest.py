# SPDX-License-Identifier: Apache-2.0
"""Settings of pytest for all packages: equal input in each run, one thread for each worker, the longest files first."""

from __future__ import annotations

import gc
import itertools
import os
import signal
from collections.abc import Generator, Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

from mwd_sensors.core.linear_algebra import use_one_thread

# This must come before numpy is imported. Otherwise the linear algebra of every worker starts one thread for each core,
# and these threads wait for each other longer than they compute.
use_one_thread()

# Commands speak the language of the environment; tests read English unless they choose another one.
os.environ["LANGUAGE"] = "en"
# The help is formatted as `mwd` does, without rich. This must come before typer is imported.
os.environ["TYPER_USE_RICH"] = "0"

# A shell without job control starts background programs with SIGINT ignored, and their child processes inherit this.
# Restore the usual handler.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("gate", deadline=None, derandomize=True, max_examples=30)
# `make nightly`: other examples in each run, and three times as many.
settings.register_profile("nightly", deadline=None, max_examples=100)
# `make fuzz`: random input in each run, and many more examples.
settings.register_profile(
    "fuzz",
    deadline=None,
    max_examples=int(os.environ.get("FUZZ_INPUTS", "5000")),
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "gate"))


def pytest_collection() -> None:
    """
    Switch the garbage collector off while tests are collected.

    Otherwise a third of the time would be spent on a search among objects that stay in memory.
    """
    gc.disable()


def pytest_collection_finish() -> None:
    """Exclude the collected modules from garbage collection, and switch the garbage collector on again."""
    gc.freeze()
    gc.set_threshold(21_000)
    gc.enable()


# If a test with real nodes or with the browser fails, it is run a second time and reported as RERUN: on a busy machine
# the discovery of nodes or the drawing of the page can be too slow. Tests that only compute are run once.


def pytest_itemcollected(item: pytest.Item) -> None:
    """Allow a second run of a test whose result depends on real time."""
    if item.get_closest_marker("ros") or "browser" in getattr(item, "fixturenames", ()):
        item.add_marker(pytest.mark.flaky(reruns=1))


@pytest.hookimpl(tryfirst=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef[Any], request: pytest.FixtureRequest) -> None:
    """Store the fixtures of module scope, which hold the graphs that the tests of a module share."""
    if fixturedef.scope == "module":
        _shared[fixturedef] = request


_shared: dict[pytest.FixtureDef[Any], pytest.FixtureRequest] = {}


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """End the shared graphs before a second run, so that the second run does not read results of the first."""
    report = yield
    if report.when == "call" and report.failed and item.get_closest_marker("flaky") and item.execution_count == 1:
        for fixture, request in _shared.items():
            fixture.finish(request)
    return report


# Each worker of pytest-xdist gets whole files. The longest files come first, so that no worker still runs a long file
# when the others have finished. Files that mostly wait for real nodes are mixed evenly with files that compute.


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Order the test files if several workers share them."""
    if hasattr(config, "workerinput"):
        files = [list(tests) for _, tests in itertools.groupby(items, lambda item: item.nodeid.partition("::")[0])]
        waiting = [file for file in files if any(item.get_closest_marker("ros") for item in file)]
        rest = [file for file in files if file not in waiting]
        ordered = sorted([*_with_place(waiting), *_with_place(rest)], key=lambda placed: placed[0])
        items[:] = itertools.chain.from_iterable(file for _, file in ordered)


def _with_place(files: list[list[pytest.Item]]) -> Iterator[tuple[float, list[pytest.Item]]]:
    """Yield the files, longest first, each with the share (0 to 1) of the total time that the files before it take."""
    whole, done = sum(map(_seconds, files)), 0.0
    for file in sorted(files, key=_seconds, reverse=True):
        yield done / whole, file
        done += _seconds(file)


def _seconds(file: list[pytest.Item]) -> float:
    """Return the time of a file, s: 20 for a test marked `slow(20)`, 1 for `slow`, 0.03 for any other test."""
    markers = [item.get_closest_marker("slow") for item in file]
    return sum(0.03 if one is None else float(one.args[0]) if one.args else 1.0 for one in markers)
