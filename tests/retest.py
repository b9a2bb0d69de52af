# SPDX-License-Identifier: Apache-2.0
"""
Plugin of the gate: a test that waits for real nodes or a browser and fails is run a second time, and named.

Discovery, acknowledgements and the screen have real time, of which a machine at its limit gives each process a share
that no test knows; ROS's own gate does the same (`colcon test --retest-until-pass 2`). A test that needed the second
run stands in the summary as RERUN. A graph that a module of tests shares is started anew for it: what one run of it
left would be read a second time else. Tests that compute have one run: what they find does not depend on the machine.
"""

from collections.abc import Generator

import pytest


def _waits(item: pytest.Item) -> bool:
    return item.get_closest_marker("ros") is not None or "browser" in getattr(item, "fixturenames", ())


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Allow one more run where real time decides, if pytest-rerunfailures is installed."""
    for item in filter(_waits, items if config.pluginmanager.hasplugin("rerunfailures") else []):
        item.add_marker(pytest.mark.flaky(reruns=1))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """End what the module shares, before a test that failed by it is run a second time."""
    report = yield
    if report.when == "call" and report.failed and item.get_closest_marker("flaky") and item.execution_count == 1:
        for definitions in item._fixtureinfo.name2fixturedefs.values():
            for definition in definitions:
                if definition.scope == "module":
                    definition.finish(item._request)
    return report
