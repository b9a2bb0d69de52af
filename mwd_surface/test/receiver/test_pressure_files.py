# SPDX-License-Identifier: Apache-2.0
"""Pressure from CSV, WAV and recordings: the same samples; and what is said of bad data."""

import wave

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from scipy.io import wavfile

from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.receiver import pressure_files

TIME = np.arange(200) * 0.02
PRESSURE = 2.0e7 + 1e5 * np.random.default_rng(1).normal(size=200)


def csv(path, rows, header="time_s,pressure_pa"):
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.6f")
    return path


def test_csv_gives_either_gauge(tmp_path):
    path = csv(
        tmp_path / "p.csv", np.column_stack([TIME, PRESSURE, 2.0 * PRESSURE]), "time_s,pressure_pa,pressure_2_pa"
    )
    one, two = pressure_files.read(path), pressure_files.read(path, gauge=2)
    assert one.time_s == pytest.approx(TIME)
    assert one.pressure_pa == pytest.approx(PRESSURE)
    assert two.pressure_pa == pytest.approx(2.0 * PRESSURE)
    assert not one.notes


def test_empty_cells_are_missing_samples_and_names_may_be_quoted(tmp_path):
    rows = "".join(f"{time:.2f},{'' if k == 7 else 2e7 + k}\n" for k, time in enumerate(TIME))
    (tmp_path / "p.csv").write_text('"time_s", "pressure_pa"\n' + rows)
    read = pressure_files.read(tmp_path / "p.csv")
    assert read.time_s == pytest.approx(np.delete(TIME, 7))
    assert np.all(np.isfinite(read.pressure_pa))
    assert "1 samples are not numbers" in " ".join(read.notes)


@pytest.mark.parametrize(
    ("time", "words"),
    [
        (0.0 * TIME, "1 samples of pressure with rising times"),
        (TIME + np.where(np.arange(200) < 100, 0.0, 1.7e9), "the time jumps by 1"),
    ],
)
def test_a_clock_that_stands_or_was_set_is_refused(tmp_path, time, words):
    with pytest.raises(ValueError, match=words):
        pressure_files.read(csv(tmp_path / "p.csv", np.column_stack([time, PRESSURE])))


@pytest.mark.parametrize("kind", ["f4", "f8"])
def test_wav_of_floats(tmp_path, kind):
    wavfile.write(tmp_path / "p.wav", 50, np.sin(TIME).astype(kind))
    assert pressure_files.read(tmp_path / "p.wav").pressure_pa / 1.0e7 == pytest.approx(np.sin(TIME), abs=1e-6)


@pytest.mark.parametrize("width", [2, 3, 4])
def test_wav_of_any_width_has_the_shape_of_the_pressure(tmp_path, width):
    shape = np.sin(TIME)
    whole = np.round(shape * (2 ** (8 * width - 1) - 1)).astype("<i4")
    with wave.open(str(tmp_path / "p.wav"), "wb") as file:
        file.setparams((1, width, 50, 0, "NONE", ""))
        file.writeframes(whole.astype("<i4").view(np.uint8).reshape(-1, 4)[:, :width].tobytes())
    read = pressure_files.read(tmp_path / "p.wav")
    assert read.time_s == pytest.approx(TIME)
    assert read.pressure_pa / 1.0e7 == pytest.approx(shape, abs=1e-4)
    with pytest.raises(ValueError, match="no gauge 2"):
        pressure_files.read(tmp_path / "p.wav", gauge=2)


def test_recording_with_fluid_pressure(tmp_path):
    store = get_typestore(Stores.ROS2_JAZZY)
    kind = "sensor_msgs/msg/FluidPressure"
    types = store.types
    with BagWriter(tmp_path / "bag") as writer:
        topic = writer.topic("/well_1/rig/standpipe", kind)
        for t, p in zip(TIME, PRESSURE, strict=True):
            stamp = types["builtin_interfaces/msg/Time"](sec=1_700_000_000 + int(t), nanosec=round(t % 1 * 1e9))
            header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="standpipe")
            message = types[kind](header=header, fluid_pressure=float(p), variance=0.0)
            writer.write(topic, bytes(store.serialize_cdr(message, kind)), stamp.sec * 10**9 + stamp.nanosec)
    read = pressure_files.read(tmp_path / "bag")
    assert read.time_s == pytest.approx(TIME)
    assert read.pressure_pa == pytest.approx(PRESSURE)
    assert "1700000000" in read.origin


def test_bad_data_is_told(tmp_path):
    bad = np.clip(PRESSURE, None, 2.005e7)
    bad[50] = np.nan
    time = TIME.copy()
    time[100:] += 60.0
    notes = " ".join(pressure_files.read(csv(tmp_path / "p.csv", np.column_stack([time, bad]))).notes)
    assert "1 samples are not numbers" in notes
    assert "1 gaps" in notes
    assert "clips" in notes
    coarse = csv(tmp_path / "c.csv", np.column_stack([TIME, np.round(PRESSURE, -5)]))
    assert "resolution" in " ".join(pressure_files.read(coarse).notes)


def test_a_gauge_that_is_frozen_for_a_while_and_a_clipped_end_are_named(tmp_path):
    time = np.arange(0.0, 60.0, 0.02)
    pressure = 2.0e7 * (time > 5.0) + 1e5 * np.random.default_rng(1).normal(size=len(time))
    plain = np.maximum(pressure, 0.0)

    def notes(values):
        return " ".join(pressure_files.read(csv(tmp_path / "p.csv", np.column_stack([time, values]))).notes)

    assert notes(plain) == ""
    held = plain.copy()
    for begin, end in ((20.0, 27.0), (40.0, 43.0)):
        held[(time > begin) & (time < end)] = held[np.searchsorted(time, begin)]
    assert "frozen for 10 s in 2 spans, first at 20 s" in notes(held)
    assert "frozen" not in notes(np.round(plain, -5))
    assert "at the highest value" in notes(np.minimum(plain, 2.01e7))
    assert "at the lowest value" in notes(np.where(time > 5.0, np.maximum(plain, 1.99e7), 1.99e7))


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("p.csv", b"a,b\n1,2\n", "a column of pressure; the columns are a, b"),
        ("p.csv", b"time_s,pressure_pa\n1,x\n", "too few"),
        ("p.csv", b"time_s,pressure_pa\n1,2\n", "too few"),
        ("p.wav", b"RIFFnothing", "not a WAV"),
        ("p.wav", b"RIFF\x24\0\0\0WAVEfmt \x10\0\0\0\1\0\1\0\x32\0\0\0\x64\0\0\0\2\0\x10\0data\0\0\0\0", "0 samples"),
    ],
)
def test_a_file_without_samples_is_refused(tmp_path, name, content, complaint):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=complaint):
        pressure_files.read(tmp_path / name)


def test_a_table_without_pumps_has_no_strokes(tmp_path):
    with pytest.raises(ValueError, match="a column pump"):
        pressure_files.read_strokes(csv(tmp_path / "p.csv", np.column_stack([TIME, PRESSURE])))
