# SPDX-License-Identifier: Apache-2.0
"""A probe on a pseudo terminal: its samples to the bit, its clock, and a line that is lost and found again."""

import contextlib
import os
import select
import threading
import time
import tty

import numpy as np
import pytest
import yaml

from mwd_sensors.core import burst, input_covariance, wire
from mwd_sensors.drivers import mtdata2, polled_line, probe_protocol, serial_probe
from mwd_sensors.drivers.emulator import NAME, XSENS_FIELD_T, Emulator
from mwd_sensors.drivers.readings import LAYOUTS, UnitAnswer, UnitSample, readings_of, samples_of
from mwd_sensors.drivers.serial_probe import LineSettings, SerialProbe, UnitClock, polled_frame
from mwd_sensors.simulator import scenario
from mwd_sensors.simulator.sonde import Sonde

START = 1_772_344_800_000_000_000


def measured(seconds=2.0):
    """Samples of all topics of a probe."""
    rng = np.random.default_rng(4)
    n = round(100 * seconds)
    imu, gyro, mag, temperature = burst.bare(n), burst.bare(n), wire.MAG.empty(n), wire.TEMPERATURE.empty(n // 100)
    for one in (imu, gyro, mag):
        one["stamp_ns"] = START + np.arange(n) * 10_000_000
    temperature["stamp_ns"] = START + np.arange(n // 100) * 1_000_000_000
    for one in (imu, gyro):
        one["angular_velocity"], one["linear_acceleration"] = rng.normal(size=(2, n, 3))
    mag["magnetic_field"], temperature["temperature"] = rng.normal(size=(n, 3)), 40.0
    return {"imu/data_raw": imu, "imu/mag": mag, "gyro/data_raw": gyro, "imu/temperature": temperature}


@contextlib.contextmanager
def emulated(sent, rate=0.0, protocol="binary", **settings):
    """A probe on the line of an emulated unit that plays these blocks; the player's thread."""
    frame = polled_frame(LineSettings(protocol=protocol, **settings)) if protocol == "polled" else None
    with Emulator(protocol, wait_for_start=True, frame=frame) as emulator:
        probe = SerialProbe(LineSettings(port=emulator.device, protocol=protocol, **settings))
        player = threading.Thread(target=emulator.play, args=(sent, rate))
        player.start()
        yield probe, player
        player.join()
        probe.close()


@contextlib.contextmanager
def bare_line(**settings):
    """The unit's end of a line, and a probe at the other end that has been polled once."""
    unit, line = os.openpty()
    tty.setraw(line)
    probe = SerialProbe(LineSettings(port=os.ttyname(line), **settings))
    probe.poll(START)
    yield unit, probe
    probe.close()
    os.close(line)
    os.close(unit)


def count(sent):
    return sum(len(samples) for samples in sent.values())


def received(probe, until, within=30.0):
    """Readings until the wanted number has come; the line is read as a node's timer does."""
    got, end = [], time.monotonic() + within
    while len(got) < until and time.monotonic() < end:
        got += probe.poll(time.time_ns())
    assert len(got) >= until
    return got


def received_to_the_end(probe, player):
    """Readings until the player has ended."""
    got = []
    while player.is_alive():
        got += probe.poll(time.time_ns())
    return got


@pytest.mark.parametrize("protocol", ["binary", "ascii"])
def test_what_a_probe_sends_comes_to_the_bit(protocol):
    sent = measured()
    with emulated([sent], protocol=protocol, clock="unit") as (probe, _):
        got = received(probe, count(sent))
        counters = probe.reader.counters
        assert (probe.info, counters.broken, counters.lost) == (NAME, 0, 0)
    for topic, samples in sent.items():
        mine = samples_of(topic, [one for one in got if one.topic == topic])
        assert mine.tobytes() == samples.tobytes()


def test_the_line_stays_until_the_host_has_read_the_last_sample():
    sent = measured(0.1)
    emulator, splitter = Emulator("binary"), probe_protocol.Splitter(text=False)
    host = os.open(emulator.device, os.O_RDONLY | os.O_NOCTTY)

    def play():
        with emulator:
            emulator.play([sent], 0.0)

    player = threading.Thread(target=play)
    player.start()
    player.join(1.0)
    assert player.is_alive()
    got = 0
    while got < count(sent):
        got += len(list(splitter.feed(os.read(host, 100))))
    player.join()
    os.close(host)
    assert got == count(sent)


def test_a_scenario_is_played_though_most_of_its_blocks_have_no_temperature():
    sent = list(Sonde(scenario.parse("name: short\nschedule: [{kind: still, seconds: 1.5}]")).blocks(0.1))
    assert min(len(block["imu/temperature"]) for block in sent) == 0
    with emulated(sent, clock="unit") as (probe, _):
        got = received(probe, sum(len(block[topic]) for block in sent for topic in LAYOUTS))
    assert {one.topic for one in got} == set(LAYOUTS)
    for topic, layout in LAYOUTS.items():
        assert readings_of(topic, layout.empty(0)) == []
        assert len(samples_of(topic, [])) == 0


def test_an_mti_on_a_line_gives_the_rates_and_forces_of_its_increments_its_field_and_its_clip_flags():
    sent = measured()
    clipped = np.arange(600).reshape(-1, 3) % 7 == 0
    for field in ("angular_velocity", "linear_acceleration"):
        input_covariance.mark_clipped(sent["imu/data_raw"], field, clipped)
    topics = ("imu/mag", "imu/temperature", "imu/data_raw")
    with emulated([sent], protocol="xsens", clock="unit", xsens_field_ut=1e6 * XSENS_FIELD_T) as (probe, _):
        # The interval of the first packet is not known.
        got = received(probe, sum(len(sent[topic]) for topic in topics) - 1)
    mag, temperature, mine = (samples_of(topic, [one for one in got if one.topic == topic]) for topic in topics)
    assert mag["magnetic_field"] == pytest.approx(sent["imu/mag"]["magnetic_field"], rel=1e-12)
    assert temperature["temperature"] == pytest.approx(sent["imu/temperature"]["temperature"], rel=1e-12)
    for field in ("angular_velocity", "linear_acceleration"):
        assert mine[field] == pytest.approx(sent["imu/data_raw"][field][1:], rel=1e-9, abs=1e-12)
        assert np.array_equal(input_covariance.clipped(mine, field), clipped[1:])
    assert set(np.diff(mine["stamp_ns"]).tolist()) == {10_000_000}


def test_the_unit_s_time_is_brought_to_that_of_the_host():
    sent = measured(1.0)
    for samples in sent.values():
        samples["stamp_ns"] -= START  # a unit whose clock begins at zero
    with emulated([sent], 1.0) as (probe, player):
        got = received_to_the_end(probe, player)
        assert probe.clock.jumps == 0
        assert got[0].stamp_ns + probe.offset_ns == pytest.approx(time.time_ns(), abs=5e9)


@pytest.mark.slow
def test_a_line_that_is_lost_is_opened_again(tmp_path):
    sent, link = measured(1.0), tmp_path / "probe"
    settings = LineSettings(port=str(link), clock="unit")
    probe = SerialProbe(settings)
    assert probe.poll(1) == []
    assert "No such file" in probe.failure
    for round_ in (1, 2):
        with Emulator("binary", link, wait_for_start=True) as emulator:
            player = threading.Thread(target=emulator.play, args=([sent], 0.0))
            player.start()
            received(probe, count(sent))
            player.join()
            assert probe.connections == round_
        end = time.monotonic() + 10.0
        while probe.connected and time.monotonic() < end:
            probe.poll(time.time_ns())
        assert "was lost" in probe.failure
    assert not probe.stream(True)


def heard(unit, last):
    """What the unit hears up to a word: the system hands over a line in pieces."""
    data = b""
    while last not in data or not data.endswith(b"\n"):
        assert select.select([unit], [], [], 10.0)[0], data
        data += os.read(unit, 4096)
    return data


def test_a_unit_that_was_without_power_is_asked_for_samples_again(monkeypatch):
    monkeypatch.setattr(serial_probe, "_FIRST_S", 0.0)
    with bare_line(protocol="ascii") as (unit, probe):
        heard(unit, b"$START")
        # It was switched on only now.
        probe.poll(START)
        heard(unit, b"$START")
        assert probe.stream(False)
        heard(unit, b"$STOP")
        probe.poll(START)
        assert b"$START" not in heard(unit, b"$TIME")


def test_a_line_that_takes_nothing_does_not_hold_the_node_up():
    with bare_line() as (_, probe):
        assert not all(probe.stream(True) for _ in range(20_000))
        assert probe.connected


def test_the_offset_of_a_clock_follows_the_fastest_message_slowly_and_a_new_start_at_once():
    clock = UnitClock()
    rng = np.random.default_rng(3)
    offsets = []
    for k in range(2000):
        unit_ns = k * 10_000_000
        # A unit that runs 20 ppm slow, 5 s behind, with messages up to 3 ms on the way.
        host_ns = round(unit_ns * (1 + 20e-6)) + 5_000_000_000 + int(rng.exponential(1e6))
        clock.observe(unit_ns, host_ns)
        offsets.append(clock.offset_ns)
    assert abs(np.diff(offsets[5:])).max() <= 5e-4 * 16_000_000
    assert offsets[-1] == pytest.approx(5_000_400_000, abs=400_000)
    clock.observe(0, 90_000_000_000)
    assert clock.jumps == 1
    assert clock.offset_ns == 90_000_000_000


def observed(clock, first, count, offset_s, step_s=1.0, way=0):
    """Take observations of a unit's clock, each `step_s` after the one before."""
    for k in range(first, first + count):
        unit_ns = round(k * step_s * 1e9)
        clock.observe(unit_ns, unit_ns + round(offset_s * 1e9), way)


def test_the_offset_of_a_unit_whose_first_answers_are_off_is_known_once_it_stays_and_never_jumps():
    clock = UnitClock()
    observed(clock, 0, 2, 900.0, step_s=0.1)
    assert (clock.jumps, clock.offset_ns) == (-1, 0)
    observed(clock, 1, 2, 5.0, step_s=0.1)
    assert clock.jumps == -1
    observed(clock, 3, 20, 5.0)
    assert (clock.jumps, clock.offset_ns) == (0, 5_000_000_000)


class WithoutDelay:
    """A line whose bytes arrive at once; a pseudo terminal delivers them some time later."""

    def __init__(self):
        self.data, self.taken = b"", os.open(os.devnull, os.O_WRONLY)

    @property
    def in_waiting(self):
        return len(self.data)

    def read(self, _size):
        data, self.data = self.data, b""
        return data

    def write(self, data):
        return os.write(self.taken, data)

    def fileno(self):
        return self.taken

    def close(self):
        os.close(self.taken)


@pytest.mark.parametrize("protocol", ["binary", "ascii", "xsens"])
def test_no_sample_of_a_unit_that_restarts_has_the_stamp_of_its_earlier_start(protocol, monkeypatch):
    """After 3 s a unit that has run for an hour is without power for half a second; samples come before its time."""
    line, got = WithoutDelay(), []
    monkeypatch.setattr(serial_probe.serial, "Serial", lambda *_, **__: line)
    probe = SerialProbe(LineSettings(protocol=protocol))
    for k in range(600):
        host_ns = START + k * 10_000_000
        unit_ns = 3_600_000_000_000 + k * 10_000_000 if k < 300 else (k - 350) * 10_000_000
        if protocol == "xsens":
            one = UnitSample("imu/data_raw", 0, (0.1, 0.0, 0.0, 9.8, 0.0, 0.0))
            line.data = mtdata2.packet(one, 0.01, unit_ns // 100_000, unit_ns // 10_000_000)
        else:
            one = UnitSample("imu/temperature", unit_ns, (50.0,))
            line.data = probe_protocol.sample(one, k, protocol == "ascii")
            if k % 40 == 39:
                answer = UnitAnswer("time", sent_ns=host_ns, unit_ns=unit_ns)
                line.data += probe_protocol.answer(answer, k, protocol == "ascii")
        if not 300 <= k < 350:
            got += [(one.stamp_ns + probe.offset_ns - host_ns, k) for one in probe.poll(host_ns)]
    probe.close()
    late, at = np.array(got).T
    assert abs(late).max() < 50_000_000
    assert probe.clock.jumps == 1
    assert at.min() < 130
    assert np.sum(at > 350) > 100


def test_the_time_of_the_emulated_unit_runs_before_and_between_its_samples():
    sent = measured(1.0)

    def slowly():
        yield {topic: samples[:50] for topic, samples in sent.items()}
        time.sleep(1.0)
        yield {topic: samples[50:] for topic, samples in sent.items()}

    with emulated(slowly(), 1.0) as (probe, player):
        got = received_to_the_end(probe, player)
        assert probe.clock.jumps == 0
        assert got[0].stamp_ns + probe.offset_ns == pytest.approx(time.time_ns(), abs=8e9)


def test_a_host_that_was_held_up_does_not_move_the_clock_of_the_unit():
    clock = UnitClock()
    observed(clock, 0, 20, 5.0)
    # Eight seconds of messages that waited are read within a few milliseconds.
    for k in range(20, 28):
        clock.observe(k * 1_000_000_000, 33_000_000_000 + k * 1_000_000)
    observed(clock, 28, 20, 5.0)
    assert clock.jumps == 0
    assert clock.offset_ns == 5_000_000_000


@pytest.mark.parametrize("set_s", [0.4, -0.4, 3600.0, -3600.0])
def test_a_clock_of_the_host_that_was_set_is_followed_once_it_stays(set_s):
    clock = UnitClock()
    observed(clock, 0, 20, 5000.0)
    observed(clock, 20, 2, 5000.0 + set_s)
    assert clock.jumps == 0
    observed(clock, 22, 5, 5000.0 + set_s)
    assert clock.jumps == 1
    assert clock.offset_ns == round((5000.0 + set_s) * 1e9)


@pytest.mark.parametrize("stamp_ns", [-1, 2**63 - 1, -(2**63)])
def test_a_sample_of_a_time_that_no_message_can_have_is_broken_and_the_next_is_read(stamp_ns):
    samples = (UnitSample("imu/temperature", stamp, (50.0,), 0) for stamp in (START, stamp_ns, START + 1))
    with bare_line(clock="unit") as (unit, probe):
        os.write(unit, b"".join(probe_protocol.sample(one, k, text=False) for k, one in enumerate(samples)))
        assert [one.stamp_ns for one in received(probe, 2)] == [START, START + 1]
        assert probe.reader.counters.broken == 1


@pytest.fixture
def frame_of(tmp_path):
    """Write the file of a frame with a poll of these quantities, and return its path."""

    def write(items, **settings):
        poll = {"items": [{"quantity": "time", "form": "int64", "step": 1e-9}, *items]}
        (tmp_path / "frame.yaml").write_text(yaml.safe_dump({**settings, "polls": [poll]}))
        return str(tmp_path / "frame.yaml")

    return write


def test_a_polled_unit_gives_each_sample_as_it_is_asked(frame_of):
    items = [{"quantity": name, "form": "float64"} for topic in polled_line.NAMES.values() for name in topic]
    frame, sent = frame_of(items, start="7e", address=9, period_s=0.001, timeout_s=5.0), measured(1.0)
    with emulated([sent], protocol="polled", clock="unit", frame_file=frame) as (probe, player):
        got = received_to_the_end(probe, player)
    assert probe.reader.trouble == {}
    for topic in ("imu/data_raw", "imu/mag", "gyro/data_raw"):
        mine = samples_of(topic, [one for one in got if one.topic == topic])
        assert mine.tobytes() == sent[topic].tobytes()[-mine.nbytes :]
        assert len(mine) >= len(sent[topic]) - 1


def test_a_host_slower_than_the_unit_gets_the_newest_sample_and_none_twice(frame_of):
    names = ("temperature", *polled_line.NAMES["imu/data_raw"])
    frame = frame_of([{"quantity": name} for name in names], period_s=0.1)
    with emulated([measured(2.0)], 1.0, protocol="polled", clock="unit", frame_file=frame) as (probe, player):
        got = received_to_the_end(probe, player)
    stamps = [one.stamp_ns for one in got if one.topic == "imu/data_raw"]
    assert 10 <= len(stamps) <= 25
    # None twice and none older than the last; how far they lie apart depends on the machine.
    assert (np.diff(stamps) > 0).all()


def test_a_unit_without_a_clock_is_stamped_between_request_and_reply(tmp_path):
    frame = tmp_path / "frame.yaml"
    frame.write_text("polls: [{items: [{quantity: temperature, form: int16, step: 0.1}]}]")
    with pytest.raises(ValueError, match="set clock to host"):
        polled_frame(LineSettings(protocol="polled", frame_file=str(frame), clock="unit"))
    with bare_line(protocol="polled", frame_file=str(frame)) as (unit, probe):
        probe.poll(START)
        end = polled_line.PolledLineUnit(probe.reader.frame)
        asked = end.feed(os.read(unit, 100))
        os.write(unit, polled_line.reply(end.frame, asked, {"temperature": 41.5}))
        got, stop = [], time.monotonic() + 10.0
        while not got and time.monotonic() < stop:
            got = probe.poll(START + 1_000_000_000)
        assert got[0].values == (41.5,)
        assert START <= got[0].stamp_ns <= START + 1_000_000_000
        assert probe.offset_ns == 0
