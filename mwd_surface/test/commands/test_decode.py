# SPDX-License-Identifier: Apache-2.0
"""`mwd tool` and `mwd decode` as people call them."""

import csv
import math
import shlex

import numpy as np
import pytest

from invoked_command import invoke
from mwd_sensors.core import gauge_burst, wire
from mwd_sensors.core.dipole import dipole_field
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.cli import app


def run(*words):
    return invoke(app, *words).output


def rows(path):
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A tool, its simulated pressure and what was decoded of it."""
    path = tmp_path_factory.mktemp("decode")
    run("tool", "new", "-o", path / "tool.yaml")
    run("tool", "simulate", path / "tool.yaml", "-o", path / "well", "--minutes", 5, "--depth", 3500)
    return path


@pytest.mark.slow
def test_what_is_simulated_is_decoded(folder):
    said = run("decode", folder / "well" / "pressure.csv", "--tool", folder / "tool.yaml", "-o", folder / "out")
    sent, words = rows(folder / "well" / "sent.csv"), rows(folder / "out" / "words.csv")
    believed = [row for row in words if row["status"] == "believed"]
    assert len(believed) == len(sent)
    assert [row["raw"] for row in believed] == [row["raw"] for row in sent]
    assert "7 of 7 words believed" in said
    (survey,) = rows(folder / "out" / "surveys.csv")
    assert float(survey["Inc_deg"]) == pytest.approx(float(sent[0]["value"]), abs=1e-3)
    assert 0.0 < float(survey["sigma_Inc_deg"]) < 0.05
    assert (folder / "out" / "picture.png").read_bytes().startswith(b"\x89PNG")


def test_a_configuration_is_explained(folder):
    said = run("tool", "check", folder / "tool.yaml")
    assert "survey 0: 132.8 s on air, complete 194 s after flow-on" in said
    assert "Azm:12 0 to 360 deg, step 0.0879" in said
    (folder / "sigma.yaml").write_text('survey_sequences: ["Inc:12:P sInc:4:P"]')
    # 16 codes in equal ratios: 1000 to the power of 1/15.
    assert "sInc:4 0.01 to 10 deg, each step 1.58 times" in run("tool", "check", folder / "sigma.yaml")


def test_the_channel_says_what_pulse_width_it_allows(folder):
    said = run("tool", "check", folder / "tool.yaml", "--channel", folder / "well" / "pressure.csv")
    assert "pulses of 0.8 s: " in said
    assert "shortest pulse width with 19 of 20 words right: 0." in said
    run("tool", "new", "-o", folder / "siren.yaml", "--code", "psk")
    with pytest.raises(ValueError, match="psk sends no pulses"):
        run("tool", "check", folder / "siren.yaml", "--channel", folder / "well" / "pressure.csv")


def test_a_configuration_is_not_overwritten(folder):
    with pytest.raises(FileExistsError):
        run("tool", "new", "-o", folder / "tool.yaml")


@pytest.mark.slow(7)
def test_another_pulse_width_of_the_tool_is_said_and_used(tmp_path):
    """A tool of few words: the search for its width takes a tenth of a second for each second of pressure."""
    text = 'transmit_delay_s: 20\nsurvey_sequences: ["Inc:12:P"]\ntoolface_sequences: ["aTFA:6:P"]\npulse_width_s: '
    for name, width in (("tool", "0.8"), ("other", "0.37")):
        (tmp_path / f"{name}.yaml").write_text(f"{text}{width}\n")
    run("tool", "simulate", tmp_path / "tool.yaml", "-o", tmp_path / "well", "--minutes", 2, "--depth", 2000)
    said = run("decode", tmp_path / "well/pressure.csv", "--tool", tmp_path / "other.yaml", "-o", tmp_path / "found")
    sent = [row["raw"] for row in rows(tmp_path / "well" / "sent.csv")]
    believed = [row["raw"] for row in rows(tmp_path / "found" / "words.csv") if row["status"] == "believed"]
    # The first word comes before the receiver knows the pulses well.
    assert len(believed) >= len(sent) - 1 >= 3
    assert believed == sent[-len(believed) :]
    assert "the tool sends pulses of 0.8 s, not of 0.37 s as set here" in " ".join(said.split())


@pytest.mark.slow(3)
@pytest.mark.parametrize(("code", "recording"), [("psk", "pressure.csv"), ("serial", "bytes.bin")])
def test_other_codes_are_simulated_and_decoded(tmp_path, code, recording):
    run("tool", "new", "-o", tmp_path / "tool.yaml", "--code", code)
    run("tool", "simulate", tmp_path / "tool.yaml", "-o", tmp_path / "well", "--minutes", 5)
    said = run("decode", tmp_path / "well" / recording, "--tool", tmp_path / "tool.yaml", "-o", tmp_path / "out")
    assert "7 of 7 words believed" in said
    sent, words = rows(tmp_path / "well" / "sent.csv"), rows(tmp_path / "out" / "words.csv")
    assert [row["raw"] for row in words[:7]] == [row["raw"] for row in sent[:7]]
    assert (tmp_path / "out" / "picture.png").exists() == (code != "serial")


@pytest.mark.slow
def test_a_coil_is_simulated_decoded_and_located_with_the_pitch_and_roll_that_it_sent(tmp_path):
    run("tool", "new", "-o", tmp_path / "coil.yaml", "--code", "psk")
    text = (tmp_path / "coil.yaml").read_text()
    (tmp_path / "coil.yaml").write_text(text.replace("medium: mud", "medium: coil"))
    run("tool", "simulate", tmp_path / "coil.yaml", "-o", tmp_path / "well", "--minutes", 4)
    said = run("decode", tmp_path / "well/voltage.csv", "--tool", tmp_path / "coil.yaml", "-o", tmp_path / "out")
    assert "7 of 7 words believed" in said
    sent = [row for row in rows(tmp_path / "well" / "sent.csv") if row["name"].lower() in ("inc", "rinc", "atfa")]
    pitch = 90.0 - float([row["value"] for row in sent if row["name"].lower() in ("inc", "rinc")][-1])
    axis = np.array([math.cos(math.radians(pitch)), 0.0, -math.sin(math.radians(pitch))])
    points = np.array([[north, east, 0.0] for north in (-3.0, 1.0, 4.0) for east in (-2.0, 0.0, 3.0)])
    strength = np.linalg.norm(dipole_field(points - np.array([0.5, 0.3, 4.0]), 5.0 * axis).real, axis=1)
    table = [f"{n:g},{e:g},{1e9 * s:.6g}" for (n, e, _), s in zip(points, strength, strict=True)]
    (tmp_path / "readings.csv").write_text("\n".join(["north_m,east_m,strength_nt", *table, ""]))
    words = tmp_path / "out" / "words.csv"
    options = ("--tool", tmp_path / "coil.yaml", "--words", words, "--azimuth", 10)
    said = run("tool", "locate", tmp_path / "readings.csv", *options)
    assert "north 0.50" in said
    assert "depth 4.00" in said
    assert "as the sonde sent it" in said
    (tmp_path / "bad.csv").write_text("north_m,strength_nt\n1,2\n")
    with pytest.raises(ValueError, match="no column east_m"):
        run("tool", "locate", tmp_path / "bad.csv", "--pitch", 0)


@pytest.mark.slow
def test_an_em_tool_is_simulated_and_decoded(tmp_path):
    run("tool", "new", "-o", tmp_path / "em.yaml", "--code", "psk")
    text = (tmp_path / "em.yaml").read_text().replace("medium: mud", "medium: earth").replace("12.0", "6.0")
    (tmp_path / "em.yaml").write_text(text)
    assert "QPSK on 6 Hz in the earth" in run("tool", "check", tmp_path / "em.yaml")
    run("tool", "simulate", tmp_path / "em.yaml", "-o", tmp_path / "well", "--minutes", 4, "--depth", 2000)
    said = run("decode", tmp_path / "well" / "voltage.csv", "--tool", tmp_path / "em.yaml", "-o", tmp_path / "out")
    assert "7 of 7 words believed" in said


def test_a_source_that_does_not_fit_the_tool_is_refused(folder):
    with pytest.raises(ValueError, match="must be modbus:HOST:PORT"):
        run("listen", "serial:/dev/ttyUSB0", "--tool", folder / "tool.yaml", "-o", folder / "heard")


def test_inspect_prints_the_command_that_decodes_a_recorded_pressure(folder, tmp_path):
    table = np.genfromtxt(folder / "well" / "pressure.csv", delimiter=",", names=True)
    time, pressure = (table[name] for name in table.dtype.names[:2])
    pressure_pa = pressure * (1.0 if pressure.max() > 1e6 else 1e5)
    with BagWriter(tmp_path / "bag") as bag:
        topic = bag.topic("/well/rig/standpipe", gauge_burst.PRESSURE)
        for first in range(0, len(time), 100):
            stamp = 1_772_345_678 * wire.NANOSECONDS + round(time[first] * wire.NANOSECONDS)
            part = pressure_pa[first : first + 100]
            bag.write(topic, gauge_burst.encode(stamp, float(time[1] - time[0]), part), stamp)
    said = run("inspect", tmp_path / "bag", "-o", tmp_path / "words")
    assert "/well/rig/standpipe" in said
    command = shlex.split(said.strip().splitlines()[-1].replace("TOOL.yaml", str(folder / "tool.yaml")))
    assert command[:2] == ["mwd", "decode"]
    run(*command[1:])
    believed = [row["raw"] for row in rows(tmp_path / "words" / "words.csv") if row["status"] == "believed"]
    assert believed == [row["raw"] for row in rows(folder / "well" / "sent.csv")]
