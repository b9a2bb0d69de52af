# SPDX-License-Identifier: Apache-2.0
"""One row per second of a recording: the last known values, empty where unknown, the same in both kinds of file."""

import csv
import itertools
import math
import tracemalloc

import numpy as np
import plotted_bag
import pytest
from pyarrow import parquet
from test_cli import mwd, refused

from mwd_sensors.core import wire
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.exports import time_series

S = 10**9
START = 1_772_000_000


def attitudes(stamps_ns, **values):
    samples = np.zeros(len(stamps_ns), dtype=wire.ATTITUDE.dtype)
    samples["stamp_ns"] = stamps_ns
    for name in ("inclination", "azimuth", "gravity_toolface"):
        samples[name] = 1.0
        samples[f"sigma_{name}"] = 0.01
    samples["north"] = 2
    for name, value in values.items():
        samples[name] = value
    return samples


def bag_of(path, *blocks, topic="/w1/attitude", layout=wire.ATTITUDE):
    with BagWriter(path) as bag:
        channel = bag.topic(topic, layout.type_name)
        for samples in blocks:
            # A stamp that lies by years is logged within the recording all the same.
            logged = START * S + (samples["stamp_ns"] - START * S) % (10**6 * S)
            bag.write_rows(channel, layout.encode(samples, "sonde_link"), logged)
    return path


