# SPDX-License-Identifier: Apache-2.0
"""What a recording of our own brings along: settings, depths and decisions; and tables of depths."""

import dataclasses
import functools
import math
import tempfile
from pathlib import Path

import plotted_bag
import pytest

from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.survey import Verdict
from mwd_sensors.core import settings, wire
from mwd_sensors.core.earth import grid_convergence
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.processing import process
from mwd_surface.processing.bag_input import InputSettings
from mwd_surface.processing.list_builder import ListBuilder
from mwd_surface.surveys import message_conversion
from mwd_surface.surveys.depth_table import read_depths
from mwd_surface.surveys.recorded_settings import ESTIMATOR, SURFACE, SurfacePart, recorded_settings
from mwd_surface.trajectory.plan import plan_of

LIST = "mwd_msgs/msg/SurveyList"
IN_FORCE = settings.changed(
    EstimatorSettings(),
    {
        "gravity.method": "s3",
        "place.field": "model",
        "place.lat_deg": 38.3,
        "place.lon_deg": 109.6,
        "place.height_m": 1150.0,
        "place.date": "2026-03-01",
        "tool.gyro.range_deg_s": (500.0, 500.0, 500.0),
    },
)
SHOWN = settings.changed(SurfacePart(), {"well.name": "Alpha", "well.sensor_to_bit": 12.0, "leg.tool": "T-7"})


def texts(made, **more):
    return {name: str(value) for name, (value, _) in settings.flat(made).items()} | more


