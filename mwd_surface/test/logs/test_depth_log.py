# SPDX-License-Identifier: Apache-2.0
"""Merge by depth: counts are conserved, order and reaming do not matter, gaps are stated, sigmas are honest."""

import dataclasses
import io
import itertools
import math
import pickle
import weakref

import lasio
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.telemetry.log_channels import FROM_WORD, ONE_SIDED, SATURATED, LogSample
from mwd_surface.live.live_state import LiveState
from mwd_surface.logs import depth_log
from mwd_surface.logs.depth_log import ALL, DEEPEST, FIRST, PASSES, DepthLog, shift_between
from mwd_surface.logs.log_files import FORMATS, gap_lines
from mwd_surface.page.state_json import held_steps, log_table
from mwd_surface.rig.values import Condition, log_values, rig_values
from mwd_surface.rig.wits.records import RecordWriter, Wits0Format
from mwd_surface.surveys.well import Well

S = 10**9
T0 = 10**18
OFFSET = 12.0


def sample(at_s, value=80.0, span=10.0, counts=533.0, **more):
    given_ = {"sigma": 80.0 / math.sqrt(533.0), "counts": counts, "sensor_to_bit": OFFSET, "duration": span}
    return LogSample(T0 + round(at_s * S), "gamma", "gAPI", span=span, value=value, **{**given_, **more})


def at_depths(seconds, speed=0.0, **settings):
    """A log without samples, and the depth of the bit each second: from 1000 m on with a speed, m/s."""
    log = DepthLog(**settings)
    for at in range(seconds + 1):
        log.add_depth(T0 + at * S, 1000.0 + speed * at)
    return log


def total_counts(log):
    """Sum of the counts of all steps of gamma."""
    return np.nansum(log.curve("gamma", ALL).counts)


def assert_equal(one, two):
    """Two curves have the same bits."""
    for field in dataclasses.fields(one):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(two, field.name))


def drilled(depth_of, seconds, values=None, step=0.1):
    """A log of samples each 10 s, and the depth of the bit each second as a function of time."""
    log = DepthLog(step_m=step)
    for at in range(seconds + 1):
        log.add_depth(T0 + at * S, depth_of(at))
    log.add(sample(at, 80.0 if values is None else values(at)) for at in range(5, seconds, 10))
    return log


def ream(at):
    """Drill 36 m/h, ream 3 m up and down after ten minutes, and drill on."""
    up = 600.0
    if at <= up:
        return 1000.0 + 0.01 * at
    if at <= up + 60.0:
        return 1006.0 - 3.0 * math.sin(math.pi * (at - up) / 60.0)
    return 1006.0 + 0.01 * (at - up - 60.0)


def memory_of(hours, depth_of, history=600):
    """Bytes of a log of one channel without sectors."""
    log = DepthLog(history=history)
    for at in range(0, 3600 * hours, 5):
        log.add_depth(T0 + at * S, depth_of(at))
        if at % 10 == 0:
            log.add([sample(at)])
    return len(pickle.dumps(log))


@pytest.mark.fault_case(70)
def test_memory_follows_the_length_of_the_hole_and_not_the_time():
    reamed = [memory_of(hours, lambda at: 1000.0 + 10.0 * abs(math.sin(at / 100.0))) for hours in (2, 4)]
    # The depths over time are dropped by quarters.
    assert reamed[1] == pytest.approx(reamed[0], rel=0.05)
    drilled_m = [memory_of(hours, lambda at: 1000.0 + at * 36.0 / 3600.0) for hours in (2, 4)]
    # A well of 10 km and eight channels in three passes: 240 MB at 100 bytes a step.
    assert drilled_m[1] - drilled_m[0] < 100 * 3 * (2 * 36.0 / depth_log.STEP_M + 2 * depth_log._CHUNK)


