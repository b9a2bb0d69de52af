# SPDX-License-Identifier: Apache-2.0
"""The LAS file read back by lasio."""

import dataclasses
import io

import example_surveys as example
import lasio
import numpy as np
import pytest

from mwd_surface.exports.export_las import las
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.logs.log_files import NULL
from mwd_surface.surveys.survey_list import SurveyList


def read(table):
    return lasio.read(io.StringIO(las(table)))


def test_every_curve_comes_back_as_printed():
    table = example.table()
    file = read(table)
    assert file.curves.keys()[:4] == ["DEPT", "INC", "AZI", "TVD"]
    for mnemonic, key in (("DEPT", "md_m"), ("INC", "inclination_deg"), ("EW", "east_m"), ("DLS", "dls_deg_per_30m")):
        np.testing.assert_array_equal(file[mnemonic], [float(table.column(key).cell(k)) for k in table.rows])
    assert file["KIND"].tolist() == [0.0] + [1.0] * 11 + [2.0]


def test_what_is_not_known_is_null_and_read_as_nan():
    table = example.table()
    known = table.column("sigma_north_m")
    partly = dataclasses.replace(known, values=(*known.values[:-1], None))
    table = dataclasses.replace(table, columns=tuple(partly if c is known else c for c in table.columns))
    assert f"{NULL}" in las(table).splitlines()[-1]
    assert np.isnan(read(table)["SIGN"][-1])


@pytest.mark.fault_case(93)
def test_the_head_survives_accents_colons_and_commas():
    file = read(example.table(well={"company": "A: B: C, Ltd 12:30"}))
    assert file.version["VERS"].value == 2.0
    assert file.well["WELL"].value == "Åsgard Ω-1"
    assert file.well["COMP"].value == "A, B, C, Ltd 12:30"
    assert (file.well["STRT"].value, file.well["STOP"].value, file.well["STEP"].value) == (0.0, 642.5, 0.0)
    params = {p.descr: p.value for p in file.params}
    assert params["Report made"] == "2026-05-15T17:43:40.123Z"
    assert params["Azimuth reference"] == "grid north"


def test_columns_without_a_single_number_are_left_out():
    file = read(survey_table(SurveyList(), example.MADE))
    assert file["DEPT"].tolist() == [0.0]
    assert {"SIGN", "TOPLAN"}.isdisjoint(file.curves.keys())
    assert "TOPLAN" not in read(example.table()).curves.keys()  # noqa: SIM118
