# SPDX-License-Identifier: Apache-2.0
"""The continuous estimate as a whole: what stands where nothing can be carried, and what a station teaches it."""

import math

import numpy as np
import pytest
from bench_errors import BENCH

from mwd_estimation.attitude import gyro_azimuth_filter, time_alignment
from mwd_estimation.attitude.block import BinEvent, Block, MagneticModelInForce, StationUpdate
from mwd_estimation.attitude.continuous_attitude import AttitudeStream
from mwd_estimation.attitude.gyro_azimuth_filter import PrecisionRates, gyro_unit
from mwd_estimation.attitude.sample import samples_of
from mwd_estimation.attitude.time_alignment import FieldModel
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.status import Status
from mwd_estimation.core.track import Track
from mwd_estimation.magnetic import interference_filter
from mwd_sensors.core import wire
from mwd_sensors.core.frames import mat_nt, wrap_pi

START = 1_700_000_000 * 10**9
BIN_NS = 500_000_000
DIP = 1.1
FIELD_N = 5e-5 * np.array([math.cos(DIP), 0.0, math.sin(DIP)])
REFERENCE = Reference(total=5e-5, dip=DIP, declination=0.0, source="test")
NO_PRECISION = PrecisionRates(np.zeros(0, dtype=np.int64), np.zeros((0, 3)))


def stream(reference=REFERENCE, **carry):
    made = AttitudeStream(
        time_alignment.TimeAlignmentParams(),
        interference_filter.InterferenceParams(),
        gyro_azimuth_filter.GyroAzimuthParams(**carry),
        BENCH,
        50.0,
    )
    made.set_reference(reference)
    return made


def samples(n, inclination, azimuth=1.0, rate=0.0, own=(0.0, 0.0, 0.0), sigma_tilt=2e-4):
    stamps = START + np.arange(n) * 10**7
    mat = mat_nt(inclination, np.full(n, azimuth), rate * np.arange(n) * 0.01)
    down = np.ascontiguousarray(mat[:, 2, :])
    gyro = np.zeros((n, 3))
    gyro[:, 0] = rate
    one = np.full(n, sigma_tilt)
    track = Track(
        down, one, one, np.zeros(n), np.full(n, rate), np.full(n, int(Status.ROTATING), dtype=np.uint32), np.zeros(n)
    )
    b_t = np.einsum("kji,j->ki", mat, FIELD_N) + own
    return Block(samples_of((stamps, stamps), gyro, -9.81 * down, track, np.zeros(n, dtype=np.uint8))), b_t


