# SPDX-License-Identifier: Apache-2.0
"""What `mwd run` is told of settings, and the secret of the page."""

import stat
import tempfile
from pathlib import Path

import pytest
import yaml

import bombs
from mwd_sensors.core.settings import SettingsError
from mwd_sensors.simulator.scenario import read
from mwd_surface.commands import run
from mwd_surface.commands.run_options import (
    OF_OPTIONS,
    file_parameters,
    give_parameters,
    page_secret,
    parameter_file,
    set_parameters,
)
from mwd_surface.runs import launch_plan
from project import SCENARIOS


def parameters():
    return {"estimator": {}, "surface": {}, "sonde": {}}


def test_a_setting_goes_to_the_node_that_has_it():
    given = parameters()
    set_parameters(given, ["survey.duration_s=12", "surface.leg.tool=T-7", "sonde.seed=4", "tool.mount.imu=z-down"])
    assert given["estimator"] == {"survey.duration_s": 12.0, "tool.mount.imu": "z-down"}
    assert given["surface"] == {"leg.tool": "T-7"}
    assert given["sonde"] == {"seed": 4}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("survey.duraton_s=12", "did you mean survey.duration_s"),
        ("survey.duration_s=0.1", "below the lowest allowed"),
        ("surface.leg.tol=1", "no such setting"),
        ("qqqq.zzzz=1", "no such setting; settings begin with .*survey.*surface"),
    ],
)
def test_a_setting_that_no_node_takes_is_refused(text, words):
    with pytest.raises(SettingsError, match=words):
        set_parameters(parameters(), [text])


def test_the_secret_of_the_page_is_in_a_file_that_its_owner_alone_can_read(tmp_path, capsys):
    assert page_secret(None, tmp_path) == {}
    (path,) = page_secret("a long word", tmp_path).values()
    assert Path(path).read_text() == "a long word\n"
    assert stat.S_IMODE((tmp_path / "page_token").stat().st_mode) == 0o600
    page_secret("new", tmp_path)
    made = (tmp_path / "page_token").read_text().strip()
    assert made in capsys.readouterr().out
    assert len(made) >= 8
    with pytest.raises(ValueError, match="8 characters"):
        page_secret("short", tmp_path)


def test_a_parameter_file_that_is_not_there_is_named(tmp_path):
    assert parameter_file(None) == []
    with pytest.raises(FileNotFoundError, match="parameter file not found"):
        parameter_file(tmp_path / "none.yaml")


def computed():
    """Every parameter that a run computes, with its value: of a plain scenario and of one with telemetry."""
    found = {}
    for name in ("default", "telemetry_two_links"):
        path = SCENARIOS / f"{name}.yaml"
        story = read(path, {})
        made = run._parameters(story, path, method="s3", rate=1.0, seed=3)
        made["surface"] |= {"folder": "runs", "record.enabled": True, "record.name": "x", "well.name": "w1"}
        made["surface"] |= {"plan.file": "plan.csv", "page.token_file": "token"}
        with launch_plan.rig_parameters() as rig:
            made["surface"] |= rig
        if story.telemetry is not None:
            with tempfile.TemporaryDirectory() as folder:
                run._add_link(made, story, Path(folder))
        found |= {(node, key): value for node, table in made.items() for key, value in table.items()}
    return found


COMPUTED = computed()


def other(node, name, value):
    """Another value that the parameter allows."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return type(value)(value + 1)
    words = {"gravity.method": "mahony", "tool.string": "short", "place.field": "fixed", "link.source": "mud_pulse"}
    words["well.convention"] = "dip_up"
    return words.get(name, "2026-04-01" if name == "place.date" else f"{value}_2")


@pytest.mark.parametrize("by", ["set", "file"])
@pytest.mark.parametrize(("node", "name"), sorted(COMPUTED))
def test_what_a_user_gives_wins_over_what_the_run_computes_or_is_refused(node, name, by, tmp_path):
    value = COMPUTED[node, name]
    given = other(node, name, value)
    made = {one: {} for one, _ in COMPUTED}
    for (owner, key), computed_value in COMPUTED.items():
        made[owner][key] = computed_value
    wanted = {"place.field": {"place.total_nt": 5e4, "place.dip_deg": 60.0}}.get(name, {})
    table = {name: given, **wanted}
    how = {"changes": [f"{node}.{key}={settings_text(one)}" for key, one in table.items()]}
    if by == "file":
        file = tmp_path / "p.yaml"
        file.write_text(
            yaml.safe_dump(
                {"/**": {"ros__parameters": {"use_sim_time": False}}, f"/w/{node}": {"ros__parameters": table}}
            )
        )
        how = {"params": file}
    if f"{node}.{name}" in OF_OPTIONS:
        with pytest.raises(SettingsError, match=r"mwd run|argument"):
            give_parameters(made, "w", **how)
    else:
        give_parameters(made, "w", **how)
        assert made[node][name] == given


def settings_text(value):
    return str(value).lower() if isinstance(value, bool) else value


def test_an_option_and_a_parameter_that_contradict_it_are_refused_and_set_wins_over_the_file(tmp_path):
    made = {"surface": {}, "estimator": {}, "sonde": {}}
    with pytest.raises(SettingsError, match="--port contradict"):
        give_parameters(made, "w", changes=["surface.page.port=8090"], options={"--port": 8091})
    give_parameters(made, "w", changes=["surface.page.port=8091"], options={"--port": 8091})
    file = tmp_path / "p.yaml"
    file.write_text(yaml.safe_dump({"/**": {"surface": {"ros__parameters": {"page": {"port": 8070}}}}}))
    give_parameters(made, "w", changes=["surface.page.port=8091"], params=file)
    assert made["surface"]["page.port"] == 8091


@pytest.mark.parametrize(
    ("section", "hit"),
    [
        ({"/**": {}}, True),
        ({"/**/surface": {}}, True),
        ({"/pad/*/surface": {}}, True),
        ({"/pad": {"w1": {"surface": {}}}}, True),
        ({"/pad/w1/surface": {}}, True),
        ({"surface": {}}, False),
        ({"/pad/w2/surface": {}}, False),
        ({"/*/surface": {}}, False),
    ],
)
def test_sections_of_a_parameter_file_match_as_in_ros(section, hit, tmp_path):
    def filled(table):
        return {key: filled(value) if value else {"ros__parameters": {"page.port": 1}} for key, value in table.items()}

    file = tmp_path / "p.yaml"
    file.write_text(yaml.safe_dump(filled(section)))
    assert (file_parameters(file, "/pad/w1/surface") == {"page.port": 1}) == hit


@pytest.mark.fault_case(84)
@pytest.mark.parametrize("kind", bombs.YAML)
def test_a_parameter_file_that_unfolds_without_end_is_refused(kind, tmp_path):
    bombs.YAML[kind](tmp_path / "p.yaml")
    with pytest.raises(ValueError, match=r"p\.yaml"):
        file_parameters(tmp_path / "p.yaml", "/surface")


def test_a_rig_interface_that_is_switched_off_or_has_its_port_stays_so():
    with launch_plan.rig_parameters({"rig.opcua.enabled": False}) as rig:
        assert not any(key.startswith("rig.opcua") for key in rig)
    with launch_plan.rig_parameters() as free:
        port = free["rig.modbus.port"]
    with launch_plan.rig_parameters({"rig.modbus.port": port}) as rig:
        assert rig["rig.modbus.port"] == port
        with (
            pytest.raises(ValueError, match="listens there already"),
            launch_plan.rig_parameters({"rig.modbus.port": port}),
        ):
            pass
