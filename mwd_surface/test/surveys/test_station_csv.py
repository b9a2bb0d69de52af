# SPDX-License-Identifier: Apache-2.0
"""A station as a line: the columns others rely on, empty where nothing is known."""

import csv
import dataclasses
import io
import math

import numpy as np
import pytest

from mwd_estimation.core.reason_text import joined
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.station import station
from mwd_estimation.survey.survey import Verdict
from mwd_surface.list_files.six_axis_table import TableStation
from mwd_surface.surveys import station_csv
from mwd_surface.surveys.table_run import table_surveys

F_T, B_T = np.array([-8.0, 1.0, 5.5]), np.array([3.0e-5, 1.0e-5, -3.5e-5])
REFERENCE = Reference(total=4.72e-5, dip=1.2, declination=0.03, convergence=0.01, gravity=9.8)


def test_the_promised_columns_come_first():
    assert station_csv.COLUMNS[:10] == (
        "md_m",
        "inclination_deg",
        "azimuth_deg",
        "azimuth_reference",
        "toolface_deg",
        "g_total_mps2",
        "b_total_nt",
        "dip_deg",
        "verdict",
        "reasons",
    )


def record(one, measured_depth=math.nan):
    """A record of a station, as of a table of readings."""
    (row,) = table_surveys([TableStation(measured_depth, "", one)])
    return row.record


def test_a_line_has_the_values_of_the_station():
    one = station(F_T, B_T, REFERENCE)
    text = station_csv.text(station_csv.COLUMNS, [station_csv.cells(record(one, 1234.5))])
    line = next(csv.DictReader(io.StringIO(text)))
    assert line["md_m"] == "1234.500"
    assert float(line["inclination_deg"]) == pytest.approx(math.degrees(one.inclination), abs=6e-5)
    assert float(line["azimuth_deg"]) == pytest.approx(math.degrees(one.azimuth), abs=6e-5)
    assert float(line["sigma_toolface_deg"]) == pytest.approx(math.degrees(one.sigma_toolface), abs=6e-5)
    assert line["azimuth_reference"] == "grid"
    assert float(line["b_total_nt"]) == pytest.approx(one.b_total * 1e9, abs=0.06)
    assert line["verdict"] == one.verdict
    assert line["reasons"] == joined(one.reasons)
    assert float(line["b_reference_nt"]) == 47200.0
    assert (line["first_azimuth_deg"], line["revised_because"]) == (line["azimuth_deg"], "")


def test_a_revised_station_has_its_first_value_and_the_reason():
    now = record(station(F_T, B_T, REFERENCE))
    first = dataclasses.replace(now.survey, azimuth=now.survey.azimuth + 0.1, verdict=int(Verdict.DOUBTFUL))
    line = station_csv.cells(dataclasses.replace(now, first=(first,)))
    assert line["first_azimuth_deg"] == f"{math.degrees(first.azimuth):.4f}"
    assert (line["first_verdict"], line["verdict"]) == ("doubtful", Verdict(now.survey.verdict).word)
    assert line["revised_because"]


def test_unknown_values_are_empty_cells():
    line = station_csv.cells(record(station(F_T, np.full(3, np.nan))))
    empty = ("md_m", "azimuth_deg", "azimuth_reference", "sigma_azimuth_deg", "b_total_nt", "dip_deg", "b_reference_nt")
    assert [line[name] for name in empty] == [""] * len(empty)
    assert line["verdict"] == "reject"
    assert line["inclination_deg"] != ""


def test_no_angle_is_written_as_360():
    assert station_csv._around(math.tau - 1e-9) == "0.0000"
    assert station_csv.number(-1e-9, 2) == "0.00"


def test_every_column_of_numbers_has_a_unit_and_reads_as_a_number():
    columns = (*station_csv.OF_STATIONS, *station_csv.OF_TABLES)
    assert all(one.text != bool(one.unit) or one.name == "alternatives_deg" for one in columns)
    line = station_csv.cells(record(station(F_T, B_T, REFERENCE), 1234.5))
    assert set(line) == {one.name for one in station_csv.OF_STATIONS}
    for one in station_csv.OF_STATIONS:
        assert one.text or not line[one.name] or math.isfinite(float(line[one.name]))
