# SPDX-License-Identifier: Apache-2.0
"""The survey list: its order, its two judgements, its legs and its path."""

import contextlib
import dataclasses
import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.core.north import North
from mwd_estimation.survey.survey import Survey, Verdict
from mwd_sensors.core import minimum_curvature as mc
from mwd_surface.surveys.leg import Leg, Origin, TieOn
from mwd_surface.surveys.list_rules import ListRules
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import Judgement, Value
from mwd_surface.surveys.well import Well

COVARIANCE = (1e-6, 0.0, 0.0, 0.0, 1e-4, 0.0, 0.0, 0.0, 1e-6)
S = 10**9


def shot(sequence, inc_deg=10.0, azi_deg=40.0, **changes):
    values = {
        "stamp_ns": sequence * 600 * S,
        "uuid": f"uuid-{sequence}",
        "sequence": sequence,
        "inclination": math.radians(inc_deg),
        "azimuth": math.radians(azi_deg),
        "north": int(North.TRUE),
        "covariance": COVARIANCE,
        "b_reference": 5e-5,
        "declination": 0.0,
        "convergence": 0.0,
    }
    return Survey(**{**values, **changes})


VERTICAL = (Leg(tie_on=TieOn.given(0.0, 0.0, 0.0)),)  # a person confirms that the hole above is vertical


def filled(*stations, **kwargs):
    whole = SurveyList(legs=VERTICAL, **kwargs)
    for k, (md, inc, azi) in enumerate(stations, start=1):
        whole = whole.add(shot(k, inc, azi), md, 0.0)
    return whole


CURVE = ((100.0, 0.5, 10.0), (130.0, 3.0, 30.0), (160.0, 6.0, 35.0), (190.0, 10.0, 40.0))


def flags(whole, sequence):
    return whole.find(sequence).flags


def test_accepted_surveys_make_the_path_of_minimum_curvature():
    whole = filled(*CURVE, well=Well(section_azimuth_deg=35.0))
    md, inc, azi = (np.array(c) for c in zip((0.0, 0.0, 0.0), *CURVE, strict=True))
    inc, azi = np.radians(inc), np.radians(azi)
    want = mc.path(md, inc, azi)
    path = whole.definitive()
    np.testing.assert_allclose(path.positions, want, atol=1e-12)
    last = whole.find(4)
    assert (last.north, last.east, last.vertical_depth) == pytest.approx(tuple(want[-1]))
    assert last.vertical_section == pytest.approx(
        math.hypot(*want[-1, :2]) * math.cos(math.atan2(want[-1, 1], want[-1, 0]) - math.radians(35))
    )
    assert last.dogleg_severity * 30 == pytest.approx(mc.dogleg_severity(md, inc, azi)[-1])
    assert path.kind == ("tie-on", "survey", "survey", "survey", "survey")
    assert all(r.in_use and not r.flags for r in whole.records)


@pytest.mark.fault_case(54)
def test_a_survey_that_comes_twice_is_one_survey():
    whole = filled(*CURVE)
    assert whole.add(shot(2, 80.0), 500.0, 0.0) is whole


def test_a_tool_that_lost_its_count_gets_the_next_free_number():
    whole = filled(*CURVE).add(shot(1, 12.0, uuid="after the restart"), 220.0, 0.0)
    assert whole.find(5).comment == "numbered 1 by the tool"
    assert whole.find(5).in_use


