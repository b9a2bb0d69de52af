# SPDX-License-Identifier: Apache-2.0
"""Live sources: a gauge behind a Modbus server, a WAV through a pipe, a serial line of a pseudo terminal."""

import dataclasses
import io
import math
import os
import socket
import struct
import threading
import time
import wave

import numpy as np
import pytest
from pyModbusTCP.server import ModbusServer
from waiting import eventually, samples_of

from mwd_sensors.simulator.serial_channel import transmit
from mwd_sensors.telemetry.tool_configuration import starting
from mwd_surface.receiver.link.receivers import receiver_of
from mwd_surface.receiver.sources import GaugeSettings, ModbusGauge, SerialBytes, WavStream, gauge_pressure


def free_port():
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


@pytest.mark.parametrize(
    ("count", "pressure"), [(6400, 0.0), (32000, 3.5e7), (19200, 1.75e7), (0, math.nan), (35000, math.nan)]
)
def test_a_current_is_a_pressure_and_none_without_a_current(count, pressure):
    settings = GaugeSettings(count_4_ma=6400, count_20_ma=32000)
    assert gauge_pressure(settings, count) == pytest.approx(pressure, nan_ok=True)


def test_a_scale_of_nothing_is_refused():
    with pytest.raises(ValueError, match="differ"):
        GaugeSettings(count_4_ma=5, count_20_ma=5)


def test_a_gauge_is_read_over_modbus_and_says_what_it_lacks():
    port = free_port()
    settings = GaugeSettings(port=port, register=3, count_4_ma=6400, count_20_ma=32000, rate_hz=100.0)
    server = ModbusServer("127.0.0.1", port, no_block=True)
    server.start()
    try:
        server.data_bank.set_input_registers(3, [19200])
        gauge = ModbusGauge(settings, time.monotonic)
        times, pressures = samples_of(gauge.read, 10)
        assert np.all(np.diff(times) > 0.0)
        assert pressures == pytest.approx(1.75e7)
        assert gauge.failure == ""
        server.data_bank.set_input_registers(3, [0])
        eventually(lambda: bool(gauge.failure))
        assert "3.6 to 21 mA" in gauge.failure
        gauge.close()
    finally:
        server.stop()
    silent = ModbusGauge(dataclasses.replace(settings, port=free_port()), time.monotonic)
    eventually(lambda: "does not answer" in silent.failure)
    silent.close()


def test_a_converter_that_resets_its_connection_is_told_and_asked_again():
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(10.0)
        gauge = ModbusGauge(GaugeSettings(port=server.getsockname()[1]), time.monotonic)
        for _ in range(2):
            line, _ = server.accept()
            line.recv(64)
            # Without lingering, close sends a reset, as a converter does that starts anew.
            line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            line.close()
        eventually(lambda: "has not answered yet" not in gauge.failure)
        gauge.close()
    assert gauge.failure


def wav_stream(kind, bits, data):
    """What is read of a WAV in the extensible form."""
    width = bits // 8
    form = struct.pack("<HHIIHHHHI", 0xFFFE, 1, 50, 50 * width, width, bits, 22, bits, 0)
    form += struct.pack("<H", kind) + bytes(14)
    reading, writing = os.pipe()
    head = b"RIFF\0\0\0\0WAVE" + struct.pack("<4sI", b"fmt ", len(form)) + form
    os.write(writing, head + b"data\0\0\0\0" + data)
    os.close(writing)
    stream = WavStream(reading)
    got = stream.read()
    os.close(reading)
    return got, stream


