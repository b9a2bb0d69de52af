# SPDX-License-Identifier: Apache-2.0
"""
Plugin of the gate: a test that waits for real nodes or a browser and fails is run a second time, and named.

Discovery, acknowledgements and the screen have real time, of which a machine at its limit gives each process a share
that no test knows; ROS's own gate does the same (`colcon test --retest-until-pass 2`). A test that needed the second
run stands in the summary as RERUN. A graph that a module of tests shares is started anew where its start failed, else
asked again. Tests that compute have one run: what they find does not depend on the machine.
"""

import pytest


def _waits(item: pytest.Item) -> bool:
    return item.get_closest_marker("ros") is not None or "browser" in getattr(item, "fixturenames", ())


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Allow one more run where real time decides, if pytest-rerunfailures is installed."""
    for item in filter(_waits, items if config.pluginmanager.hasplugin("rerunfailures") else []):
        item.add_marker(pytest.mark.flaky(reruns=1))