def test_a_doubtful_or_rejected_survey_waits_for_a_person_and_both_judgements_are_kept():
    doubtful = shot(5, 12.0, verdict=int(Verdict.REJECT), reasons=("dip +6.4 deg over 0.45",))
    whole = filled(*CURVE).add(doubtful, 220.0, 0.0)
    assert not whole.find(5).in_use
    whole = whole.accept(5, "Aslaug", "casing collar, gyro agrees", 77)
    record = whole.find(5)
    assert record.in_use
    assert record.survey.verdict == Verdict.REJECT
    assert (record.judgement, record.operator_name, record.judged_ns) == (Judgement.ACCEPTED, "Aslaug", 77)
    assert flags(whole, 5) == ("accepted by Aslaug against the automatic verdict reject",)
    whole = whole.reject(5, "Bo", "second thoughts", 88)
    assert not whole.find(5).in_use
    kept = [(one.judgement, one.operator_name, one.reason, one.stamp_ns) for one in whole.find(5).decisions]
    assert kept == [
        (Judgement.ACCEPTED, "Aslaug", "casing collar, gyro agrees", 77),
        (Judgement.REJECTED, "Bo", "second thoughts", 88),
    ]
    assert whole.definitive().md[-1] == 190.0
    assert SurveyList.from_mapping(whole.to_mapping()) == whole


ASK = ListRules(apply_revisions="ask")


def revisions():
    """A revision of survey 2 by 8 deg that stays accepted, one that makes it doubtful, and its first value again."""
    moved = dataclasses.replace(shot(2, 3.0, 48.0), revision=1)
    doubtful = dataclasses.replace(moved, verdict=int(Verdict.DOUBTFUL), headline="steel", revision=2)
    return moved, doubtful, dataclasses.replace(filled(*CURVE).find(2).survey, revision=3)


def test_a_revision_becomes_the_definitive_value_and_the_first_stays_to_be_seen():
    whole = filled(*CURVE)
    first = whole.find(2).survey
    moved, doubtful, back = revisions()
    revised = whole.revise(moved)
    assert (revised.find(2).survey, revised.find(2).as_first_decided) == (moved, first)
    assert revised.find(2).in_use
    assert abs(revised.definitive().positions[-1] - whole.definitive().positions[-1]).max() > 0.1
    assert flags(revised, 2) == ("revised by later surveys; first value: azimuth 30.00 ±0.57 deg (accept)",)
    assert revised.revise(moved) is revised
    assert revised.revise(dataclasses.replace(moved, uuid="of another list", revision=2)) is revised
    # A station that a revision makes doubtful leaves the path until a person accepts it.
    out = revised.revise(doubtful)
    assert (out.find(2).in_use, out.find(2).as_first_decided) == (False, first)
    assert out.accept(2, "Ann", "gyro agrees", 5).find(2).in_use
    assert revised.as_first_decided() == whole
    assert out.as_first_decided() == whole
    # One that is as at first again is not a revised one.
    again = out.revise(back)
    assert again.find(2).in_use
    assert again.find(2).replaced is None
    assert flags(again, 2) == flags(whole, 2)
    assert SurveyList.from_mapping(revised.to_mapping()).find(2) == revised.find(2)


def test_what_a_person_decided_is_definitive_until_a_person_decides_again():
    moved, doubtful, _ = revisions()
    whole = filled(*CURVE)
    first = whole.find(2).survey
    by_hand = whole.accept(2, "Ann", "checked", 5).revise(moved)
    assert (by_hand.find(2).survey, by_hand.find(2).proposal) == (first, moved)
    np.testing.assert_array_equal(by_hand.definitive().positions, whole.definitive().positions)
    taken = by_hand.accept(2, "Ann", "the run is right", 6, value=Value.REVISED)
    assert (taken.find(2).survey, taken.find(2).as_first_decided, taken.find(2).proposal) == (moved, first, None)
    # The next revision asks again, and the first value can be had back.
    later = taken.revise(doubtful)
    assert (later.find(2).survey, later.find(2).proposal) == (moved, doubtful)
    back = later.accept(2, "Bo", "the first was right", 7, value=Value.FIRST)
    assert (back.find(2).survey, back.find(2).proposal) == (first, doubtful)
    assert [one.operator_name for one in back.find(2).decisions] == ["Ann", "Ann", "Bo"]
    with pytest.raises(ValueError, match="no revised value"):
        whole.accept(2, "Ann", "", 5, value=Value.REVISED)