def follow(made, block, b_t, updates=(), seeks=(), external_from=None, open_from=None):
    """All samples as one block; bin events as the bins close, one bin late."""
    n = len(block.samples)
    made.take_mag((block.samples["sent_ns"], block.samples["stamp_ns"]), b_t)
    attitude, gravity = wire.ATTITUDE.empty(n), wire.GRAVITY.empty(n)
    model = FieldModel((0.0, 0.0, 0.0), 2e-7, 7e-8)
    models = [
        (0, MagneticModelInForce(model, 2, False)),
        *((place, MagneticModelInForce(model, 2, False, update)) for place, update in updates),
    ]
    if external_from is not None:
        models.append((external_from, MagneticModelInForce(model, 2, False, external_interference=True)))
    if open_from is not None:
        unsure = FieldModel((0.0, 0.0, 0.0), 2e-7, 7e-8, sigma_north=0.4)
        models.append((open_from, MagneticModelInForce(unsure, 2, False, unresolved=0.4)))
    events = [
        BinEvent(place, START // BIN_NS + place // 50 - 2, START + (place - 50) * 10**7, *dict(seeks).get(place, ()))
        for place in range(100, n, 50)
    ]
    interference, rejected = made.follow(block, models, events, NO_PRECISION, attitude, gravity)
    return attitude, gravity, interference, rejected


def test_a_turning_tool_gives_its_own_field_in_three_axes_and_an_azimuth_free_of_it():
    own = np.array([3e-6, 3e-7, -2e-7])
    block, b_t = samples(6000, 0.9, rate=6.0, own=own)
    attitude, gravity, interference, rejected = follow(stream(), block, b_t)
    last, found = attitude[-1], interference[-1]
    assert rejected == 0
    assert abs(wrap_pi(last["azimuth"] - 1.0)) < 3.0 * last["sigma_azimuth"] < 0.03
    assert found["axial"] == pytest.approx(own[0], abs=3.0 * found["sigma_axial"])
    assert found["cross_axial"] == pytest.approx(own[1:], abs=2e-8)
    assert (found["sigma_cross_axial"] > 0.0).all()
    assert last["status"] & Status.CORRECTED
    assert gravity["gravity"][-1] == pytest.approx(block.samples["down"][-1])


@pytest.mark.fault_case(30)
def test_a_horizontal_east_west_hole_hides_the_axial_field_and_sigma_and_status_say_so():
    block, b_t = samples(3000, math.pi / 2, azimuth=math.pi / 2, rate=6.0, own=(2e-6, 0.0, 0.0))
    attitude, _, interference, _ = follow(stream(), block, b_t)
    assert np.isnan(interference["sigma_axial"][-1])
    assert np.isnan(interference["axial"][-1])
    assert attitude["status"][-1] & Status.CORRECTION_REFUSED
    assert math.degrees(attitude["sigma_azimuth"][-1]) > 3.0
    assert abs(wrap_pi(attitude["azimuth"][-1] - math.pi / 2)) < 2.5 * attitude["sigma_azimuth"][-1]


def test_a_gyro_azimuth_there_teaches_both_azimuth_and_axial_field():
    block, b_t = samples(3000, math.pi / 2, azimuth=math.pi / 2, rate=6.0, own=(2e-6, 0.0, 0.0))
    update = StationUpdate(None, block.samples["down"][2000], b_t[2000], math.pi / 2, math.radians(0.4))
    attitude, _, interference, _ = follow(
        stream(), block, b_t, [(2000, update)], [(2000, (math.pi / 2, math.radians(0.4)))]
    )
    assert interference["axial"][-1] == pytest.approx(2e-6, abs=3.0 * interference["sigma_axial"][-1])
    assert math.degrees(attitude["sigma_azimuth"][-1]) < 0.6
    assert attitude["status"][-1] & Status.CORRECTED


def test_what_many_stations_found_is_gone_on_from():
    block, b_t = samples(1000, math.pi / 2, azimuth=math.pi / 2, own=(2e-6, 0.0, 0.0))
    state = interference_filter.initial(interference_filter.InterferenceParams(), REFERENCE, BENCH)
    state[0].x[0], state[0].P[0, 0] = 2e-6, (5e-8) ** 2
    update = StationUpdate((state[0].x, state[0].P), block.samples["down"][0], b_t[0])
    attitude, _, interference, _ = follow(stream(), block, b_t, [(500, update)])
    assert interference["sigma_axial"][-1] < 6e-8
    assert abs(wrap_pi(attitude["azimuth"][-1] - math.pi / 2)) < 0.03


def test_interference_beyond_the_prior_gives_no_azimuth_until_an_accepted_station_tells_it():
    n, axial = 6000, 4e-5
    errors, sigmas = [], []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        block, b_t = samples(n, 1.17, azimuth=0.7 + seed, own=(axial, 0.0, 0.0))
        b_t = b_t + 5e-8 * rng.normal(size=b_t.shape)
        given = StationUpdate(
            None, block.samples["down"][0], b_t[0], accepted=True, axial=(axial + 2.2e-7 * rng.normal(), 2.2e-7)
        )
        attitude, *_ = follow(stream(), block, b_t, updates=[(3000, given)])
        assert np.isnan(attitude["sigma_azimuth"][:3000]).all()
        assert (attitude["status"][1000:3000] & int(Status.MAG_DISTURBED) != 0).all()
        late = attitude[-1]
        assert not late["status"] & int(Status.MAG_DISTURBED)
        errors.append(wrap_pi(late["azimuth"] - 0.7 - seed))
        sigmas.append(late["sigma_azimuth"])
    assert max(sigmas) < math.radians(3.0)
    assert np.abs(np.array(errors) / sigmas).max() < 3.0


def test_beside_external_interference_that_a_gyro_has_shown_the_gyros_carry_the_azimuth_alone():
    block, b_t = samples(3000, 0.9, azimuth=1.0)
    b_t = b_t + np.array([0.0, 3e-6, 0.0])
    seek = [(1500, (1.0, math.radians(1.0)))]
    attitude, _, _, _ = follow(stream(), block, b_t, seeks=seek, external_from=1500)
    assert np.isnan(attitude["azimuth"][1400])
    assert (attitude["status"][1500:] & Status.MAG_DISTURBED > 0).all()
    assert (attitude["status"][2000:] & Status.GYRO_AIDED > 0).all()
    assert np.abs(wrap_pi(attitude["azimuth"][1550:] - 1.0)).max() < math.radians(0.5)
    assert attitude["sigma_azimuth"][-1] >= math.radians(1.0)


@pytest.mark.parametrize("reference", [REFERENCE, None])
def test_an_azimuth_that_a_gyro_left_open_says_so_and_gives_way_to_a_better_gyro(reference):
    block, b_t = samples(3000, 0.9, azimuth=1.0)
    seek = [(2000, (1.4, math.radians(4.0)))]
    attitude, _, _, _ = follow(stream(reference), block, b_t, seeks=seek, open_from=1000)
    assert attitude["sigma_azimuth"][990] < math.radians(3.0)
    assert attitude["sigma_azimuth"][1900] == pytest.approx(0.4, abs=0.03)
    assert abs(wrap_pi(attitude["azimuth"][1900] - 1.0)) < 0.02
    # It is the better one, and 0.4 rad would not be far from what was left open.
    assert abs(wrap_pi(attitude["azimuth"][2150] - 1.4)) < math.radians(2.0)
    assert attitude["sigma_azimuth"][2150] < math.radians(4.2)


@pytest.mark.fault_case(27)
def test_near_vertical_the_magnetic_toolface_stands_and_the_azimuth_is_unknown():
    block, b_t = samples(1000, 0.02, rate=1.0)
    attitude, _, _, _ = follow(stream(), block, b_t)
    late = attitude[200:]
    assert (late["status"] & Status.NEAR_VERTICAL > 0).all()
    assert (late["sigma_azimuth"] == math.pi).all()
    turned = 1.0 + np.arange(1000) * 0.01
    assert np.abs(wrap_pi(late["magnetic_toolface"] - turned[200:])).max() < 0.03
    assert late["sigma_magnetic_toolface"].max() < 0.05


def test_without_a_reference_the_azimuth_is_carried_all_the_same_and_says_that_it_is_uncorrected():
    block, b_t = samples(1000, 0.9, rate=2.0)
    attitude, _, interference, _ = follow(stream(None), block, b_t)
    assert abs(wrap_pi(attitude["azimuth"][-1] - 1.0)) < 1e-3
    assert attitude["status"][-1] & Status.UNCORRECTED
    assert attitude["status"][-1] & Status.NO_REFERENCE
    assert np.isnan(interference["sigma_axial"]).all()


@pytest.mark.fault_case(47)
def test_an_azimuth_that_has_grown_too_uncertain_is_withheld_not_replaced():
    block, b_t = samples(3000, 0.9)
    b_t[500:] += 2e-5
    attitude, _, _, _ = follow(
        stream(units=(gyro_unit(100.0, 400.0, 10.0, 1000.0, 3.6, 0.5),) * 2, max_sigma=math.radians(5.0)), block, b_t
    )
    assert attitude["sigma_azimuth"][490] > 0.0
    assert np.isnan(attitude["sigma_azimuth"][2000:]).all()
    assert np.isnan(attitude["azimuth"][2000:]).all()


def test_a_vertical_that_is_not_known_yet_teaches_nothing():
    block, b_t = samples(500, 0.9, sigma_tilt=1.0)
    attitude, _, interference, _ = follow(stream(), block, b_t)
    assert np.isnan(interference["sigma_axial"]).all()
    assert not (attitude["status"] & Status.MAG_DISTURBED).any()