@given(
    st.lists(st.floats(-0.4, 0.4), min_size=5, max_size=60),
    st.sampled_from([0.05, 0.1, 0.5]),
    st.floats(0.0, 30.0),
)
def test_the_counts_of_all_steps_are_the_counts_of_the_samples(speeds, step, offset):
    log = DepthLog(step_m=step)
    depth, total = 1000.0, 0.0
    log.add_depth(T0, depth)
    for k, speed in enumerate(speeds):
        depth += 10.0 * speed
        log.add_depth(T0 + (k + 1) * 10 * S, depth)
        log.add([sample(10.0 * k + 5.0, counts=17.0 * k, sensor_to_bit=offset)])
        total += 17.0 * k
    log.finish()
    curve = log.curve("gamma", ALL)
    assert np.nansum(curve.counts) == pytest.approx(total, abs=1e-6)
    assert curve.seconds.sum() == pytest.approx(10.0 * len(speeds))
    for which in (FIRST, DEEPEST):
        assert np.nansum(log.curve("gamma", which).counts) <= total + 1e-6
    assert not log.unplaced


@given(st.randoms(use_true_random=False), st.lists(st.integers(0, 60), max_size=4))
def test_the_order_and_the_portions_in_which_samples_come_do_not_matter(random, cuts):
    samples = [sample(at, 50.0 + at / 20.0) for at in range(5, 600, 10)]
    whole, other = DepthLog(), DepthLog()
    for log in (whole, other):
        for at in range(0, 601, 2):
            log.add_depth(T0 + at * S, ream(at))
    whole.add(samples)
    shuffled = list(samples)
    random.shuffle(shuffled)
    edges = [0, *sorted(cuts), len(shuffled)]
    for low, high in itertools.pairwise(edges):
        other.add(shuffled[low:high])
    for which in PASSES:
        assert_equal(whole.curve("gamma", which), other.curve("gamma", which))


def test_reaming_changes_neither_pass_but_adds_to_the_sum():
    """The same hole without reaming: time 600 to 660 s is left out."""
    reamed = drilled(ream, 1260, lambda at: 80.0 if not 600 < at < 660 else 300.0)
    plain = drilled(lambda at: ream(at if at <= 600 else at + 60), 1200)
    for which in (FIRST, DEEPEST):
        one, two = reamed.curve("gamma", which), plain.curve("gamma", which)
        assert np.nanmax(one.value) < 90.0
        np.testing.assert_allclose(one.depth, two.depth)
        np.testing.assert_allclose(one.value, two.value, atol=8.0)
    assert np.nanmax(reamed.curve("gamma", ALL).value) > 90.0


@pytest.mark.parametrize("which", PASSES)
@pytest.mark.parametrize("most", [None, 20])
def test_the_gaps_are_those_of_the_whole_hole_to_its_depth_and_nothing_is_put_into_them(which, most):
    """Part of a curve states a gap above it; a channel that stopped has a gap to the depth of its sensor."""
    log = at_depths(3000, 0.01)
    samples = [sample(at) for at in range(5, 3000, 10) if not 300 < at < 500]
    log.add(samples)
    log.add(dataclasses.replace(one, channel="stopped") for one in samples if one.stamp_ns < T0 + 2000 * S)
    curve = log.curve("gamma", which, most)
    ((top, bottom),) = curve.gaps
    assert (top, bottom) == pytest.approx((991.0, 993.0), abs=0.11)
    inside = (curve.depth > top) & (curve.depth < bottom)
    assert np.isnan(curve.value[inside]).all()
    assert (curve.seconds[inside] == 0.0).all()
    above, below = log.curve("stopped", which, most).gaps
    assert above == (top, bottom)
    assert below == pytest.approx((1008.0, 1018.0), abs=0.11)
    assert len(gap_lines(log, which)) == 2


def test_a_channel_that_lags_has_not_stopped():
    log = at_depths(1200, 0.01)
    log.add(sample(at) for at in range(5, 1120, 10))
    assert log.curve("gamma").gaps == ()


def test_many_gaps_are_one_sentence_and_three_on_the_page():
    log = at_depths(2400, 0.1)
    log.add(sample(at) for at in range(5, 2400, 20))
    curve = log.curve("gamma")
    assert len(curve.gaps) > 100
    (line,) = gap_lines(log, FIRST)
    assert str(len(curve.gaps)) in line
    (shown,) = log_table([curve])["channels"]
    assert shown["gap_count"] == len(curve.gaps)
    np.testing.assert_allclose(shown["gaps"], curve.gaps[-3:])