def test_the_rules_can_leave_every_revision_to_a_person_but_for_one_that_withdraws():
    moved, _, _ = revisions()
    whole = filled(*CURVE)
    whole = whole.configured(whole.well, ASK)
    waiting = whole.revise(moved)
    assert (waiting.find(2).survey, waiting.find(2).proposal) == (whole.find(2).survey, moved)
    assert waiting.accept(2, "Ann", "", 5, value=Value.REVISED).find(2).survey == moved
    gone = dataclasses.replace(moved, withdrawn=True, verdict=int(Verdict.REJECT), headline="mount", revision=2)
    assert not waiting.revise(gone).find(2).in_use


def test_a_judgement_of_a_survey_that_is_not_there_is_refused():
    whole = filled(*CURVE)
    with pytest.raises(ValueError, match=r"survey 9 is not in the list; the last are \[1, 2, 3, 4\]"):
        whole.reject(9, "Bo", "", 0)
    with pytest.raises(ValueError, match="it is empty"):
        SurveyList().find(1)


@pytest.mark.parametrize("name", ["A\ud800", "A\nB", " "])
def test_a_name_that_no_file_can_hold_is_refused_before_anything_changes(name):
    for judge in (filled(*CURVE).reject, filled(*CURVE).accept):
        with pytest.raises(ValueError, match="operator_name"):
            judge(1, name, "", 5)


@pytest.mark.fault_case(39)
def test_a_duplicate_depth_is_replaced_only_by_explicit_accept():
    whole = filled(*CURVE).add(shot(5, 10.2), 190.2, 0.0)
    assert not whole.find(5).in_use
    assert flags(whole, 5) == ("duplicate depth: survey 4 is at 190.00 m",)
    with pytest.raises(ValueError, match=r"needs an explicit replacement: duplicate depth: survey 4 .* replace=true"):
        whole.accept(5, "Aslaug", "", 1)
    whole = whole.accept(5, "Aslaug", "better still", 1, replace=True)
    assert whole.find(5).in_use
    assert not whole.find(4).in_use
    assert whole.find(4).judgement == Judgement.REJECTED
    assert whole.find(4).reason == "replaced by survey 5: better still"
    back = whole.accept(4, "Aslaug", "", 2, replace=True)
    assert [r.in_use for r in back.records] == [True, True, True, True, False]


def certain(sigma_azimuth_deg):
    """Covariance of a station whose azimuth has this sigma."""
    return (1e-8, 0.0, 0.0, 0.0, math.radians(sigma_azimuth_deg) ** 2, 0.0, 0.0, 0.0, 1e-6)


def used(whole):
    return [r.survey.sequence for r in whole.records if r.in_use]


def test_of_two_surveys_at_a_depth_the_path_uses_the_clearly_more_certain_one():
    whole = SurveyList(legs=VERTICAL).add(shot(1, covariance=certain(2.3)), 90.0, 0.0)
    equal = whole.add(shot(2, covariance=certain(2.2)), 90.0, 0.0)
    assert used(equal) == [1]
    better = equal.add(shot(3, covariance=certain(1.2)), 90.0, 0.0)
    assert used(better) == [3]
    assert flags(better, 1) == ("duplicate depth: survey 3 is at 90.00 m",)
    assert better.as_first_decided() == better
    # A survey that a person accepted stays, and a more certain one that is doubtful is not used.
    assert used(whole.accept(1, "Ann", "", 1).add(shot(3, covariance=certain(1.2)), 90.0, 0.0)) == [1]
    assert used(whole.add(shot(3, covariance=certain(1.2), verdict=int(Verdict.DOUBTFUL)), 90.0, 0.0)) == [1]