@functools.cache
def still():
    """The messages of a still tool for 20 s, 500 m at the bit, and when its recording ended."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bag"
        plotted_bag.record(path, ("imu/data_raw", "imu/mag", "rig/state"), estimate=False, surveys=False, text=STILL)
        with Bag(path) as bag:
            return list(bag.messages(list(bag.topics))), bag.end_ns


def raw(path, metadata=True, surveys=None):
    """A recording of the still tool, with what the surface node adds."""
    messages, end_ns = still()
    with BagWriter(path) as out:
        channels = {name: out.topic(name, type_name) for _, name, type_name, _ in messages}
        for log_ns, name, _, data in messages:
            out.write(channels[name], data, log_ns, log_ns)
        if not metadata:
            return path
        out.add_metadata(ESTIMATOR, texts(IN_FORCE, use_sim_time="False"))
        out.add_metadata(SURFACE, texts(SHOWN, **{"page.port": "8080", "folder": "x"}))
        if surveys is not None:
            out.definitions.load(LIST)
            table = message_conversion.list_message(surveys, "wellhead", out.definitions.make)
            data = bytes(out.definitions.typestore.serialize_cdr(table, LIST))
            out.write(out.topic("/w1/surveys", LIST), data, end_ns, end_ns)
    return path


STILL = """
name: still
well: {stations: [[0.0, 40.0, 70.0]], bit_m: 500.0}
schedule: [{kind: still, seconds: 20.0}]
"""


def processed(path, out, **given):
    with Bag(path) as bag:
        recorded = recorded_settings(bag)
        estimator = recorded.estimator or IN_FORCE
        return process.process(bag, out, estimator, InputSettings(**given), recorded=recorded)


@pytest.fixture(scope="module")
def live(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own")
    return processed(raw(folder / "bag"), folder / "out").listed


@pytest.mark.slow
def test_the_settings_of_a_recording_are_read_back_and_strange_ones_are_named(tmp_path):
    with Bag(raw(tmp_path / "bag")) as bag:
        recorded = recorded_settings(bag)
        metadata = bag.metadata()
    assert (recorded.estimator, recorded.surface, recorded.remarks) == (IN_FORCE, SHOWN, ())

    class Older:
        topics = {}  # noqa: RUF012

        def metadata(self):
            return metadata | {ESTIMATOR: metadata[ESTIMATOR] | {"fusion.sigmas": "3.0"}}

    older = recorded_settings(Older())
    assert older.estimator == IN_FORCE
    assert "fusion.sigmas = 3.0 of the recording is not used" in older.remarks[0]


def test_a_recording_of_our_own_brings_well_tool_and_sensor_to_bit(live):
    (record,) = live.records
    # The surface was told no place: that of the estimator counts.
    assert live.well == dataclasses.replace(SHOWN.well, latitude_deg=38.3, longitude_deg=109.6)
    assert (record.measured_depth, record.tool) == (488.0, "T-7")


def test_a_grid_given_by_option_is_that_of_the_list(tmp_path, live):
    with Bag(raw(tmp_path / "bag")) as bag:
        gridded = settings.changed(IN_FORCE, {"place.grid": "EPSG:32649"})
        found = process.process(bag, tmp_path / "out", gridded, recorded=recorded_settings(bag)).listed
    assert (live.well.north_reference, live.well.grid) == ("true", "")
    assert (found.well.north_reference, found.well.grid) == ("grid", "EPSG:32649")
    (record,), (before,) = found.records, live.records
    convergence = grid_convergence(math.radians(38.3), math.radians(109.6), "EPSG:32649")
    assert abs(convergence) > 0.01
    assert math.remainder(record.survey.azimuth + convergence - before.survey.azimuth, math.tau) == pytest.approx(
        0.0, abs=1e-6
    )


@pytest.mark.slow
def test_depth_and_decision_of_the_live_list_are_kept(live, tmp_path):
    (record,) = live.records
    judged = live.accept(record.survey.sequence, "Ann", "gyro agrees", record.survey.stamp_ns + 1, measured_depth=480.5)
    again = processed(raw(tmp_path / "bag", surveys=judged), tmp_path / "out")
    assert again.listed == judged
    assert again.live == "1 of 1 surveys equal those of the live list"
    assert again.depths == "from the live list"
    # The plan of the live list, and with it the vertical section, is found again.
    along = judged.along(plan_of([0.0, 300.0, 900.0], [0.0, 0.0, 0.7], [0.8, 0.8, 0.9], name="plan B"))
    assert along.records != judged.records
    planned = processed(raw(tmp_path / "bag_1", surveys=along), tmp_path / "out_1")
    assert planned.listed == along
    assert planned.live == "1 of 1 surveys equal those of the live list"
    # Another distance to the bit is another depth, from the data of the rig.
    other = processed(raw(tmp_path / "bag_2", surveys=judged), tmp_path / "out_2", sensor_to_bit_m=10.0)
    assert other.surveys[0][1] == 490.0
    (changed,) = other.listed.records
    assert (changed.measured_depth, changed.operator_name, changed.comment) == (490.0, "Ann", "")


def test_what_the_whole_run_says_stands_in_a_list_without_a_live_one(tmp_path, live):
    with Bag(raw(tmp_path / "bag")) as bag:
        summary = process.process(bag, tmp_path / "out", IN_FORCE, recorded=recorded_settings(bag))
        builder = ListBuilder(bag, summary.topics, IN_FORCE, InputSettings(), recorded_settings(bag), "sonde_link")
        ((survey, _),) = summary.surveys
        builder.add(survey)
        doubted = dataclasses.replace(survey.station, verdict="doubtful")
        listed, _ = builder.finish([dataclasses.replace(survey, station=doubted, revision=1)])
    (record,) = listed.records
    assert record.survey.uuid == live.records[0].survey.uuid
    assert (record.survey.verdict, record.as_first_decided.verdict) == (Verdict.DOUBTFUL, Verdict.ACCEPT)
    assert not record.in_use


@pytest.mark.slow
def test_surveys_of_earlier_recordings_stay_in_the_list(live, tmp_path):
    (record,) = live.records
    early = dataclasses.replace(
        record.survey, uuid="of yesterday", sequence=7, stamp_ns=record.survey.stamp_ns - 10**13
    )
    longer = live.add(early, 300.0, 0.0, tool="T-6")
    again = processed(raw(tmp_path / "bag", surveys=longer), tmp_path / "out")
    assert [r.survey.uuid for r in again.listed.records] == ["of yesterday", record.survey.uuid]
    assert again.listed == longer


@pytest.mark.slow
def test_a_rig_whose_clock_is_wrong_gives_no_depth_and_is_named(tmp_path):
    bag = raw(tmp_path / "bag", metadata=False)
    with Bag(bag) as source, BagWriter(tmp_path / "shifted") as out:
        (rig,) = (name for name in source.topics if name.endswith("rig/state"))
        channels = {name: out.topic(name, topic.type_name) for name, topic in source.topics.items()}
        for log_ns, name, _, data in source.messages([name for name in channels if name != rig]):
            out.write(channels[name], data, log_ns, log_ns)
        for block in source.blocks([rig]):
            log_ns, rows = block[rig]
            rows["stamp_ns"] += 300 * 10**9
            for at, row in zip(log_ns, wire.RIG_STATE.encode(rows, "rig_floor"), strict=True):
                out.write(channels[rig], bytes(row), int(at), int(at))
    summary = processed(tmp_path / "shifted", tmp_path / "out")
    assert math.isnan(summary.surveys[0][1])
    assert "the clock of the rig is 300 s ahead of that of the sonde" in summary.listed.records[0].comment


@pytest.mark.slow
def test_depths_come_from_a_table_by_time_or_number(tmp_path, live):
    bag = raw(tmp_path / "bag", metadata=False)
    stamp = live.records[0].survey.stamp_ns
    table = tmp_path / "depths.csv"
    for text, depth in (
        (f"stamp_ns,bit_depth_m\n{stamp - 10**9},400\n{stamp + 10**9},402\n", 391.0),
        (f"stamp_ns,md_ft\n{stamp - 10**9},1000\n{stamp + 10**9},1000\n", 304.8),
        ("survey,md_m\n1,123.4\n", 123.4),
        ("survey,md_m\n2,123.4\n", math.nan),
        (f"stamp_ns,bit_depth_m\n{stamp + 10**9},400\n{stamp + 2 * 10**9},402\n", math.nan),
    ):
        table.write_text(text)
        summary = processed(bag, tmp_path / "out", depths=str(table), sensor_to_bit_m=10.0)
        assert summary.surveys[0][1] == pytest.approx(depth, nan_ok=True)
        assert summary.depths == f"from the table {table}"
        assert summary.depth_table
        assert bool(summary.listed.records[0].comment) == math.isnan(depth)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("time,depth\n2026-03-01T00:00:00,1\n", "md .* has no unit"),
        ("time,tvd_m\n2026-03-01T00:00:00,1\n", "no column of depths; expected bit_depth_m or md_m"),
        ("when,md_m\n1,1\n", "no column time or survey"),
        ("time,md_m\nnoon,1\n", "expected a time such as"),
        ("survey,bit_depth_m\n1,1\n", "name the column md_m"),
        ("survey,md_m\n1,deep\n", "row 1: expected a number, got 'deep'"),
        ("stamp_ns,md_m\n2,1\n1,1\n", "do not increase"),
    ],
)
def test_a_table_of_depths_that_cannot_be_used_says_why(tmp_path, text, says):
    (tmp_path / "depths.csv").write_text(text)
    with pytest.raises(ListFileError, match=says):
        read_depths(tmp_path / "depths.csv")