def table(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def test_a_row_is_the_last_known_value_of_the_second_that_ends_there(tmp_path):
    stamps = [START * S + k * S // 4 for k in range(1, 9)]
    samples = attitudes(stamps, inclination=np.radians(np.arange(8.0)))
    samples["azimuth"][4:] = samples["sigma_azimuth"][4:] = np.nan
    samples["azimuth"][3] = math.radians(359.99999)
    with Bag(bag_of(tmp_path / "bag", samples)) as bag:
        written = time_series.write(bag, tmp_path / "ts.csv")
    assert (written.rows, written.late, written.topics) == (2, 0, ("/w1/attitude",))
    first, second = table(tmp_path / "ts.csv")
    assert first["timestamp_utc_iso"] == "2026-02-25T06:13:21.000Z"
    assert (first["inc_deg"], second["inc_deg"]) == ("3.0000", "7.0000")
    assert (first["azi_deg"], first["azimuth_north"]) == ("0.0000", "true")
    assert (second["azi_deg"], second["sigma_azi_deg"], second["azimuth_north"]) == ("", "", "")
    assert first["bit_depth_m"] == first["rpm"] == ""


def test_rig_data_count_only_while_their_bit_is_set(tmp_path):
    samples = np.zeros(2, dtype=wire.RIG_STATE.dtype)
    samples["stamp_ns"] = [START * S, (START + 5) * S]
    values = {"bit_depth": 100.5, "rotary_speed": 4.0 * math.pi, "flow_rate": 0.03, "pressure": 2e7, "hookload": 9e5}
    for name, value in values.items():
        samples[name] = value
    samples["valid"] = [1 | 8 | 64 | 128 | 256, 1]
    path = bag_of(tmp_path / "bag", samples, topic="/w1/rig/state", layout=wire.RIG_STATE)
    with Bag(path) as bag:
        time_series.write(bag, tmp_path / "ts.csv")
    first, second = table(tmp_path / "ts.csv")
    names = ("bit_depth_m", "hole_depth_m", "rpm", "flow_l_per_min", "pressure_kpa", "hookload_kn", "inc_deg")
    assert [first[name] for name in names] == ["100.500", "", "120.00", "1800.0", "20000.0", "900.00", ""]
    assert [second[name] for name in names] == ["100.500", "", "", "", "", "", ""]


@pytest.fixture(scope="module")
def plotted(tmp_path_factory):
    """The recording of a run with its estimates."""
    path = tmp_path_factory.mktemp("plotted") / "bag"
    plotted_bag.record(path, surveys=False)
    return path


@pytest.mark.slow
def test_rows_do_not_depend_on_how_a_recording_falls_into_blocks(plotted, monkeypatch):
    found = []
    for size in (7, 16384):
        blocks = Bag.blocks
        monkeypatch.setattr(
            Bag,
            "blocks",
            lambda self, topics, *span, size=size, blocks=blocks, **fields: blocks(
                self, topics, *(span or (None, None)), **{"block_messages": size} | fields
            ),
        )
        with Bag(plotted) as bag:
            found.append(list(time_series.rows(bag, time_series.Written())))
        monkeypatch.undo()
    assert found[0] == found[1]
    assert len(found[0]) > 30
    assert all(b.second - a.second == 1 for a, b in itertools.pairwise(found[0]))


@pytest.mark.slow
def test_memory_does_not_grow_with_the_recording(tmp_path):
    def blocks(hours):
        for k in range(hours):
            yield attitudes((START + 3600 * k) * S + np.arange(3600 * 4) * (S // 4))

    peaks = []
    for hours in (2, 6):
        path = bag_of(tmp_path / str(hours), *blocks(hours))
        with Bag(path) as bag:
            tracemalloc.start()
            written = time_series.write(bag, tmp_path / "ts.csv")
            peaks.append(tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
        assert written.rows == hours * 3600 + 1
    # How far reading runs ahead of writing depends on the machine; growth with the recording would be threefold.
    assert peaks[1] < 2.0 * peaks[0]


def test_one_stamp_that_lies_makes_nothing_else_late(tmp_path):
    stamps = START * S + np.arange(40_000) * (S // 100)
    stamps[20_000] = 2 * 10**18
    with Bag(bag_of(tmp_path / "bag", attitudes(stamps))) as bag:
        written = time_series.write(bag, tmp_path / "ts.csv")
    assert written.late == 0
    assert written.rows == 402


@pytest.mark.slow
def test_parquet_holds_the_numbers_of_the_csv(plotted, tmp_path):
    with Bag(plotted) as bag:
        for ending in ("csv", "parquet"):
            time_series.write(bag, tmp_path / f"ts.{ending}")
    got = parquet.read_table(tmp_path / "ts.parquet").to_pylist()
    for row, line in zip(got, table(tmp_path / "ts.csv"), strict=True):
        for key, text in line.items():
            assert row[key] == (
                None if not text else text if key in ("timestamp_utc_iso", "azimuth_north") else float(text)
            )


def test_the_attitude_over_the_link_counts_where_there_is_no_other(tmp_path):
    ours, link = attitudes([START * S]), attitudes([START * S], inclination=0.5)
    with BagWriter(tmp_path / "both") as bag:
        for topic, samples in (("/w1/link/attitude", link), ("/w1/attitude", ours)):
            channel = bag.topic(topic, wire.ATTITUDE.type_name)
            bag.write_rows(channel, wire.ATTITUDE.encode(samples, "sonde_link"), samples["stamp_ns"])
    alone = bag_of(tmp_path / "alone", link, topic="/w1/link/attitude")
    for path, topic in ((tmp_path / "both", "/w1/attitude"), (alone, "/w1/link/attitude")):
        with Bag(path) as bag:
            assert time_series.write(bag, tmp_path / "ts.csv").topics == (topic,)


def test_the_command_writes_it_and_names_what_is_missing(tmp_path):
    path = bag_of(tmp_path / "run_7", attitudes([START * S]))
    done = mwd("export", path, "-f", "timeseries", "-o", tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"written: {tmp_path / 'run_7-timeseries.csv'} (1 rows of /w1/attitude)\n"
    refused(mwd("export", path, "-f", "timeseries", "-o", tmp_path / "a.xls"), ".csv or .parquet")
    refused(mwd("export", path, "-f", "timeseries", "-o", tmp_path, "--well", "w9"), "neither attitude nor rig data")