def test_a_survey_that_a_revision_makes_doubtful_is_replaced_by_the_other_one_at_its_depth():
    whole = SurveyList(legs=VERTICAL).add(shot(1, covariance=certain(2.3)), 90.0, 0.0)
    whole = whole.add(shot(2, covariance=certain(2.2)), 90.0, 0.0).add(shot(3), 120.0, 0.0)
    doubtful = dataclasses.replace(shot(1, covariance=certain(4.0)), verdict=int(Verdict.DOUBTFUL), revision=1)
    out = whole.revise(doubtful)
    assert used(out) == [2, 3]
    # Back again, it does not move the path to and fro.
    assert used(out.revise(dataclasses.replace(whole.find(1).survey, revision=2))) == [2, 3]


@pytest.mark.fault_case(39)
def test_a_decreasing_depth_goes_between_the_others_only_by_explicit_accept():
    whole = filled(*CURVE).add(shot(5, 4.0, 33.0), 145.0, 0.0)
    assert flags(whole, 5) == ("decreasing depth: survey 4 is deeper, at 190.00 m",)
    with pytest.raises(ValueError, match="decreasing depth"):
        whole.accept(5, "Aslaug", "", 1)
    whole = whole.accept(5, "Aslaug", "check shot", 1, replace=True)
    assert whole.definitive().md.tolist() == [0.0, 100.0, 130.0, 145.0, 160.0, 190.0]


@pytest.mark.fault_case(39)
@given(
    md=st.lists(st.one_of(st.just(math.nan), st.integers(1, 12)), min_size=2, max_size=5),
    moves=st.lists(st.tuples(st.integers(1, 5), st.integers(1, 12)), max_size=6),
)
def test_only_an_explicit_replacement_brings_depths_and_times_out_of_order(md, moves):
    whole = SurveyList(legs=VERTICAL)
    for k, depth in enumerate(md, start=1):
        whole = whole.add(shot(k, 0.5), 30.0 * depth, 0.0)
    for k, depth in moves:
        with contextlib.suppress(ValueError):
            whole = whole.accept(k, "Aslaug", "", 1, measured_depth=30.0 * depth)
    stations = [r for r in whole.records if r.in_use]
    assert [r.survey.stamp_ns for r in stations] == sorted(r.survey.stamp_ns for r in stations)
    assert len({r.measured_depth for r in stations}) == len(stations)


@pytest.mark.fault_case(39)
def test_a_revision_leaves_a_survey_below_a_later_one_that_a_person_inserted():
    whole = filled(*CURVE).add(shot(5, 4.0, 33.0), 145.0, 0.0).accept(5, "Aslaug", "", 1, replace=True)
    revised = whole.revise(dataclasses.replace(whole.find(4).survey, revision=1))
    assert used(revised) == used(whole)


def test_a_survey_judged_late_is_not_called_decreasing():
    whole = SurveyList().add(shot(1, verdict=int(Verdict.DOUBTFUL)), 100.0, 0.0).add(shot(2), 130.0, 0.0)
    assert whole.accept(1, "Aslaug", "", 1).definitive().md.tolist() == [0.0, 100.0, 130.0]


@pytest.mark.fault_case(100)
def test_a_survey_with_stale_depth_waits_and_keeps_its_flag_when_accepted():
    whole = filled(*CURVE).add(shot(5, 12.0), 220.0, 45.0)
    assert not whole.find(5).in_use
    assert flags(whole, 5) == ("the nearest depth of the rig is 45 s from the survey: check it",)
    whole = whole.accept(5, "Aslaug", "pipe tally agrees", 1)
    assert whole.find(5).in_use
    assert flags(whole, 5) == ("the nearest depth of the rig is 45 s from the survey: check it",)


def test_a_survey_without_depth_is_kept_and_takes_the_depth_a_person_gives():
    whole = filled(*CURVE).add(shot(5, 12.0))
    assert flags(whole, 5) == ("no measured depth",)
    with pytest.raises(ValueError, match="cannot be used: no measured depth"):
        whole.accept(5, "Aslaug", "", 1)
    whole = whole.accept(5, "Aslaug", "", 1, measured_depth=220.0)
    assert whole.find(5).measured_depth == 220.0
    assert whole.find(5).comment == "depth 220.00 m given by hand"


