# SPDX-License-Identifier: Apache-2.0
"""A question of the reader is answered by the same word wherever a list is named, and the message says how."""

import dataclasses

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from mwd_estimation.core.north import North
from mwd_surface.clearance.offset_wells import OffsetWellError, offset_well, read_offset_wells
from mwd_surface.cli import app
from mwd_surface.commands.shared_options import LIST
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.list_settings import NODE, ListSettings, asked
from mwd_surface.live.plan_monitor import PlanMonitor
from mwd_surface.live.settings import PlanSettings
from mwd_surface.surveys.well import Well
from mwd_surface.uncertainty.error_terms import ErrorReference

REFERENCE = ErrorReference(1.0, 5e-5, 1.25, 0.02, 0.01, 9.81)
OWN = "md_m,inc_deg,azi_grid_deg\n0,0,0\n300,0,0\n330,3,79\n"
MAP = (
    "md_m,inc_deg,azi_grid_deg,tvd_m,northing_m,easting_m\n"
    "1000,30,90,950,6478300,431400\n1030,30,90,975.98,6478300,431415\n"
)
# Lists that raise a question, and the word that answers it.
LISTS = {
    "dogleg": ("md_m,inc_deg,azi_grid_deg\n0,0,0\n300,0,0\n330,40,79\n", {"confirm": "dogleg"}),
    "far wellhead": (MAP, {"wellhead": "6400000,431200", "confirm": "wellhead"}),
    "map": (MAP, {"wellhead": "6478300,431200"}),
    "unit": ("md,inc_deg,azi_grid_deg\n0,0,0\n300,0,0\n330,3,79\n", {"length_unit": "m"}),
    "dip": ("md_m,dip,azi_grid_deg\n0,90,0\n300,90,0\n330,87,79\n", {"dip": "down"}),
    "decimal": ("md_m\tinc\tazi_grid\n1,000\t0\t0\n2,000\t3\t79\n3,000\t3\t79\n", {"decimal": "point"}),
    "columns": (
        "d,i,a\n0,0,0\n300,0,0\n330,3,79\n",
        {"columns": "md=d,inc=i,azi=a", "length_unit": "m", "north": "grid"},
    ),
}
FIELD = ["--field", "50000,72,-1", "--convergence", "0.5"]


def run(*arguments):
    return CliRunner().invoke(app, [str(one) for one in arguments])


def said(words, option):
    """Words as a command takes them: each as an option of its own, or as NAME=VALUE behind one."""
    if option:
        return [part for name, value in words.items() for part in (option, f"{name}={value}")]
    return [part for name, value in words.items() for part in (f"--{name.replace('_', '-')}", value)]


def test_the_words_of_commands_node_and_offset_wells_are_the_same():
    names = set(LIST.options)
    assert {field.name for field in dataclasses.fields(ListSettings)} == names
    assert names <= {field.name for field in dataclasses.fields(PlanSettings)}


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """A list, and the results of `mwd path` for it."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "own.csv").write_text(OWN)
    assert run("path", folder / "own.csv", "-o", folder / "path").exit_code == 0
    return folder / "own.csv", folder / "path"


# Commands that name a list, without the words of it, and the option before these words.
COMMANDS = {
    "path": (("path", "x.csv", "-o", "a"), ""),
    "forecast": (("forecast", "x.csv", "-o", "b", *FIELD), ""),
    "plan": (("export", "{path}", "-f", "csv", "-o", "c.csv", "--plan", "x.csv"), "--plan-set"),
    "against": (("path", "{own}", "-o", "d", "--against", "x.csv"), "--against-set"),
}
# In the gate each list with one command, and each command with a list that needs no word, one word and several; of a
# forecast, which computes for seconds, the one word.
FEW = ("plain", "unit", "columns")


def is_nightly(name, command):
    return command != "plan" and (name not in FEW or (command == "forecast" and name != "unit"))


@pytest.mark.slow(0.3)
@pytest.mark.parametrize(
    ("name", "command"),
    [
        pytest.param(name, command, marks=pytest.mark.nightly if is_nightly(name, command) else ())
        for name in (*LISTS, "plain")
        for command in COMMANDS
    ],
)
def test_every_command_that_names_a_list_asks_and_takes_the_answer(name, command, own, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text, words = LISTS.get(name, (OWN, {}))
    (tmp_path / "x.csv").write_text(text)
    given, option = COMMANDS[command]
    given = [word.format(own=own[0], path=own[1]) for word in given]
    answered = run(*given, *said(words, option))
    if name in ("map", "far wellhead") and command == "against":
        # It begins below the end of the other list.
        assert "no depth in common" in str(answered.exception)
    else:
        assert answered.exit_code == 0, (answered.output, answered.exception)
    if words:
        refused = run(*given)
        assert refused.exit_code != 0
        named = [f"{option} {word}=" if option else f"--{word.replace('_', '-')}" for word in words]
        assert any(word in str(refused.exception) for word in named), refused.exception


@pytest.mark.parametrize("name", LISTS)
def test_plan_of_the_node_and_offset_well_take_the_same_words(name, tmp_path):
    text, words = LISTS[name]
    (tmp_path / "x.csv").write_text(text)
    well = Well(north_reference="grid")
    assert isinstance(PlanMonitor.read(PlanSettings(file=str(tmp_path / "x.csv")), well), ListFileError)
    plan = PlanMonitor.read(PlanSettings(file=str(tmp_path / "x.csv"), **{"north": "grid", **words}), well)
    entry = {"name": "X", "file": "x.csv"}
    (tmp_path / "wells.yaml").write_text(
        yaml.safe_dump({"wells": [entry, {**entry, "name": "Y", "north": "grid", **words}]})
    )
    without, with_words = read_offset_wells(tmp_path / "wells.yaml").wells
    with pytest.raises(OffsetWellError):
        offset_well(without, tmp_path, North.GRID, REFERENCE)
    if name != "far wellhead":
        got = offset_well(with_words, tmp_path, North.GRID, REFERENCE)
        np.testing.assert_allclose(got.positions, plan.positions, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("confirm it with --confirm dogleg", "confirm it with plan.confirm=dogleg"),
        ("set it with --decimal point or --decimal comma", "set it with plan.decimal=point or plan.decimal=comma"),
        ("set them with --north and --angle-unit", "set them with plan.north=... and plan.angle_unit=..."),
        ("leave one out with --columns map_north=,map_east=", "leave one out with plan.columns=map_north=,map_east="),
        ("or --columns md=NAME,inclination=NAME; got", "or plan.columns=md=NAME,inclination=NAME; got"),
    ],
)
def test_an_option_in_a_message_is_written_as_the_caller_can_give_it(text, written):
    assert str(asked(ListFileError(text), NODE)) == written
