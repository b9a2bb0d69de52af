# SPDX-License-Identifier: Apache-2.0
"""
Plugin of the gate: names the tests that `make check` runs and should not, by the processor time that they took.

Wall time tells how busy the machine was. A test that is the first to call a kernel pays for its compiler once.
"""

from __future__ import annotations

import resource
from collections.abc import Iterator
from typing import Any

import pytest

LIMIT_S = 0.5
_SHOWN = 20
_NAME = "processor_s"

_began = 0.0
_found: list[tuple[float, str]] = []


def _spent() -> float:
    """Processor time of this process and of its ended children, s."""
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in both)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    """Begin to count, fixtures included."""
    global _began  # noqa: PLW0603  (one test at a time in a process)
    _began = _spent()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Iterator[Any]:
    """Write what a test took beside it, as a worker hands on nothing else."""
    if call.when == "teardown":
        item.user_properties.append((_NAME, _spent() - _began))
    return (yield)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Keep the tests above the limit."""
    took = dict(report.user_properties).get(_NAME, 0.0) if report.when == "teardown" else 0.0
    if took > LIMIT_S and not {"slow", "ros"} & set(report.keywords):
        _found.append((took, report.nodeid))


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """List them where tests marked slow are left out."""
    if _found and "not slow" in config.option.markexpr:
        terminalreporter.section(f"more than {LIMIT_S} s of processor time and not marked slow")
        for took, name in sorted(_found, reverse=True)[:_SHOWN]:
            terminalreporter.write_line(f"{took:5.1f} s {name}")