@pytest.mark.fault_case(39)
def test_gap_and_dogleg_are_pointed_out():
    whole = filled(*CURVE).add(shot(5, 12.0), 690.0, 0.0).add(shot(6, 50.0), 720.0, 0.0)
    assert flags(whole, 5) == ("gap 500 m is over 60 m",)
    assert flags(whole, 6) == ("dogleg 38.0 deg/30 m is over 10 deg/30 m",)
    assert whole.find(6).in_use


def test_a_station_that_points_the_opposite_way_stays_out_with_the_reason():
    whole = filled((100.0, 90.0, 0.0)).add(shot(2, 90.0, 180.0), 130.0, 0.0)
    assert not whole.find(2).in_use
    assert "point opposite ways" in flags(whole, 2)[0]
    with pytest.raises(ValueError, match="point opposite ways"):
        whole.accept(2, "Aslaug", "", 1)


def test_azimuths_are_turned_to_the_north_of_the_well_or_stay_out():
    grid = Well(north_reference="grid")
    turned = shot(
        1, 30.0, 40.0, north=int(North.MAGNETIC), declination=math.radians(3.0), convergence=math.radians(1.0)
    )
    whole = SurveyList(well=grid).add(turned, 100.0, 0.0)
    assert math.degrees(whole.definitive().azimuth[-1]) == pytest.approx(42.0)
    bare = SurveyList(well=grid).add(shot(1, 30.0, north=int(North.MAGNETIC), b_reference=math.nan), 100.0, 0.0)
    assert flags(bare, 1) == ("its azimuth is from magnetic north, and the angle to grid north is not known",)
    withheld = SurveyList().add(shot(1, 30.0, math.nan), 100.0, 0.0)
    assert flags(withheld, 1) == ("no azimuth",)


@pytest.mark.fault_case(27)
def test_a_vertical_station_without_azimuth_is_used_and_says_so():
    whole = SurveyList().add(shot(1, 0.4, math.nan), 100.0, 0.0)
    assert whole.find(1).in_use
    assert "no azimuth: that of the station above is used" in flags(whole, 1)


def test_a_tie_on_moves_the_whole_leg_and_must_lie_above_it():
    whole = filled(*CURVE)
    moved = whole.tied_on(TieOn(50.0, 0.0, 0.0, 5.0, -3.0, 49.0, Origin.GIVEN))
    np.testing.assert_allclose(moved.definitive().positions[0], [5.0, -3.0, 49.0])
    md, inc, azi = zip((50.0, 0.0, 0.0), *CURVE, strict=True)
    want = mc.path(md, np.radians(inc), np.radians(azi), (5.0, -3.0, 49.0))[-1]
    assert (moved.find(4).north, moved.find(4).east, moved.find(4).vertical_depth) == pytest.approx(tuple(want))
    with pytest.raises(ValueError, match=r"surveys \[1\] of leg 'main' lie at or above 100.0 m"):
        whole.tied_on(TieOn(100.0))
    with pytest.raises(ValueError, match="must be finite"):
        whole.tied_on(TieOn(math.nan))
    shallow = moved.add(shot(5), 40.0, 0.0)
    assert "is not below the tie-on" in flags(shallow, 5)[0]


def test_a_sidetrack_shares_the_path_above_its_tie_on_and_numbers_go_on():
    whole = filled(*CURVE)
    there = whole.definitive().at(145.0)
    split = whole.sidetracked("ST1", 145.0)
    assert split.leg == "ST1"
    split = split.add(shot(5, 8.0, 90.0), 175.0, 0.0)
    path = split.definitive()
    assert path.md.tolist() == [0.0, 100.0, 130.0, 145.0, 175.0]
    assert path.kind == ("tie-on", "survey", "survey", "tie-on", "survey")
    assert path.sequence == (0, 1, 2, 0, 5)
    np.testing.assert_allclose(path.positions[3], there[2])
    assert split.definitive("main").md.tolist() == whole.definitive().md.tolist()
    assert split.using(leg="main", tool="T2").add(shot(6, 12.0), 220.0, 0.0).find(6).tool == "T2"
    with pytest.raises(ValueError, match="a new leg needs a new name"):
        split.sidetracked("ST1", 120.0)
    with pytest.raises(ValueError, match="outside the stations"):
        whole.sidetracked("ST2", 500.0)
    with pytest.raises(ValueError, match=r"there is no 'ST9'; there are 'main', 'ST1'"):
        split.definitive("ST9")