@given(st.integers(1, 60), st.integers(2, 10), st.lists(st.integers(2, 300), max_size=3))
def test_a_sector_is_held_for_its_usual_distance_and_never_through_a_gap(spacing, number, gaps):
    """Values at a regular distance with a few longer gaps: neighbours belong together, values across a gap do not."""
    rows, at = [], 0
    for k in range(2 * number + 3 + len(gaps)):
        rows.append(at)
        at += spacing + (spacing * gaps[k // 2] if k % 2 and k // 2 < len(gaps) else 0)
    sectors = np.full((at + 1, 2), np.nan)
    sectors[rows, 0] = 50.0
    sectors[0, 1] = 50.0
    held, single = held_steps(sectors)
    assert single == 0
    assert held <= 40
    assert held < 2 * spacing
    assert (held >= spacing) == (spacing <= 40)


def test_complete_sectors_are_not_held():
    assert held_steps(np.full((50, 8), 80.0)) == [1] * 8
    assert held_steps(np.empty((50, 0))) == []


def test_a_sample_without_a_depth_is_counted_and_left_out():
    log = DepthLog()
    log.add_depth(T0, 1000.0)
    log.add_depth(T0 + 500 * S, 1005.0)
    log.add([sample(200.0)])
    assert log.unplaced == {"gamma": 1}
    assert log.channels == ("gamma",)
    assert len(log.curve("gamma").depth) == 0


def test_a_sample_waits_for_the_depth_of_its_end():
    log = at_depths(7, 0.1)
    log.add([sample(5.0)])
    assert log.channels == ()
    for at in range(8, 11):
        log.add_depth(T0 + at * S, 1000.0 + 0.1 * at)
    log.advance()
    assert log.curve("gamma").depth[[0, -1]] == pytest.approx([988.05, 988.95])


def test_each_channel_has_the_depth_of_its_own_sensor():
    log = at_depths(100, sensor_to_bit=20.0)
    log.add([sample(50.0), dataclasses.replace(sample(50.0, sensor_to_bit=math.nan), channel="temperature")])
    assert log.curve("gamma", ALL).depth == pytest.approx([988.05])
    assert log.curve("temperature", ALL).depth == pytest.approx([980.05])


def test_the_sigma_of_a_step_is_the_scatter_of_many_logs():
    rng = np.random.default_rng(3)
    rate, errors = 20.0, []
    for _ in range(60):
        log = at_depths(600, 0.01, step_m=0.2)
        counts = rng.poisson(rate * 10.0, 60)
        log.add(
            sample(10 * k + 5, n / 10.0, counts=float(n), sigma=math.sqrt(n + 0.5) / 10.0) for k, n in enumerate(counts)
        )
        curve = log.curve("gamma")
        errors.append((curve.value - rate) / curve.sigma)
    errors = np.concatenate(errors)
    assert abs(errors.mean()) < 4.0 / math.sqrt(len(errors))
    assert abs(errors.std() - 1.0) < 4.0 / math.sqrt(2.0 * len(errors)) + 0.01


@given(st.integers(1, 40), st.floats(0.0, 1.0), st.floats(-3.0, 3.0))
def test_a_bias_that_all_samples_share_is_not_averaged_away(number, sigma, bias):
    """Errors in one step that are all the same: the sigma of the step covers them as that of one sample does."""
    log = at_depths(10 * number)
    error = bias * sigma
    log.add(sample(10.0 * k + 5.0, 20.0 + error, sigma=sigma, counts=math.nan) for k in range(number))
    curve = log.curve("gamma", ALL)
    assert curve.sigma == pytest.approx([sigma])
    assert abs(curve.value[0] - 20.0) == pytest.approx(abs(bias) * curve.sigma[0])


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_the_sigma_of_a_step_is_the_scatter_whatever_part_of_the_samples_was_counted(share):
    """Nine samples in a step: independent errors of the counted ones, one common error of all others."""
    rng, counted, errors = np.random.default_rng(5), round(share * 9), []
    for _ in range(400):
        log = at_depths(90)
        common = rng.standard_normal()
        for k in range(9):
            error, counts = (2.0 * rng.standard_normal(), 100.0) if k < counted else (common, math.nan)
            log.add([sample(10.0 * k + 5.0, 80.0 + error, sigma=2.0 if k < counted else 1.0, counts=counts)])
        curve = log.curve("gamma", ALL)
        errors.append((curve.value[0] - 80.0) / curve.sigma[0])
    assert np.std(errors) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize(("counts", "sigma"), [(math.nan, 4.0), (100.0, 2.0)])
def test_sectors_share_the_errors_of_their_values(counts, sigma):
    log = at_depths(40)
    four = {"sectors": (1.0,) * 4, "sigma_sectors": (4.0,) * 4, "sector_durations": (2.5,) * 4}
    log.add(sample(10.0 * k + 5.0, counts=counts, **four) for k in range(4))
    np.testing.assert_allclose(log.curve("gamma", ALL).sigma_sectors, sigma)


@pytest.mark.parametrize("shift", [-1.3, 0.0, 0.45, 2.0])
def test_two_logs_are_shifted_by_their_correlation(shift):
    def rock(depth):
        return 80.0 + 30.0 * math.sin(depth / 0.7) + 20.0 * math.sin(depth / 1.9)

    def log_of(moved):
        log = at_depths(3000, 0.01)
        log.add(sample(at, rock(988.0 + 0.01 * at + moved)) for at in range(5, 3000, 10))
        return log.curve("gamma")

    found, correlation = shift_between(log_of(0.0), log_of(shift))
    # What the second log shows at a depth lies deeper by the shift.
    assert found == pytest.approx(shift, abs=0.03)
    assert correlation > 0.99


def test_constant_or_short_logs_have_no_shift():
    log = drilled(lambda at: 1000.0 + 0.01 * at, 600)
    assert math.isnan(shift_between(log.curve("gamma"), log.curve("gamma"))[0])
    short = drilled(lambda at: 1000.0 + 0.01 * at, 300, lambda at: float(at % 70))
    assert shift_between(short.curve("gamma"), short.curve("gamma")) == pytest.approx((0.0, 1.0), abs=0.02)


def shown(*samples):
    """The state of a well that has these samples."""
    log, live = at_depths(100, 0.1), LiveState()
    log.add(samples)
    live.show(1.0, logs=log.curves(), newest_logs=log.newest())
    return live.at(1.0)


def newest_values(*samples):
    return log_values(shown(*samples), T0 + 100 * S)


def test_the_newest_value_goes_to_the_rig_with_its_depth_sigma_and_age():
    state = shown(sample(55.0, 120.0), sample(25.0, 60.0))
    values = log_values(state, T0 + 100 * S)
    assert values["gamma"].value == 120.0
    assert values["gamma"].condition == Condition.GOOD
    assert values["gamma"].age == pytest.approx(45.0)
    assert values["gamma_depth"].value == pytest.approx(1000.0 + 5.5 - OFFSET)
    assert log_values(state, T0 + 300 * S)["gamma"].condition == Condition.STALE
    form = RecordWriter(Wits0Format())
    sent = dict(form.formation(rig_values(state, (), now_ns=T0 + 100 * S)))
    assert float(sent[823]) == 120.0
    assert float(sent[821]) == pytest.approx(993.5)
    assert 823 not in dict(form.formation(rig_values(LiveState().at(1.0), (), now_ns=T0)))


@pytest.mark.parametrize("quality", [SATURATED, ONE_SIDED, SATURATED | ONE_SIDED | FROM_WORD, FROM_WORD, 0])
def test_a_value_that_is_not_the_mean_around_the_hole_is_marked_everywhere(quality):
    """The step, each file, the page and the rig say so; only the steps of that sample are marked."""
    doubted = bool(quality & (SATURATED | ONE_SIDED))
    log = at_depths(100, 0.1)
    log.add([sample(15.0), sample(55.0, quality=quality), sample(85.0)])
    curve = log.curve("gamma")
    bits = np.nan_to_num(curve.quality).astype(int)
    inside = (curve.depth > 1005.0 - OFFSET) & (curve.depth < 1006.0 - OFFSET)
    np.testing.assert_array_equal(bits, np.where(inside, quality, 0))
    np.testing.assert_array_equal(np.isnan(curve.quality), np.isnan(curve.value))
    las = lasio.read(io.StringIO(FORMATS[".las"](log, FIRST, Well()).decode()))
    np.testing.assert_array_equal(las["GRQ"], curve.quality)
    assert [row[4] or 0 for row in log_table([curve])["channels"][0]["rows"]] == bits.tolist()
    values = newest_values(sample(55.0, quality=quality))
    assert values["gamma"].condition == (Condition.DOUBTFUL if doubted else Condition.GOOD)
    assert bool(values["gamma"].reason) == doubted
    assert values["gamma_depth"].condition == Condition.GOOD


def test_the_rig_gets_gamma_by_its_source_and_not_by_its_name():
    other = dataclasses.replace(sample(55.0, 20.0), unit="degC")
    named = dataclasses.replace(sample(45.0, 99.0), channel="upper_gr")
    assert newest_values(other)["gamma"].condition == Condition.WAITING
    assert newest_values(other, named)["gamma"].value == 99.0
    assert newest_values(named, sample(25.0, 70.0))["gamma"].value == 70.0


@pytest.mark.parametrize(
    "more",
    [
        {"channel": "gamma,=1"},
        {"span": 1e12},
        {"span": -1.0},
        {"span": math.nan},
        {"duration": math.inf},
        {"sectors": (1.0, 2.0), "sigma_sectors": (1.0,), "sector_durations": (1.0, 1.0)},
        {"sectors": (1.0,) * 65, "sigma_sectors": (1.0,) * 65, "sector_durations": (1.0,) * 65},
        {"sectors": (1.0,), "sigma_sectors": (1.0,), "sector_durations": (-1.0,)},
        {"sectors": (1.0,), "sigma_sectors": (1.0,), "sector_durations": (math.inf,)},
        {"sectors": (1e200,), "sigma_sectors": (1e200,), "sector_durations": (1.0,)},
        {"sensor_to_bit": math.inf},
        {"sensor_to_bit": -1e9},
        {"sensor_to_bit": -0.1},
        {"value": 1e300},
        {"sigma": 1e300},
        {"sigma": -1.0},
        {"counts": math.inf},
        {"counts": -5.0},
        {"unit": "gAPI,\n=1"},
    ],
)
def test_a_sample_that_contradicts_itself_is_counted_and_left_out(more):
    log = at_depths(100)
    log.add([dataclasses.replace(sample(50.0), **more)])
    assert list(log.unusable.values()) == [1]
    assert log.channels == ()


numbers = st.floats(allow_nan=True, allow_infinity=True)


@given(st.lists(st.tuples(numbers, numbers, numbers, numbers, numbers, numbers, numbers), max_size=8))
def test_no_number_stops_the_log_or_makes_it_longer_than_a_well(rows):
    """A good sample among samples and depths with any numbers has its place, and the log stays in the hole."""
    log = DepthLog(step_m=1.0)
    for at in range(101):
        log.add_depth(T0 + at * S, 1000.0)
        if at < len(rows):
            log.add_depth(T0 + at * S + S // 2, rows[at][0])
    names = ("value", "sigma", "counts", "span", "duration", "sensor_to_bit")
    for bit, *fields in rows:
        log.add_depth(T0 + 101 * S, bit)
        log.add([sample(50.0, **dict(zip(names, fields, strict=True)))])
    log.add([sample(90.0)])
    log.finish()
    curve = log.curve("gamma", ALL)
    assert 0 < len(curve.depth) < 15_400
    assert np.isfinite(curve.value).any()


def test_a_channel_keeps_the_unit_of_its_first_sample():
    log = at_depths(100)
    log.add([sample(15.0, 80.0), dataclasses.replace(sample(25.0, 5.0), unit="degC")])
    assert sum(log.unusable.values()) == 1
    assert log.curve("gamma", ALL).value == pytest.approx([80.0])


def test_values_and_sectors_that_change_their_number_or_are_infinite_do_not_stop_the_log():
    log = at_depths(200, 0.01)
    four = {"sectors": (1.0,) * 4, "sigma_sectors": (1.0,) * 4, "sector_durations": (2.5,) * 4}
    log.add([sample(15.0, **four), sample(25.0), sample(35.0, math.inf), sample(45.0, sigma=math.nan)])
    curve = log.curve("gamma")
    assert curve.sectors.shape[1] == 4
    assert np.isnan(curve.sigma[-1])
    assert curve.value[0] == 80.0


@pytest.mark.parametrize("which", PASSES)
def test_files_of_a_log_without_a_pass_and_of_a_well_with_a_strange_name_are_read_back(which):
    up = drilled(lambda at: 1000.0 - 0.01 * at, 300)
    up.add([dataclasses.replace(sample(20.0), channel=name) for name in ("axial_vibration", "axial_vib2")])
    for log in (up, DepthLog()):
        las = lasio.read(io.StringIO(FORMATS[".las"](log, which, Well(name="A: b\nc")).decode()))
        assert las.well.WELL.value == "A, b c"
        assert len(set(las.keys())) == len(las.keys())
        rows = FORMATS[".csv"](log, which, Well()).decode().splitlines()
        assert len(rows) == 1 + len(las["DEPT"])


def placements(monkeypatch, log, stamps):
    """Number of times that a sample is placed while samples with these stamps, s, arrive."""
    placed, place = [], log._place
    monkeypatch.setattr(log, "_place", lambda channel, one: placed.append(place(channel, one)))
    for at in stamps:
        log.add([sample(float(at))])
    return len(placed)


def test_a_clock_that_was_set_back_costs_no_more_than_any_other(monkeypatch):
    log = at_depths(5000)
    log.add([sample(4990.0)])
    assert placements(monkeypatch, log, range(100, 4980, 10)) == 488


def test_a_late_sample_costs_the_same_in_a_long_log_as_in_a_short_one(monkeypatch):
    costs = []
    for hours in (1, 3):
        log = at_depths(3600 * hours, 0.01)
        log.add(sample(float(at)) for at in range(10, 3600 * hours, 10) if at % 50)
        end = 3600 * hours // 50 * 50
        costs.append(placements(monkeypatch, log, range(end - 500, end, 50)))
        assert not log.disordered
    assert costs[0] == costs[1]


def test_a_log_without_depths_keeps_the_newest_samples_and_counts_the_others(monkeypatch):
    monkeypatch.setattr(depth_log, "_MOST_WAITING", 50)
    log = DepthLog()
    for k in range(200):
        log.add([sample(10.0 * k + 5.0)])
    assert sum(log.unusable.values()) == 150
    for at in range(0, 2001, 10):
        log.add_depth(T0 + at * S, 1000.0 + 0.01 * at)
    log.advance()
    assert total_counts(log) == pytest.approx(50 * 533.0)
    assert log.curve("gamma", ALL).depth[0] == pytest.approx(1015.0 - OFFSET, abs=0.1)


def test_a_log_with_a_short_history_of_depths_is_that_with_all():
    """Samples that come in time find their depth, however few depths are kept; one without a depth is counted."""
    whole, short = DepthLog(), DepthLog(history=100)
    for at in range(3001):
        for log in (whole, short):
            log.add_depth(T0 + at * S, ream(at))
            if at % 10 == 5 and at > 30:
                log.add([sample(at - 20.0)])
    for which in PASSES:
        one, two = whole.curve("gamma", which), short.curve("gamma", which)
        np.testing.assert_array_equal(one.value, two.value)
        np.testing.assert_array_equal(one.counts, two.counts)
    assert not short.unplaced
    short.add([sample(100.0)])
    assert (short.unplaced, short.disordered) == ({"gamma": 1}, 1)


def test_samples_at_depths_that_were_corrected_since_stay_where_a_late_sample_comes():
    log = at_depths(300, 0.01)
    log.add(sample(float(at)) for at in range(10, 300, 10) if at != 150)
    before = total_counts(log)
    log.add_depth(T0 + 100 * S, 900.0)
    log.add([sample(90.0)])
    assert total_counts(log) == pytest.approx(before + 533.0)
    assert not log.unplaced


@pytest.mark.parametrize(("most", "late", "disordered"), [(1000, 1, 0), (1000, 60, 0), (1000, 61, 1), (20, 30, 1)])
def test_a_log_keeps_only_the_samples_that_a_late_one_may_precede(monkeypatch, most, late, disordered):
    """No sample is lost; one that comes too late to be put in order is counted."""
    monkeypatch.setattr(depth_log, "_MOST_KEPT", most)
    log = at_depths(2000, 0.01)
    order = list(range(200))
    order.insert(100 + late, order.pop(100))
    held = []
    for k in order:
        one = sample(10.0 * k + 5.0)
        log.add([one])
        held.append(weakref.ref(one))
    assert total_counts(log) == pytest.approx(200 * 533.0)
    assert log.disordered == disordered
    del one
    assert sum(reference() is not None for reference in held) <= min(most, 61)


def test_the_deepest_part_alone_is_the_end_of_the_whole():
    log = drilled(lambda at: 1000.0 + 0.01 * at, 1200)
    whole, part = log.curve("gamma"), log.curve("gamma", most=20)
    np.testing.assert_array_equal(part.value, whole.value[-20:])
    np.testing.assert_array_equal(part.depth, whole.depth[-20:])


@pytest.mark.parametrize("ahead_s", [2, 3600, 10**8])
def test_a_depth_that_is_older_than_the_last_one_replaces_the_later_ones(ahead_s):
    whole, disturbed = DepthLog(), DepthLog()
    for at in range(60):
        whole.add_depth(T0 + at * S, 1000.0 + 0.1 * at)
        disturbed.add_depth(T0 + at * S, 1000.0 + 0.1 * at)
        if at == 30:
            disturbed.add_depth(T0 + (at + ahead_s) * S, 2000.0)
    for log in (whole, disturbed):
        log.add([sample(40.0)])
    assert not disturbed.unplaced
    assert disturbed.newest()["gamma"] == whole.newest()["gamma"]
    assert disturbed.curve("gamma").depth.tolist() == whole.curve("gamma").depth.tolist()


@pytest.mark.fault_case(74)
@pytest.mark.parametrize("lasts_s", [1, 7, 60, None])
@pytest.mark.parametrize("step_m", [-600.0, -12.0, 12.0, 3000.0])
@pytest.mark.parametrize("away_m", [0.0, 9.0])
def test_a_wrong_depth_of_the_rig_stops_no_pass_after_it_has_ended(step_m, lasts_s, away_m):
    """The depth steps at 600 s, on bottom or pulled off it, and comes back after `lasts_s` or never."""

    def depth_of(at):
        wrong = 600 <= at < (math.inf if lasts_s is None else 600 + lasts_s)
        off = away_m * max(0.0, 1.0 - abs(at - 600) / 120.0)
        return 1000.0 + 0.01 * at - off + (step_m if wrong else 0.0)

    log = drilled(depth_of, 1800)
    for which in (FIRST, DEEPEST):
        filled = np.isfinite(log.curve("gamma", which).value)
        depth = log.curve("gamma", which).depth[filled]
        end = depth_of(1790) - OFFSET
        late = depth[(depth > end - 8.0) & (depth <= end)]
        assert len(late) >= 75, which


@pytest.mark.fault_case(74)
@pytest.mark.parametrize("wrong_m", [[0.0], [4000.0], [4000.0, 0.0], [0.0, 0.0, 7000.0]])
@pytest.mark.parametrize("lasts_s", [1, 30])
def test_wrong_depths_off_bottom_do_not_move_the_bottom_of_the_hole(wrong_m, lasts_s):
    """A hole is drilled to 1006 m, pulled to 956 m, and logged there again, while the rig sends wrong depths."""

    def depth_of(at):
        depth = 1000.0 + 0.01 * min(at, 600) - min(max(at - 600, 0), 50)
        part, within = divmod(at - 700, 2 * lasts_s)
        return wrong_m[part] if 0 <= part < len(wrong_m) and within < lasts_s else depth

    log = drilled(depth_of, 1200, values=lambda at: 80.0 if at < 700 else 500.0)
    for which in (FIRST, DEEPEST):
        curve = log.curve("gamma", which)
        at_956 = np.abs(curve.depth - (956.0 - OFFSET)) < 1.0
        assert not np.nanmax(curve.value[at_956], initial=0.0) > 80.0, which
