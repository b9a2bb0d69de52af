# SPDX-License-Identifier: Apache-2.0
"""Lists that others measured: their path against the published one, and where it starts."""

import csv
import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.core.north import North
from mwd_estimation.core.reference_field import Reference
from mwd_surface.exports.csv_tables import definitive_csv
from mwd_surface.exports.export_las import las
from mwd_surface.exports.export_witsml import witsml
from mwd_surface.exports.report_content import content
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.list_files.list_file import is_list, list_of, read_list
from mwd_surface.list_files.remark import RemarkKind
from mwd_surface.surveys.imported_list import reference_in, survey_list
from mwd_surface.surveys.leg import Origin, TieOn
from mwd_surface.surveys.survey_source import surveys_of
from mwd_surface.surveys.survey_store import decoded, encoded
from mwd_surface.surveys.well import Well
from project import REFERENCE_DATA

F4 = REFERENCE_DATA / "volve" / "F-4_gyro_ns_trajectory.csv"
FIELD = Reference(total=50e-6, dip=1.2, declination=0.02, convergence=-0.01)


def test_the_gyro_list_of_volve_f4_has_its_published_path():
    """Published to a micrometre, of stations that are rounded likewise; the errors of 87 arcs add up to two."""
    surveys = survey_list(read_list(F4))
    path = surveys.definitive()
    with F4.open() as file:
        rows = [{k: float(v) for k, v in row.items() if k.endswith(("_m", "30m"))} for row in csv.DictReader(file)]
    published = np.array([[row["north_m"], row["east_m"], row["tvd_m"]] for row in rows])
    np.testing.assert_allclose(path.positions, published, atol=2e-6)
    dogleg = np.degrees(path.dogleg_severity) * 30.0
    np.testing.assert_allclose(dogleg, [row["dls_deg_per_30m"] for row in rows], atol=1.1e-6)
    assert (path.north, surveys.well.error_model, surveys.remarks) == (North.TRUE, "GYRO-NS", ())
    assert all(record.in_use and not record.flags[1:] for record in surveys.records)


def test_the_path_starts_at_the_first_station_the_wellhead_or_where_the_caller_says():
    whole = list_of(b"md_m,inc,azi_true,tvd_m,north_m,east_m\n500,10,0,495,20,-3\n600,12,0,593.2,39,-3\n")
    assert survey_list(whole).definitive().positions[0].tolist() == [20.0, -3.0, 495.0]
    bare = list_of(b"md_m,inc,azi_true\n500,10,0\n600,12,0\n")
    surveys = survey_list(bare)
    assert surveys.definitive().md.tolist() == [0.0, 500.0, 600.0]
    assert RemarkKind.HOLE_ABOVE_ASSUMED in {remark.kind for remark in surveys.remarks}
    tied = survey_list(bare, tie_on=TieOn(550.0, 0.2, 0.0, 30.0, 0.0, 545.0, Origin.GIVEN))
    assert tied.definitive().md.tolist() == [550.0, 600.0]
    with pytest.raises(ValueError, match="no station lies below the tie-on at 900 m"):
        survey_list(bare, tie_on=TieOn(900.0))


@given(apart=st.floats(-0.4, 0.4), inclination=st.floats(9.0, 11.0))
def test_a_tie_on_and_a_station_whose_depths_are_rounded_in_two_units_are_one_station(apart, inclination):
    bare = list_of(b"md_m,inc,azi_true\n500,10,0\n530,10.3,1\n560,10.9,0\n")
    tie_on = TieOn(500.0 + apart, math.radians(inclination), 0.0, 20.0, -3.0, 495.0, Origin.GIVEN)
    surveys = survey_list(bare, tie_on=tie_on)
    path = surveys.definitive()
    assert path.md.tolist() == [500.0 + apart, 530.0, 560.0]
    assert np.degrees(path.dogleg_severity).max() * 30.0 < 2.0
    assert RemarkKind.TIE_ON_SHARP not in {remark.kind for remark in surveys.remarks}


def test_a_tie_on_that_points_elsewhere_than_the_hole_is_named():
    bare = list_of(b"md_m,inc,azi_true\n500,30,0\n530,30.3,1\n560,30.9,0\n")
    surveys = survey_list(bare, tie_on=TieOn(500.0, math.radians(30.0), math.radians(180.0), source=Origin.GIVEN))
    assert RemarkKind.TIE_ON_SHARP in {remark.kind for remark in surveys.remarks}


@pytest.mark.parametrize("text", ['{"kind": "work-product-component--WellboreTrajectory:1.1.0"}', '[{"md_m": 0.0}]'])
def test_json_of_another_program_is_refused_with_what_to_export(tmp_path, text):
    path = tmp_path / "trajectory.json"
    path.write_text(text)
    assert not is_list(path)
    with pytest.raises(ValueError, match=r"trajectory.json: not a survey list; .* export other lists as CSV"):
        surveys_of(path)


def test_an_inclined_station_without_azimuth_is_not_used_for_this_reason_also_on_demand():
    stations = list_of(b"md_m,inc,azi_true\n0,0,\n100,5,0\n200,9,\n300,9,0\n")
    for every in (False, True):
        surveys = survey_list(stations, every=every)
        assert surveys.definitive().md.tolist() == [0.0, 100.0, 300.0]
        assert "1 of 3 stations are not used, because they are inclined" in surveys.remarks[-1].text


def test_stations_whose_verdict_is_not_accept_are_listed_and_used_only_on_demand():
    stations = list_of(b"md_m,inc,azi_true,verdict\n0,0,0,accept\n100,5,0,accept\n200,9,0,doubtful\n300,9,0,reject\n")
    surveys = survey_list(stations)
    assert [record.in_use for record in surveys.records] == [True, False, False]
    assert "2 of 3 stations are not used" in surveys.remarks[0].text
    assert all(record.in_use for record in survey_list(stations, every=True).records)


def test_with_a_reference_the_tool_code_gives_each_station_its_uncertainty():
    surveys = survey_list(read_list(F4), Well(latitude_deg=58.44, longitude_deg=1.88), reference=FIELD)
    table = survey_table(surveys, 0)
    assert table.covariance is not None
    # GYRO-NS and MWD+SRGM are different models.
    magnetic = surveys.configured(dataclasses.replace(surveys.well, error_model="MWD+SRGM"), surveys.rules)
    other = survey_table(magnetic, 0).covariance
    assert other is not None
    assert not np.allclose(other[-1], table.covariance[-1])
    assert reference_in(surveys).declination == 0.02


def test_a_station_without_readings_shows_none():
    surveys, _ = surveys_of(F4)
    assert math.isnan(surveys.records[5].survey.sigma_azimuth)
    assert not surveys.records[5].survey.has_readings
    assert surveys.records[5].survey.azimuth_from(North.MAGNETIC) is None


def test_remarks_stay_with_the_list_into_its_file_and_every_export():
    surveys = survey_list(list_of(b"md_m,inc,azi\n300,1,10\n330,2,12\n"))
    kept = decoded(encoded(surveys))
    kinds = {remark.kind for remark in kept.remarks}
    assert kept.remarks == surveys.remarks
    assert kinds == {RemarkKind.HOLE_ABOVE_ASSUMED, RemarkKind.NORTH_ASSUMED}
    table = survey_table(kept, 0)
    assert len(table.remarks) == 2
    for remark in table.remarks:
        assert remark in definitive_csv(table)
        assert remark in witsml(table)
        assert remark in content(table).notes
        # A colon parts the fields of LAS.
        assert remark.partition(":")[0] in las(table)
