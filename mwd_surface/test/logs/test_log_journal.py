# SPDX-License-Identifier: Apache-2.0
"""A surface node that starts again has the log and the health of the tool from before."""

import dataclasses
import errno
import math

import numpy as np
import pytest

from mwd_sensors.telemetry.log_channels import LogSample
from mwd_sensors.telemetry.tool_limits import ExposureLimit, ToolLimits
from mwd_surface.logs.depth_log import FIRST, DepthLog
from mwd_surface.logs.log_journal import LogJournal, lines_of, restore
from mwd_surface.logs.tool_health import HealthLedger

S = 10**9
T0 = 10**18
GAMMA = LogSample(T0, "gamma", "gAPI", 10.0, 10.0, 80.0, 5.0, 53.0, 8.0, (math.nan, 2.0), (1.0, 2.0), (0.0, 5.0))


def drill(path, begin, end, most_bytes=10**9):
    """Drill from `begin` to `end`, s, with a surface that starts anew; return its log and health."""
    log, health = DepthLog(), HealthLedger()
    journal = LogJournal(path, most_bytes)
    journal.restore(log, health)
    for at in range(begin, end):
        log.add_depth(T0 + at * S, 100.0 + 0.01 * at)
        health.add_flow(T0 + at * S, pumping=True)
        journal.add_rig(T0 + at * S, 100.0 + 0.01 * at, pumping=True)
        if at % 10 == 5:
            for one in (
                dataclasses.replace(GAMMA, stamp_ns=T0 + at * S, value=80.0 + at % 7),
                LogSample(T0 + at * S, "temperature", "degC", 10.0, 10.0, 130.0, 0.5, source="temperature"),
                LogSample(T0 + at * S, "axial_vibration", "m/s^2", 10.0, 10.0, math.inf, math.nan),
            ):
                log.add([one])
                health.add(one)
                journal.add_sample(one)
    journal.close()
    return log, health, journal


def test_a_restart_changes_neither_log_nor_health(tmp_path):
    whole, health, _ = drill(tmp_path / "one", 0, 2000)
    for at in (0, 500, 505, 1205):
        drill(tmp_path / "two", at, {0: 500, 500: 505, 505: 1205, 1205: 2000}[at])
    again, health_again, _ = drill(tmp_path / "two", 2000, 2000)
    assert health_again.health() == health.health()
    assert again.channels == whole.channels
    for one, two in zip(whole.curves(FIRST), again.curves(FIRST), strict=True):
        for field in dataclasses.fields(one):
            np.testing.assert_array_equal(getattr(one, field.name), getattr(two, field.name))


def test_a_torn_line_and_foreign_text_cost_that_line_alone(tmp_path):
    path = tmp_path / "journal"
    drill(path, 0, 100)
    lines = path.read_bytes().splitlines(keepends=True)
    deep = b'{"sums":' + b"[" * 100_000 + b"\n"
    path.write_bytes(b"".join(lines[:-1]) + b"[1]\n\xff\xfe\n{}\n" + deep + lines[-1][: len(lines[-1]) // 2])
    log, _, journal = drill(path, 100, 200)
    assert journal.unreadable == 5
    log.finish()
    assert log.curves(FIRST)[1].samples.sum() >= 20


class FullDisk:
    """File on a disk that takes `room` bytes of each line and no more."""

    def __init__(self, file, room):
        self.file, self.room = file, room

    def write(self, data):
        self.file.write(data[: self.room])

    def flush(self):
        self.file.flush()
        raise OSError(errno.ENOSPC, "No space left on device")

    def close(self):
        self.file.close()
        raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("room", [0, 7])
def test_a_full_disk_costs_its_lines_alone_and_is_written_again_later(tmp_path, room):
    path = tmp_path / "journal"
    journal = LogJournal(path)
    journal.restore(DepthLog(), HealthLedger())
    journal.add_rig(T0, 100.0, pumping=True)
    journal._file = FullDisk(journal._file, room)
    for at in range(1, 5):
        journal.add_rig(T0 + at * S, 100.0, pumping=True)
        assert "No space left" in journal.fault
    journal.try_again()
    assert not journal.fault
    journal.add_rig(T0 + 9 * S, 100.0, pumping=True)
    journal.add_sample(dataclasses.replace(GAMMA, stamp_ns=T0 + 9 * S))
    journal.close()
    lines = path.read_bytes().splitlines()
    assert sum(b'"at":' in line and line.endswith(b"}") for line in lines) == 2
    log = DepthLog()
    assert restore(lines_of(path), log, HealthLedger()) == (1 if room else 0)
    log.finish()
    assert log.channels == ("gamma",)


def test_a_long_file_loses_its_older_half_and_nothing_of_the_life_of_the_tool(tmp_path):
    _, whole, _ = drill(tmp_path / "whole", 0, 6000)
    path, most = tmp_path / "journal", 100_000
    for begin in range(0, 6000, 1500):
        _, _, journal = drill(path, begin, begin + 1500, most)
        assert path.stat().st_size <= most
    size = (tmp_path / "whole").stat().st_size
    assert size > 5 * most
    log, health, journal = drill(path, 6000, 6000)
    assert journal.unreadable == 0
    assert health.health() == whole.health()
    log.finish()
    assert log.curves(FIRST)[-1].depth[-1] > 159.0


def test_a_file_that_is_too_long_when_it_is_opened_keeps_the_life_of_the_tool(tmp_path):
    path = tmp_path / "journal"
    _, whole, _ = drill(path, 0, 2000)
    most = path.stat().st_size // 2
    drill(path, 2000, 2000, most)
    assert path.stat().st_size < most
    assert drill(path, 2000, 2000)[1].health() == whole.health()
    # Sums that cannot be read leave the samples that are there.
    data = path.read_bytes()
    path.write_bytes(data.replace(b'"series":{', b'"series":[', 1))
    _, health, journal = drill(path, 2000, 2000)
    assert journal.unreadable == 1
    assert 0.0 < health.health().run_time < whole.health().run_time


def test_a_fault_of_the_disk_costs_the_account_nothing(tmp_path):
    path = tmp_path / "journal"
    log, health, journal = drill(path, 0, 100)
    journal = LogJournal(path)
    journal.restore(log, health := HealthLedger())
    journal._file.close()
    journal._file = FullDisk(path.open("ab"), 3)
    for at in range(100, 200):
        health.add_flow(T0 + at * S, pumping=True)
        journal.add_rig(T0 + at * S, 100.0, pumping=True)
    journal.try_again()
    journal.close()
    assert drill(path, 200, 200)[1].health() == health.health()


def test_sums_fit_another_width_of_the_bins():
    one, two = HealthLedger(), HealthLedger(ToolLimits(exposures={"temperature": ExposureLimit(((50.0, 10.0),))}))
    for at in range(60, 3600, 60):
        one.add(LogSample(T0 + at * S, "temperature", "degC", 60.0, 60.0, 130.0, 0.5, source="temperature"))
    two.restore(one.sums())
    (was,), (found,) = one.health().exposures, two.health().exposures
    assert found.observed == was.observed
    ((edge, seconds),) = found.bins
    assert edge <= was.bins[0][0] + 0.5 * was.width <= edge + found.width
    assert seconds == was.observed
