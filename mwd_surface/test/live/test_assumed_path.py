# SPDX-License-Identifier: Apache-2.0
"""An alarm of an assumed path ends when one does what its remedy says."""

import dataclasses
import re

import example_surveys as example
import pytest
from typer.testing import CliRunner

from mwd_surface.cli import app
from mwd_surface.list_files.remark import Remark, RemarkKind
from mwd_surface.live.alarms import AlarmLog
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.plan_monitor import PlanMonitor
from mwd_surface.live.survey_book import SurveyBook
from mwd_surface.live.well_clock import WellClock
from mwd_surface.live.well_context import WellContext
from mwd_surface.surveys.depth import DepthRules
from mwd_surface.surveys.leg_settings import LegSettings, arranged
from mwd_surface.surveys.list_rules import ListRules
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_store import SurveyStore
from mwd_surface.surveys.well import Well

# Lists of stations, each with one thing that its reader must assume, and the words that stand for a choice.
LISTS = {
    RemarkKind.NORTH_ASSUMED: "MD (m);Inc (deg);Azi (deg)\n0;0;0\n30;2;20\n60;3;21\n",
    RemarkKind.UNIT_ASSUMED: "MD (ft);Inc (deg);Azi_grid (deg);TVD\n0;0;0;0\n100;2;20;99.97\n200;3;21;199.87\n",
    RemarkKind.NUMBERS_ASSUMED: "MD (m);Inc (deg);Azi_grid (deg)\n0;0;0\n1.030;2;20\n",
}
CHOICES = {"--north NORTH": "--north grid", "--length-unit UNIT": "--length-unit ft", "--angle-unit UNIT": ""}


def alarms_of(surveys):
    """The alarms about assumptions, by kind."""
    clock = WellClock(example.MADE)
    log = AlarmLog(lambda: clock.now_ns)
    context = WellContext(clock, LiveState(), log)
    SurveyBook(context, PlanMonitor(context), surveys, DepthRules()).show()
    prefix = "path.assumed."
    return {one.id.removeprefix(prefix): one for one in log.alarms() if one.id.startswith(prefix) and one.active}


def station(depth):
    """A list with one station at a depth."""
    return SurveyList(well=example.WELL).add(example.survey(1, 40.0, 40.0), depth, 1.0)


@pytest.mark.parametrize(
    ("kind", "surveys"),
    [
        (RemarkKind.HOLE_ABOVE_ASSUMED, station(2500.0)),
        (
            RemarkKind.TIE_ON_ASSUMED,
            arranged(station(2500.0), LegSettings(tie_on_depth=2400.0, tie_on_inclination_deg=39.0)),
        ),
    ],
)
def test_the_settings_that_the_remedy_names_end_the_alarm(kind, surveys):
    (alarm,) = alarms_of(surveys).values()
    assert alarm.id == f"path.assumed.{kind}"
    named = dict.fromkeys(re.findall(r"leg\.(\w+)", alarm.remedy), 40.0)
    assert not alarms_of(arranged(surveys, LegSettings(**{**named, "tie_on_depth": 2400.0})))
    # Each of them is needed: without its position a tie-on is assumed.
    for left_out in (name for name in named if dataclasses.asdict(LegSettings())[name] is None):
        some = {**named, "tie_on_depth": 2400.0, left_out: None}
        assert alarms_of(arranged(surveys, LegSettings(**some)))


@pytest.mark.slow
@pytest.mark.parametrize("kind", LISTS)
def test_the_command_that_the_remedy_names_ends_the_alarm(kind, tmp_path):
    source = tmp_path / "list.csv"
    source.write_text(LISTS[kind])

    def read(command):
        for word, choice in {**CHOICES, "LIST": str(source), "DIR": str(tmp_path / "out")}.items():
            command = command.replace(word, choice)
        done = CliRunner(env={"COLUMNS": "200"}).invoke(app, command.split()[1:])
        assert done.exit_code == 0, done.output
        store = SurveyStore(tmp_path / "out")
        surveys = store.load(Well(north_reference="grid"), ListRules()).surveys
        store.close()
        return surveys

    alarm = alarms_of(read("mwd path LIST -o DIR"))[kind]
    command = re.search(r"`(mwd path [^`]+)`", alarm.remedy)[1]
    assert kind not in alarms_of(read(command))


def test_every_assumption_of_a_kind_is_in_its_alarm():
    remarks = tuple(Remark(RemarkKind.UNIT_ASSUMED, text) for text in ("one length", "another length"))
    surveys = dataclasses.replace(example.surveys(), remarks=remarks)
    (alarm,) = alarms_of(surveys).values()
    assert all(one.text in alarm.text for one in remarks)