@pytest.mark.parametrize(("kind", "bits"), [(3, 32), (3, 64), (1, 24), (1, 32)])
def test_floats_and_24_bits_are_read(kind, bits):
    shares = np.linspace(-0.9, 0.9, 100)
    if kind == 3:
        data = shares.astype(f"<f{bits // 8}").tobytes()
    else:
        codes = np.round(shares * 2 ** (bits - 1)).astype("<i4")
        data = b"".join(int(code).to_bytes(bits // 8, "little", signed=True) for code in codes)
    (times, pressures), stream = wav_stream(kind, bits, data)
    assert stream.failure == ""
    assert times == pytest.approx(np.arange(100) / 50.0)
    assert pressures == pytest.approx(1e7 * shares, abs=2.0)


def test_a_wav_through_a_pipe_is_read_as_it_comes():
    values = np.arange(-500, 500, dtype=np.int16)
    file = io.BytesIO()
    with wave.open(file, "wb") as out:
        out.setnchannels(1)
        out.setsampwidth(2)
        out.setframerate(50)
        out.writeframes(values.tobytes())
    data = file.getvalue()
    reading, writing = os.pipe()
    stream = WavStream(reading)
    got = []
    for k in range(0, len(data), 333):
        os.write(writing, data[k : k + 333])
        got.append(stream.read())
    os.close(writing)
    got.append(stream.read())
    assert stream.ended
    os.close(reading)
    times, pressures = (np.concatenate(part) for part in zip(*got, strict=True))
    assert times == pytest.approx(np.arange(1000) / 50.0)
    assert pressures == pytest.approx(values * 1e7 / 2**15)


def test_a_serial_line_is_read_to_words():
    tool = dataclasses.replace(starting("serial"), transmit_delay_s=0.0)
    data, sent = transmit(tool, 20.0, 3)
    master, slave = os.openpty()
    source = SerialBytes(os.ttyname(slave), 9600, time.monotonic)
    assert len(source.read()[0]) == 0
    writer = threading.Thread(target=os.write, args=(master, data))
    writer.start()
    times, values = samples_of(source.read, len(data))
    writer.join()
    source.close()
    assert np.all(np.diff(times) >= 0.0)
    receiver = receiver_of(tool)
    done = receiver.push(times, values)
    done.add(receiver.finish())
    assert [word.raw for word in done.words] == [word.raw for word in sent]
    os.close(master)
    os.close(slave)


def test_a_line_that_is_not_there_is_named():
    source = SerialBytes("/dev/does_not_exist", 9600, time.monotonic)
    assert len(source.read()[0]) == 0
    assert "does_not_exist" in source.failure


FORM = struct.pack("<4sI", b"fmt ", 16)
DATA = b"data\0\0\0\0" + bytes(400)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"this is no sound at all", "not a WAV"),
        (b"RIFF\0\0\0\0WAVE" + FORM + struct.pack("<HHIIHH", 17, 1, 50, 50, 1, 8) + DATA, "form 17"),
        (b"RIFF\0\0\0\0WAVE" + struct.pack("<4sI", b"fmt ", 4) + bytes(4) + DATA, "format of its samples"),
        (b"RIFF\0\0\0\0WAVE" + DATA, "format of its samples"),
        (b"RIFF\0\0\0\0WAVE" + struct.pack("<4sI", b"junk", 2**32 - 1) + bytes(3_000_000), "no samples"),
        (b"RIFF\0\0\0\0WAVE" + 400_000 * struct.pack("<4sI", b"junk", 0), "no samples"),
    ],
    ids=["not a WAV", "compressed", "short form", "no form", "endless chunk", "endless chunks"],
)
def test_a_wav_whose_samples_cannot_be_read_is_refused_with_its_reason(tmp_path, content, words):
    (tmp_path / "bad.wav").write_bytes(content)
    with (tmp_path / "bad.wav").open("rb") as file:
        stream = WavStream(file.fileno())
        for _ in range(10):
            assert not len(stream.read()[0])
    assert words in stream.failure
    assert stream.ended


def test_a_stream_that_never_pauses_is_read_in_parts(tmp_path):
    head = b"RIFF\0\0\0\0WAVE" + FORM + struct.pack("<HHIIHH", 1, 1, 48_000, 96_000, 2, 16) + b"data\0\0\0\0"
    with (tmp_path / "long.wav").open("wb") as file:
        file.write(head)
        file.truncate(len(head) + 50_000_000)
    with (tmp_path / "long.wav").open("rb") as file:
        stream, count, parts = WavStream(file.fileno()), 0, 0
        while not stream.ended:
            found = len(stream.read()[0])
            assert found < 2_000_000
            count, parts = count + found, parts + 1
    assert (count, stream.failure) == (25_000_000, "")
    assert parts > 20


@pytest.mark.parametrize("content", [b"\x04\x00", b"\x04\x01\x00", b"\x04", b"\xff" * 60])
def test_a_converter_that_answers_nonsense_is_told_and_asked_again(content):
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(10.0)
        gauge = ModbusGauge(GaugeSettings(port=server.getsockname()[1], rate_hz=50.0), time.monotonic)
        for _ in range(2):
            line, _ = server.accept()
            with line:
                line.settimeout(5.0)
                asked = line.recv(64)
                line.sendall(asked[:4] + struct.pack(">HB", len(content) + 1, 1) + content)
        eventually(lambda: "has not answered yet" not in gauge.failure)
        assert gauge.failure
        assert not len(gauge.read()[0])
        gauge.close()