def test_another_north_is_refused_while_a_tie_on_or_station_has_none_from_there():
    whole = filled(*CURVE)
    grid = whole.configured(Well(north_reference="grid"), ListRules())
    assert grid.north == North.GRID
    tied = whole.tied_on(TieOn(50.0, 0.1, 0.2, 1.0, 1.0, 49.0))
    with pytest.raises(ValueError, match="leg 'main' is tied on from true north"):
        tied.configured(Well(north_reference="grid"), ListRules())
    bare = SurveyList().add(shot(1, convergence=None), 100.0, 0.0)
    with pytest.raises(ValueError, match="north_reference: survey 1: its azimuth is from true north"):
        bare.configured(Well(north_reference="grid"), ListRules())


def test_a_list_survives_json_and_says_what_does_not_belong():
    whole = filled(*CURVE).sidetracked("ST1", 145.0).add(shot(5, 8.0), 175.0, 0.0).reject(5, "Bo", "why", 5)
    table = json.loads(json.dumps(whole.to_mapping(), allow_nan=False))
    assert SurveyList.from_mapping(table) == whole
    table["records"][0]["depth"] = 3.0
    with pytest.raises(ValueError, match=r"records\[0\].depth: no such setting; did you mean"):
        SurveyList.from_mapping(table)
    orphan = json.loads(json.dumps(whole.to_mapping()))
    orphan["records"][0]["leg"] = "gone"
    with pytest.raises(ValueError, match=r"legs \['gone'\] do not exist"):
        SurveyList.from_mapping(orphan)


@pytest.mark.slow
@given(st.lists(st.tuples(st.floats(1.0, 3000.0), st.floats(0.0, 90.0), st.floats(0.0, 360.0)), max_size=12))
def test_whatever_comes_the_path_increases_and_is_finite_and_nothing_is_lost(stations):
    whole = filled(*stations)
    path = whole.definitive()
    assert np.all(np.diff(path.md) > 0.0)
    assert all(np.all(np.isfinite(v)) for v in (path.positions, path.dogleg_severity, path.turn_rate))
    assert sorted(r.survey.sequence for r in whole.records) == list(range(1, len(stations) + 1))
    assert all(r.in_use or r.flags for r in whole.records)


def test_the_rules_say_how_the_path_goes_on_to_the_bit():
    whole = filled(*CURVE)
    assert whole.definitive(bit_depth=210.0).kind[-1] == "projected"
    curve = dataclasses.replace(whole, rules=ListRules(projection="curve")).definitive(bit_depth=220.0)
    assert curve.dogleg_severity[-1] == pytest.approx(curve.dogleg_severity[-2])


@pytest.mark.fault_case(86)
@pytest.mark.parametrize("depth", [1e300, 20_001.0, -2.0])
def test_a_depth_that_no_hole_has_is_refused(depth):
    whole = filled((100.0, 0.5, 10.0))
    with pytest.raises(ValueError, match="measured_depth"):
        whole.accept(1, "A. Smith", "", 5, measured_depth=depth)


@pytest.mark.fault_case(58)
def test_a_number_beyond_all_numbers_of_surveys_becomes_the_next_free_one():
    whole = SurveyList().add(shot(1)).add(shot(2**32 - 1)).add(shot(3))
    assert sorted(r.survey.sequence for r in whole.records) == [1, 2, 3]
    assert f"numbered {2**32 - 1} by the tool" in whole.find(2).comment
