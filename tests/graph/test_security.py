# SPDX-License-Identifier: Apache-2.0
"""
The SROS2 policy that is shipped allows what the nodes of a well have open, and is a policy file that sros2 reads.

After a change of topics or services: `python tests/graph/test_security.py` writes the table anew.
"""

import json
import sys
import tempfile
from pathlib import Path

import pytest
import yaml
from lxml import etree

import running_graph
from mwd_sensors.telemetry import tool_configuration
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.ros import security_policy
from mwd_surface.runs import launch_plan
from project import ROOT

# What nodes open by their settings only: bursts, other links, rig data in, simulated time.
OPTIONAL = {
    "sonde": {
        "publish": ["gyro/burst", "imu/burst", "rig/coil_voltage", "rig/earth_voltage", "rig/standpipe_2"],
        "subscribe": ["/clock"],
    },
    "estimator": {"publish": ["innovations", "tool/transmission"], "subscribe": ["/clock"]},
    "receiver": {"subscribe": ["/clock", "rig/coil_voltage", "rig/earth_voltage", "rig/standpipe_2", "rig/strokes"]},
    "surface": {"publish": ["rig/state"], "subscribe": ["/clock", "innovations"]},
    "probe": {"subscribe": ["/clock"]},
}


def open_in_a_well(folder):
    """What each node has open: in a well with a simulated sonde, and in one over a link with a probe."""
    tool, surface = folder / "tool.yaml", {"folder": folder, "page__port": 0}
    tool.write_text(tool_configuration.text(ToolConfiguration()))
    scenario = ROOT / "bags" / "scenarios" / "telemetry_shallow.yaml"
    with running_graph.graph(folder) as graph:
        names = [
            graph.start("sonde", "w1", scenario=scenario, rate=0.1, wait_for_listener_s=600.0),
            graph.start("estimator", "w1"),
            graph.start("surface", "w1", **surface),
            graph.start("probe", "w2", port="/dev/null"),
            graph.start("receiver", "w2", tool_file=tool),
            graph.start("surface", "w2", link__source="mud_pulse", **surface),
        ]
        graph.active(*names)
        visitor = Path(__file__).with_name("open_names.py")
        done = graph.run(sys.executable, visitor, *(f"/{name}" for name in names))
        assert done.returncode == 0, done.stderr
    table = {}
    for name, rights in json.loads(done.stdout.splitlines()[-1]).items():
        table = security_policy.merged(table, {name.rpartition("/")[2]: rights})
    return table


@pytest.mark.ros
@pytest.mark.slow(14)
@pytest.mark.fault_case(94)
def test_the_policy_allows_all_that_the_nodes_of_a_well_have_open(tmp_path):
    found = open_in_a_well(tmp_path)
    assert set(found) == {"sonde", "probe", "estimator", "receiver", "surface"}
    assert "attitude" in found["estimator"]["publish"]
    assert "north_seek" in found["estimator"]["execute"]
    assert "imu/data_raw" in found["probe"]["publish"]
    # New topics and services: write the table anew, as the head of this file says.
    assert security_policy.missing(security_policy.shipped(), found) == []


@pytest.mark.fault_case(94)
def test_the_estimator_may_not_read_the_truth_and_nobody_else_may_judge_surveys():
    table = security_policy.shipped()
    assert "truth" not in table["estimator"]["subscribe"]
    assert [node for node, kinds in table.items() if "accept_survey" in kinds["reply"]] == ["surface"]
    assert [node for node, kinds in table.items() if "imu/data_raw" in kinds["publish"]] == ["probe", "sonde"]
    assert security_policy.missing(table, {"estimator": {"subscribe": ["truth"]}}) == [
        "estimator may not subscribe truth"
    ]


def test_the_policy_file_has_an_enclave_for_each_node_an_operator_and_a_controller():
    root = etree.fromstring(security_policy.policy_xml(security_policy.shipped(), "/field/well_7/").encode())
    assert root.attrib == {"version": "0.2.0"}
    paths = [enclave.attrib["path"] for enclave in root.iter("enclave")]
    assert [path.rpartition("/")[2] for path in paths] == [*security_policy.shipped(), "operator", "controller"]
    assert all(path.startswith("/field/well_7/") for path in paths)
    assert all(profile.attrib["ns"] == "/field/well_7" for profile in root.iter("profile"))
    operator = root.find("enclaves/enclave[@path='/field/well_7/operator']/profiles/profile")
    requested = [service.text for service in operator.findall("services[@request='ALLOW']/service")]
    assert "accept_survey" in requested
    assert "surface/set_parameters" in requested
    published = [topic.text for topic in operator.findall("topics[@publish='ALLOW']/topic")]
    assert "imu/data_raw" not in published
    controller = root.find("enclaves/enclave[@path='/field/well_7/controller']/profiles/profile")
    assert "control/command" in [topic.text for topic in controller.findall("topics[@publish='ALLOW']/topic")]
    assert "accept_survey" not in [service.text for service in controller.findall("services/service")]


@pytest.mark.fault_case(94)
def test_mwd_run_starts_each_node_with_the_enclave_that_the_policy_has_for_it():
    table = security_policy.shipped()
    root = etree.fromstring(security_policy.policy_xml(table, "field/well_7").encode())
    enclaves = {enclave.attrib["path"] for enclave in root.iter("enclave")}
    for node in table:
        words = launch_plan.node_words(node, "field/well_7", {})
        assert words[words.index("--enclave") + 1] in enclaves


@pytest.mark.parametrize("well", ["a b", "well-1", "x/../y", '"><x'])
def test_a_well_that_is_no_name_is_refused(well):
    with pytest.raises(ValueError, match="well: must be a name"):
        security_policy.policy_xml({}, well)


def main() -> None:
    """Write the table of a running well, and what the table allowed before for the same nodes."""
    with tempfile.TemporaryDirectory() as folder:
        table = security_policy.merged(open_in_a_well(Path(folder)), OPTIONAL)
    file = Path(security_policy.__file__).with_name("security_policy.yaml")
    text = yaml.safe_dump(table, sort_keys=False, width=120, default_flow_style=None)
    file.write_text(f"# What each node may do: read from a running well by tests/graph/test_security.py.\n{text}")


if __name__ == "__main__":
    main()
