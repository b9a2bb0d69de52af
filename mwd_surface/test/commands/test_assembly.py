# SPDX-License-Identifier: Apache-2.0
"""`mwd sag` and `mwd spacing` as people call them: the figures of the models, and one sentence for what is no input."""

import csv
import math

import pytest
import typer

from invoked_command import invoke
from mwd_estimation.assembly.assembly import read_assembly
from mwd_estimation.assembly.sag import sag as sag_of
from mwd_surface.commands.assembly import sag, spacing

APP = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
APP.command()(sag)
APP.command()(spacing)
BHA = """
hole_mm: 215.9
sensor_m: 15
components:
  - {name: bit, length_m: 0.3, od_mm: 215.9, id_mm: 50}
  - {name: motor, length_m: 8.7, od_mm: 171, id_mm: 100, blades: [{at_m: 0.9, od_mm: 212.7}], pole_uwb: 1000}
  - {name: NMDC, length_m: 20, od_mm: 165, id_mm: 71, magnetic: false}
"""
FIELD = ("--field", "50360,71.63,-2.2")


@pytest.fixture
def bha(tmp_path):
    path = tmp_path / "bha.yaml"
    path.write_text(BHA)
    return path


def run(*words):
    return invoke(APP, *words).stdout


def test_the_table_of_sag_has_every_inclination_and_build_rate(bha, tmp_path):
    out = tmp_path / "new" / "sag.csv"
    run("sag", bha, "--inclination", "10:90:40", "--build=-3,0", "-o", out)
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert [(row["inclination_deg"], row["build_deg_30m"]) for row in rows] == [
        (inclination, build) for inclination in ("10", "50", "90") for build in ("-3", "0")
    ]
    want = sag_of(read_assembly(bha), math.radians(50.0), math.radians(-3.0) / 30.0)
    assert float(rows[2]["sag_correction_deg"]) == pytest.approx(math.degrees(want), abs=5e-5)


def test_the_interference_of_an_assembly_is_shown_with_its_error_and_the_collars_needed(bha):
    text = run("spacing", bha, "--inclination", 60, "--azimuth", 85, *FIELD)
    # 1000 uWb at 6 m less its far pole at 15 m, and 900 uWb of the string at 14 m.
    assert "up to 2222 nT along the tool" in text
    assert "beyond the limit of 0.5 deg" in text
    assert "m of non-magnetic collars above the sensors" in text


def test_where_no_interference_turns_the_azimuth_no_collars_are_asked_for():
    assert "any interference" in run("spacing", "--inclination", 0, "--azimuth", 85, *FIELD)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("spacing", "--inclination", 60, "--azimuth", 85), "give --lat and --lon, or --field"),
        (("spacing", "--inclination", 200, "--azimuth", 85, *FIELD), "within 0 and 180"),
        (("spacing", "--inclination", 60, "--azimuth", 85, *FIELD, "--below", "magnet"), "one of collars, motor"),
        (("sag", "BHA", "--inclination", "10-20"), "expected LOW:HIGH"),
        (("sag", "BHA", "--inclination", "20:10:1"), "LOW must not be above HIGH"),
        (("sag", "BHA", "--inclination", "0:190:10"), "within 0 and 180"),
    ],
)
def test_what_cannot_be_computed_is_refused_in_a_sentence(bha, words, sentence):
    with pytest.raises(ValueError, match=sentence):
        run(*(bha if word == "BHA" else word for word in words))
