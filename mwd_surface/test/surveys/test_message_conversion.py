# SPDX-License-Identifier: Apache-2.0
"""Messages and records hold the same: every field there and back, with the real messages."""

import dataclasses
import math

import example_surveys as example
import pytest

from mwd_estimation.survey.survey import AzimuthEstimate, Survey
from mwd_sensors.core.message_record import stamp_of
from mwd_surface.list_files.remark import Remark, RemarkKind
from mwd_surface.surveys import message_conversion as between
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import SurveyRecord
from mwd_surface.surveys.survey_store import decoded, encoded
from mwd_surface.trajectory.plan import plan_of

msg = pytest.importorskip("mwd_msgs.msg", reason="mwd_msgs is not built")
if not hasattr(msg, "Survey"):
    # From the root of the sources the folder of the .msg files passes for a package.
    pytest.skip("mwd_msgs is not built", allow_module_level=True)
pytest.importorskip("rclpy")
from mwd_sensors.ros.messages import make  # noqa: E402 needs ROS


@pytest.mark.parametrize("kind", [Survey, SurveyRecord, AzimuthEstimate])
def test_every_field_of_the_message_has_its_name_here(kind):
    ours = {f.name for f in dataclasses.fields(kind)} - kind.NOT_SENT - {"stamp_ns", "frame_id"}
    message = getattr(msg, kind.MESSAGE.rpartition("/")[2])
    theirs = set(message.get_fields_and_field_types()) - {"header"}
    assert {name.removesuffix("_ns") for name in ours} == theirs


@pytest.mark.parametrize("record", example.surveys().records, ids=lambda r: f"survey {r.survey.sequence}")
def test_a_record_goes_there_and_back_unchanged(record):
    assert between.record_of(record.to_message(make)) == record


def test_what_comes_from_a_message_is_accepted_by_the_list():
    message = example.survey(3, 12.0, 80.0).to_message(make)
    whole = SurveyList(well=example.WELL).add(Survey.from_message(message), 100.0, 0.1)
    assert whole.find(3).in_use


def test_the_list_message_is_stamped_by_its_last_change():
    whole = example.surveys()
    message = between.list_message(whole, "wellhead", make)
    assert stamp_of(message.header.stamp) == whole.changed_ns
    assert (message.well, len(message.records)) == ("Åsgard Ω-1", 12)
    assert [between.record_of(r) for r in message.records] == list(whole.records)


def test_a_list_of_a_message_has_the_remarks_of_list_and_plan():
    remark = Remark(RemarkKind.NORTH_ASSUMED, "a.csv does not say its north", {"measured_depth": 3.5})
    plan = dataclasses.replace(plan_of([0.0, 600.0], [0.0, 0.3], [1.3, 1.3]), remarks=(remark,))
    whole = dataclasses.replace(example.surveys(), plan=plan, remarks=(remark,))
    again = between.list_of(between.list_message(whole, "wellhead", make), whole.well, whole.rules)
    assert (again.remarks, again.plan.remarks) == ((remark,), (remark,))
    assert again.definitive().assumptions == whole.definitive().assumptions != ()


def test_the_trajectory_message_carries_the_path_and_its_projection():
    path = example.surveys().definitive(bit_depth=650.0)
    message = between.trajectory_message(path, 5, "wellhead", make)
    assert message.last_is_projected
    assert list(message.measured_depth) == path.md.tolist()
    assert list(message.vertical_depth) == path.positions[:, 2].tolist()
    assert message.north_reference == 3


def test_an_unknown_number_is_nan_on_the_message_and_null_in_a_file():
    bare = Survey(stamp_ns=1, uuid="u", sequence=1, inclination=0.1, azimuth=math.nan, north=0)
    message = bare.to_message(make)
    assert Survey.from_message(message) == bare
    numbers = [field.name for field in dataclasses.fields(Survey) if "Number" in str(field.type)]
    assert len(numbers) >= 20
    assert all(math.isnan(getattr(message, name)) for name in numbers)
    whole = SurveyList(well=example.WELL).add(bare)
    assert decoded(encoded(whole)) == whole
    assert b"NaN" not in encoded(whole)
