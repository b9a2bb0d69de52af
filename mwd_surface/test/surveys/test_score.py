# SPDX-License-Identifier: Apache-2.0
"""Surveys beside the truth: the right moment, the right north, the short way round."""

import dataclasses
import math

import numpy as np
import pytest
from example_surveys import NO_AZIMUTH

from mwd_estimation.core.north import North
from mwd_estimation.survey.survey import AzimuthEstimate, Survey, Verdict
from mwd_sensors.core import wire
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.bags.definitions import installed
from mwd_surface.surveys import score as module
from mwd_surface.surveys.score import score

START = 1_772_344_800_000_000_000
DECLINATION, CONVERGENCE = math.radians(5.0), math.radians(-1.0)


def survey(sequence, seconds, azimuth_deg, **changes):
    azimuth = math.radians(azimuth_deg)
    covariance = (1e-6, 0.0, 0.0, 0.0, 1e-4, 0.0, 0.0, 0.0, 1e-6)
    return dataclasses.replace(
        Survey(
            stamp_ns=START + round(seconds * 1e9),
            uuid=f"uuid-{seconds}",
            sequence=sequence,
            inclination=math.radians(40.1),
            azimuth=azimuth,
            north=int(North.GRID),
            covariance=covariance,
            azimuths=(
                AzimuthEstimate("raw", int(North.MAGNETIC), azimuth, 0.02),
                AzimuthEstimate("corrected", int(North.GRID), azimuth, 0.01),
            ),
            b_reference=5e-5,
            declination=DECLINATION,
            convergence=CONVERGENCE,
            verdict=int(Verdict.DOUBTFUL),
            reasons=("why",),
        ),
        **changes,
    )


def message(of):
    """A survey as CDR bytes, without middleware."""
    types = installed()
    return bytes(types.typestore.serialize_cdr(of.to_message(types.make), Survey.MESSAGE))


def recording(path, surveys, seconds=60.0, namespace="/well_1/"):
    truth = wire.TRUTH.empty(round(seconds * 10))
    truth["stamp_ns"] = START + np.arange(len(truth)) * 100_000_000
    truth["inclination"] = math.radians(40.0)
    truth["azimuth"] = np.radians(359.5)
    truth["measured_depth"] = np.linspace(100.0, 160.0, len(truth))
    with BagWriter(path) as bag:
        if len(truth):
            channel = bag.topic(namespace + "truth", wire.TRUTH.type_name)
            bag.write_rows(channel, wire.TRUTH.encode(truth, "sonde_link"), truth["stamp_ns"])
        channel = bag.topic(namespace + "survey", module.SURVEY_TYPE)
        for one in surveys:
            bag.write(channel, message(one), one.stamp_ns + 10**9)
    return path


def scored(folder, *surveys):
    with Bag(recording(folder / "bag", surveys)) as bag:
        return score([bag])


def test_a_survey_is_compared_with_the_truth_of_its_moment_from_true_north(tmp_path):
    (one,) = scored(tmp_path, survey(1, 30.0, 1.0))
    assert one.measured_depth == pytest.approx(130.0, abs=0.1)
    assert math.degrees(one.inclination_error) == pytest.approx(0.1)
    # Grid 1 deg is true 0 deg with a convergence of -1 deg: half a degree past the true azimuth, across north.
    assert math.degrees(one.chosen) % 360.0 == pytest.approx(0.0, abs=1e-9)
    assert math.degrees(one.azimuth_error) == pytest.approx(0.5)
    assert math.degrees(one.raw) == pytest.approx(6.0)
    assert math.degrees(one.corrected) % 360.0 == pytest.approx(0.0, abs=1e-9)
    assert one.sigma_azimuth == pytest.approx(0.01)
    assert (one.verdict, one.action) == (Verdict.DOUBTFUL, "why")


def test_surveys_come_once_each_in_order_of_time(tmp_path):
    # The last lies outside the truth, and is left out.
    surveys = [survey(1, 20.0, 1.0), survey(1, 20.0, 1.0), survey(1, 10.0, 2.0), survey(2, 90.0, 1.0)]
    assert [one.measured_depth for one in scored(tmp_path, *surveys)] == pytest.approx([110.0, 120.0], abs=0.1)


def test_the_recordings_of_a_surface_that_was_restarted_are_scored_together(tmp_path):
    first, second = survey(1, 20.0, 1.0), survey(2, 40.0, 1.0)
    # The second recording began after the end of the simulation: it has the surveys again, and no truth.
    paths = [recording(tmp_path / "a", [first, second]), recording(tmp_path / "b", [first, second], seconds=0.0)]
    with Bag(paths[0]) as one, Bag(paths[1]) as other:
        assert [s.sequence for s in score([one, other])] == [1, 2]
        assert score([other, one]) == score([one])


def test_an_azimuth_that_was_withheld_stays_unknown(tmp_path):
    none = dataclasses.replace(survey(1, 20.0, 0.0, azimuths=()), **NO_AZIMUTH)
    (one,) = scored(tmp_path, none)
    assert (one.chosen, one.azimuth_error, one.sigma_azimuth, one.raw, one.corrected) == (None,) * 5


def test_a_magnetic_azimuth_without_declination_is_not_compared(tmp_path):
    magnetic = survey(1, 20.0, 3.0, north=int(North.MAGNETIC), b_reference=math.nan, declination=0.0, convergence=0.0)
    (one,) = scored(tmp_path, magnetic)
    assert one.chosen is None
    assert one.inclination_error == pytest.approx(math.radians(0.1))


def test_a_recording_without_surveys_has_nothing_to_score(tmp_path):
    rows = wire.IMU.empty(1)
    rows["stamp_ns"] = START
    with BagWriter(tmp_path / "bag") as bag:
        channel = bag.topic("/well_1/imu/data_raw", wire.IMU.type_name)
        bag.write_rows(channel, wire.IMU.encode(rows, "x"), rows["stamp_ns"])
    with Bag(tmp_path / "bag") as bag:
        assert score([bag]) == []


def test_a_recording_without_truth_is_refused(tmp_path):
    path = recording(tmp_path / "bag", [survey(1, 5.0, 1.0)], seconds=0.0)
    with Bag(path) as bag, pytest.raises(BagError, match="truth"):
        score([bag])
