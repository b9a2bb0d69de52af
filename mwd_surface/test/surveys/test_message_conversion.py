# SPDX-License-Identifier: Apache-2.0
"""Messages and records hold the same: every field there and back, with the real messages."""

import dataclasses
import math

import example_surveys as example
import pytest

from mwd_surface.list_files.remark import Remark, RemarkKind
from mwd_surface.surveys import message_conversion as between
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import AzimuthEstimate, Survey, SurveyRecord
from mwd_surface.surveys.survey_store import decoded, encoded
from mwd_surface.trajectory.plan import plan_of

msg = pytest.importorskip("mwd_msgs.msg", reason="mwd_msgs is not built")
if not hasattr(msg, "Survey"):
    # From the root of the sources the folder of the .msg files passes for a package.
    pytest.skip("mwd_msgs is not built", allow_module_level=True)


@pytest.mark.parametrize(
    ("kind", "message", "own"),
    [
        (Survey, msg.Survey, {"stamp_ns", "frame_id"}),
        (SurveyRecord, msg.SurveyRecord, {"judged_ns", "decisions", "decided_revision"}),
        (AzimuthEstimate, msg.AzimuthEstimate, set()),
    ],
)
def test_every_field_of_the_message_has_its_name_here(kind, message, own):
    ours = {f.name for f in dataclasses.fields(kind)} - own
    theirs = set(message.get_fields_and_field_types()) - {"header", "judged"}
    assert ours == theirs


@pytest.mark.parametrize("record", example.surveys().records, ids=lambda r: f"survey {r.survey.sequence}")
def test_a_record_goes_there_and_back_unchanged(record):
    message = msg.SurveyRecord()
    between.fill_record(message, record, msg.AzimuthEstimate)
    assert between.record_of(message) == record


def test_what_comes_from_a_message_is_accepted_by_the_list():
    message = msg.Survey()
    between.fill_survey(message, example.survey(3, 12.0, 80.0), msg.AzimuthEstimate)
    whole = SurveyList(well=example.WELL).add(between.survey_of(message), 100.0, 0.1)
    assert whole.find(3).in_use


def test_the_list_message_is_stamped_by_its_last_change():
    whole, message = example.surveys(), msg.SurveyList()
    between.fill_list(message, whole, msg.SurveyRecord, msg.AzimuthEstimate, msg.Leg, msg.Remark)
    assert between.stamp_of(message.header.stamp) == whole.changed_ns
    assert (message.well, len(message.records)) == ("Åsgard Ω-1", 12)
    assert [between.record_of(r) for r in message.records] == list(whole.records)


def test_a_list_of_a_message_has_the_remarks_of_list_and_plan():
    remark = Remark(RemarkKind.NORTH_ASSUMED, "a.csv does not say its north", {"measured_depth": 3.5})
    plan = dataclasses.replace(plan_of([0.0, 600.0], [0.0, 0.3], [1.3, 1.3]), remarks=(remark,))
    whole, message = dataclasses.replace(example.surveys(), plan=plan, remarks=(remark,)), msg.SurveyList()
    between.fill_list(message, whole, msg.SurveyRecord, msg.AzimuthEstimate, msg.Leg, msg.Remark)
    again = between.list_of(message, whole.well, whole.rules)
    assert (again.remarks, again.plan.remarks) == ((remark,), (remark,))
    assert again.definitive().assumptions == whole.definitive().assumptions != ()


def test_the_trajectory_message_carries_the_path_and_its_projection():
    path, message = example.surveys().definitive(bit_depth=650.0), msg.Trajectory()
    between.fill_trajectory(message, path, 5)
    assert message.last_is_projected
    assert list(message.measured_depth) == path.md.tolist()
    assert list(message.vertical_depth) == path.positions[:, 2].tolist()
    assert message.north_reference == 3


def test_an_unknown_number_is_nan_on_the_message_and_null_in_a_file():
    bare = Survey(stamp_ns=1, uuid="u", sequence=1, inclination=0.1, azimuth=math.nan, north=0)
    message = msg.Survey()
    between.fill_survey(message, bare, msg.AzimuthEstimate)
    assert between.survey_of(message) == bare
    numbers = [field.name for field in dataclasses.fields(Survey) if "Number" in str(field.type)]
    assert len(numbers) == 20
    assert all(math.isnan(getattr(message, name)) for name in numbers)
    whole = SurveyList(well=example.WELL).add(bare)
    assert decoded(encoded(whole)) == whole
    assert b"NaN" not in encoded(whole)
