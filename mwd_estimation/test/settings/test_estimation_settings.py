# SPDX-License-Identifier: Apache-2.0
"""What follows from the settings: reference field, latitude, and the parameters of every filter."""

import dataclasses
import importlib.resources
import math

import pytest
import yaml

from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.gravity import methods
from mwd_estimation.gyrocompass.seek_state import TACTICAL
from mwd_estimation.settings import derivation, tool_file
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.settings.place import Place, reference_of
from mwd_estimation.settings.tool import PrecisionUnit, Tool
from mwd_sensors.core import earth
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.settings import SettingsError, changed, flat, from_mapping

START = 1_772_323_200 * 10**9  # 2026-03-01
GRADES = sorted((importlib.resources.files("mwd_sensors") / "simulator" / "grades").iterdir(), key=str)


@pytest.mark.parametrize(
    ("changes", "message"),
    [({"date": "yesterday"}, "YYYY-MM-DD"), ({"date": "1999-01-01"}, "1999|2025")],
)
def test_a_reference_outside_its_model_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        reference_of(Place(field="model", lat_deg=50.0, lon_deg=5.0, **changes), START)


def test_the_reference_of_the_model_takes_the_day_of_the_first_sample():
    at = Place(field="model", lat_deg=38.3, lon_deg=109.6)
    assert reference_of(at, START) == reference_of(dataclasses.replace(at, date="2026-03-01"), 0)


def test_without_a_field_there_is_no_reference_and_a_fixed_one_is_as_it_says():
    assert reference_of(Place(), START) is None
    fixed = reference_of(Place(field="fixed", total_nt=48000.0, dip_deg=60.0, declination_deg=3.0), START)
    assert fixed is not None
    assert (fixed.total, fixed.dip) == (pytest.approx(48e-6), pytest.approx(math.radians(60.0)))
    assert fixed.gravity is None


@pytest.mark.fault_case(35)
@pytest.mark.parametrize(
    ("lat", "lon", "dip", "declination", "words"),
    [
        (58.4, 1.88, -71.6, 0.0, "its sign"),
        (58.4, None, -71.6, None, "give 71.6"),
        (-33.9, 151.2, 64.4, 12.6, "its sign"),
        (-33.9, None, 64.4, None, "give -64.4"),
        (58.4, 1.88, 1.25, None, "radians"),
        (58.4, 1.88, 18.4, None, "its angle from the vertical"),
        (58.4, 1.88, 71.6, 178.0, "declination of 178 deg does not exist"),
        (29.8, -95.4, 59.0, 32.0, "declination of 32 deg does not exist"),
        (1.4, 103.8, -13.0, 45.0, "declination of 45 deg does not exist"),
    ],
)
def test_a_field_that_its_position_rules_out_is_refused_with_what_was_meant(lat, lon, dip, declination, words):
    place = Place("fixed", lat, lon, total_nt=48000.0, dip_deg=dip, declination_deg=declination)
    with pytest.raises(ValueError, match=words):
        reference_of(place, START)


@pytest.mark.parametrize(
    ("lat", "lon", "dip", "declination"),
    [(58.4, 1.88, 71.0, 1.0), (-33.9, 151.2, -65.0, 12.0), (1.4, 103.8, -15.0, 0.3), (12.0, None, -3.0, None)],
)
def test_a_field_as_a_certificate_gives_it_is_taken(lat, lon, dip, declination):
    place = Place("fixed", lat, lon, total_nt=48000.0, dip_deg=dip, declination_deg=declination)
    assert reference_of(place, START).dip == pytest.approx(math.radians(dip))


def test_a_fixed_field_at_a_known_latitude_has_the_gravity_of_that_latitude():
    placed = Place(field="fixed", total_nt=50000.0, dip_deg=60.0, lat_deg=58.4)
    assert reference_of(placed, START).gravity == earth.gravity(math.radians(58.4), 0.0)
    bare = reference_of(Place(field="fixed", total_nt=50000.0, dip_deg=60.0), START)
    # A setting that was not given is unknown (NaN), not zero.
    assert (bare.gravity, bare.declination, bare.convergence) == (None, None, None)


def test_only_a_named_grid_gives_the_model_a_convergence():
    place = Place(field="model", lat_deg=50.0, lon_deg=5.0)
    assert reference_of(place, START).convergence is None
    assert reference_of(dataclasses.replace(place, grid="utm"), START).convergence == pytest.approx(0.0268, abs=1e-3)
    # ED50 / UTM 32: the next meridian.
    ed50 = reference_of(dataclasses.replace(place, grid="EPSG:23032"), START)
    assert ed50.convergence == pytest.approx(
        math.atan(math.tan(math.radians(-4.0)) * math.sin(math.radians(50.0))), abs=1e-4
    )
    for wrong in ("EPSG:1", "EPSG:4326", "the grid"):
        with pytest.raises(ValueError, match=r"place.grid: write none, utm or an EPSG code"):
            reference_of(dataclasses.replace(place, grid=wrong), START)


def test_a_model_without_a_position_is_refused_and_nan_is_none():
    with pytest.raises(ValueError, match=r"a model needs the position; give place.lat_deg and place.lon_deg"):
        reference_of(Place(field="model", lat_deg=50.0), START)
    assert changed(Place(lat_deg=50.0), {"lat_deg": math.nan}).lat_deg is None


@pytest.mark.parametrize("grade", GRADES, ids=lambda path: path.name)
@pytest.mark.parametrize("unit", [Tool, PrecisionUnit])
def test_a_grade_file_of_the_simulator_is_a_valid_tool_file(grade, unit):
    given, used = yaml.safe_load(grade.read_text()), tool_file.from_file(grade, unit)
    tool = from_mapping(unit, used)
    assert list(tool.gyro.range_deg_s) == given["gyro"]["range_deg_s"]
    for triad in set(used) & {"gyro", "accelerometer"}:
        for name, value in used[triad].items():
            assert value == given[triad].get(name, tool_file.TUMBLE_MRAD), name
    assert not (set(used) - {"gyro", "accelerometer", "magnetometer"})


def test_a_misspelt_name_in_a_tool_file_is_refused_with_the_right_one(tmp_path):
    file = tmp_path / "tool.yaml"
    file.write_text("gyro: {noise_deg_sqrt_hz: 0.3}")
    with pytest.raises(SettingsError, match=r"gyro.noise_deg_sqrt_hz: .* did you mean noise_deg_sqrt_h"):
        tool_file.from_file(file)


def test_by_default_the_filters_get_their_own_defaults():
    settings = EstimatorSettings()
    for derive in (
        derivation.health_params,
        derivation.time_alignment_params,
        derivation.interference_params,
        derivation.gyro_azimuth_params,
        derivation.north_params,
    ):
        found = derive(settings)
        assert found == type(found)(), derive.__name__
    here = dataclasses.replace(settings, place=Place(lat_deg=TACTICAL.latitude_deg))
    assert derivation.gyrocompass_params(here) == TACTICAL
    # 408 ug, as in the grades, is the tool code's 0.004 m/s^2 rounded.
    assert derivation.sensor_errors(settings) == dataclasses.replace(
        SensorErrors(), accelerometer_bias_mps2=pytest.approx(0.004, rel=5e-4)
    )


@pytest.mark.parametrize("name", methods.METHODS)
def test_a_gravity_method_has_its_defaults_and_the_range_of_the_tool_and_the_gravity_of_the_place(name):
    settings = changed(EstimatorSettings(), {"gravity.method": name, "tool.accelerometer.range_g": [8.0, 16.0, 16.0]})
    params, default = derivation.gravity_params(settings, 9.82), methods.METHODS[name].Params()
    assert (params.gravity, params.accel_range) == (9.82, 8.0 * STANDARD_GRAVITY)
    derived = {"gravity", "gravity_sigma", "accel_range", "gyro_range", "sigma_floor"}
    derived |= {"bias_sigma", "misalignment_sigma", "accel_bias_sigma", "accel_scale_sigma", "accel_misalignment_sigma"}
    for field in getattr(default, "_fields", None) or [one.name for one in dataclasses.fields(default)]:
        assert field in derived or getattr(params, field) == getattr(default, field), field


@pytest.mark.parametrize(("grade", "bias_mg"), [("mti3_calibrated", 0.1), ("mti3", 3.0), ("owsg_mwd", 0.408)])
def test_the_gravity_filter_knows_how_well_the_accelerometers_are_calibrated(grade, bias_mg):
    tool = tool_file.from_file(next(path for path in GRADES if path.name == f"{grade}.yaml"))
    params = derivation.gravity_params(from_mapping(EstimatorSettings, {"tool": tool}), None)
    assert params.accel_bias_sigma == pytest.approx(1e-3 * bias_mg * STANDARD_GRAVITY)


@pytest.mark.parametrize("stated", [{}, {"bias_ug": 50.0, "scale_ppm": 50.0}])
def test_accelerometers_that_nobody_has_described_have_the_errors_of_a_factory_unit(stated):
    factory = tool_file.from_file(next(path for path in GRADES if path.name == "mti3.yaml"))
    tilt = derivation.accelerometer_tilt(from_mapping(Tool, {"accelerometer": factory["accelerometer"]}))
    unknown = from_mapping(Tool, {"accelerometer": stated})
    assert unknown.accelerometer.assumed
    assert derivation.accelerometer_tilt(unknown) == pytest.approx(tilt)
    assert derivation.accelerometer_tilt(from_mapping(Tool, {"accelerometer": {"bias_ug": 9000.0}})) > 2.0 * tilt
    described = from_mapping(Tool, {"accelerometer": {**stated, "misalignment_mrad": 0.0}})
    assert not described.accelerometer.assumed
    assert derivation.accelerometer_tilt(described) < 0.2 * tilt


def test_what_remains_without_gyros_is_the_method_raw_whatever_is_selected():
    tool = {"tool.accelerometer.range_g": [8.0, 16.0, 16.0], "tool.accelerometer.misalignment_mrad": 5.0}
    raw = derivation.gravity_params(changed(EstimatorSettings(), {"gravity.method": "raw", **tool}), 9.82)
    assert raw != methods.METHODS["raw"].Params()
    for name in methods.METHODS:
        settings = changed(EstimatorSettings(), {"gravity.method": name, **tool})
        assert derivation.accelerometer_params(settings, 9.82) == raw


def test_the_bounded_filter_takes_the_gyro_of_the_tool():
    described = changed(EstimatorSettings(), {"tool.accelerometer.misalignment_mrad": 0.1})
    usual = derivation.gravity_params(described, None)
    better = {"tool.gyro.noise_deg_sqrt_h": 0.21, "tool.gyro.bias_deg_h": 100.0, "tool.gyro.misalignment_mrad": 0.15}
    params = derivation.gravity_params(changed(described, better), None)
    assert params.gyro_noise == pytest.approx(0.5 * usual.gyro_noise)
    assert params.bias_sigma == pytest.approx(0.25 * usual.bias_sigma)
    assert params.misalignment_sigma == pytest.approx(0.5 * usual.misalignment_sigma)
    perfect = {"tool.gyro.noise_deg_sqrt_h": 0.0, "tool.gyro.bias_deg_h": 0.0}
    assert derivation.gravity_params(changed(EstimatorSettings(), perfect), None).gyro_noise > 0.0


def test_a_user_has_few_parameters_to_read():
    rules = [rule for _, rule in flat(EstimatorSettings()).values()]
    assert len(rules) <= 72
    assert sum(not rule.expert for rule in rules) <= 25


def test_a_string_may_be_as_magnetic_as_its_expected_field_says_and_the_magnetometers_bias_allows():
    def possible_nt(changes):
        return 1e9 * derivation.interference_params(changed(EstimatorSettings(), changes)).axial

    assert possible_nt({"tool.axial_interference_nt": 440.0}) == pytest.approx(4000.0)
    assert possible_nt({"tool.axial_interference_nt": 0.0}) == pytest.approx(70.0)


def test_the_walk_of_a_gyros_bias_follows_its_bias():
    usual = derivation.gyro_azimuth_params(EstimatorSettings()).units[0]
    half = derivation.gyro_azimuth_params(changed(EstimatorSettings(), {"tool.gyro.bias_deg_h": 200.0})).units[0]
    assert (half.walk, half.lag) == (0.5 * usual.walk, usual.lag)


def test_a_sag_correction_leaves_the_sigma_of_a_corrected_sag():
    corrected = changed(EstimatorSettings(), {"tool.sag_correction_deg": 0.3})
    assert derivation.sensor_errors(corrected).sag_deg == 0.08


_FIXED = {"place.field": "fixed", "place.total_nt": 50000.0, "place.dip_deg": 60.0}
_CERTIFICATE = {"place.source_sigmas": [60.0, 0.11, 0.15]}


def test_a_named_field_brings_its_own_sigmas_and_the_field_of_the_moment_only_where_it_is_an_ifr2():
    given = {**_FIXED, **_CERTIFICATE, "place.source": "IFR2", "survey.tool_code": "MWD+SRGM"}
    known = derivation.reference(changed(EstimatorSettings(), given), 0)
    assert known.source == "IFR2"
    lower = derivation.reference(changed(EstimatorSettings(), {**given, "place.source": "ifr2 of the well"}), 0)
    assert lower.sigma_total == known.sigma_total
    assert known.sigma_total == pytest.approx(60e-9)
    assert known.sigma_dip == pytest.approx(math.radians(0.11))
    # The declination's is of this place: it does not grow with a weak horizontal field.
    assert math.sqrt(known.declination_variance(1e-5)) == pytest.approx(math.radians(0.15))
    # MFIR, MDIR and DBHR of OWSG A003Mc rev 5.1: what changes from station to station.
    quiet = derivation.reference(changed(EstimatorSettings(), {**given, "place.source": "IFR1"}), 0)
    assert quiet.sigma_total == pytest.approx(math.hypot(60e-9, 60e-9))
    assert quiet.sigma_dip == pytest.approx(math.radians(math.hypot(0.11, 0.08)))
    assert math.sqrt(quiet.declination_variance(15e-6)) == pytest.approx(math.radians(math.hypot(0.15, 0.2)))


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"place.source_sigmas": [60.0, 0.0, 0.15]}, "place.source_sigmas"),
        ({"place.source_sigmas": [0.11, 60.0, 0.15]}, "the order is total"),
        ({"place.source": ""}, "place.source"),
        ({"place.total_nt": 0.0}, "place.total_nt"),
        ({"place.dip_deg": None}, "place.dip_deg"),
    ],
)
def test_a_named_field_that_is_incomplete_is_refused(change, named):
    given = {**_FIXED, **_CERTIFICATE, "place.source": "IFR1", **change}
    with pytest.raises(SettingsError, match=named):
        reference_of(changed(EstimatorSettings(), given).place, 0)


def test_a_code_of_an_in_field_reference_refuses_a_global_model():
    given = {"survey.tool_code": "MWD+IFR1", "place.field": "model", "place.lat_deg": 60.0, "place.lon_deg": 5.0}
    with pytest.raises(SettingsError, match="in-field reference"):
        derivation.reference(changed(EstimatorSettings(), given), START)


@pytest.mark.slow
def test_an_assembly_gives_the_sag_correction_and_its_sigma(tmp_path):
    path = tmp_path / "bha.yaml"
    path.write_text("{hole_mm: 311, sensor_m: 8, components: [{name: dc, length_m: 30, od_mm: 229, id_mm: 71}]}")
    settings = changed(EstimatorSettings(), {"tool.assembly_file": str(path)})
    params = derivation.station_params(settings)
    assert math.degrees(params.sag.at(math.radians(90.0))) < -0.05
    assert params.errors.sag_deg == pytest.approx(0.08)
    coded = changed(settings, {"survey.tool_code": "MWD+SRGM"})
    assert derivation.sensor_errors(coded).sag_deg == pytest.approx(0.08)
    with pytest.raises(SettingsError, match="together with"):
        derivation.station_params(changed(settings, {"tool.sag_correction_deg": 0.1}))
    with pytest.raises(SettingsError, match="assembly_file"):
        derivation.station_params(changed(settings, {"tool.assembly_file": str(tmp_path / "none.yaml")}))


@pytest.mark.parametrize("code", ["", "MWD+SRGM"])
def test_what_a_tool_states_of_its_accelerometers_directions_is_in_its_surveys(code):
    settings = changed(EstimatorSettings(), {"survey.tool_code": code})
    stated = changed(settings, {"tool.accelerometer.misalignment_mrad": 5.0})
    assert derivation.sensor_errors(settings).mount_deg == SensorErrors().mount_deg
    assert math.radians(derivation.sensor_errors(stated).mount_deg) == pytest.approx(5e-3, rel=0.01)


def test_a_tool_code_gives_the_errors_and_the_sigmas_of_the_field():
    settings = changed(EstimatorSettings(), {"survey.tool_code": "MWD+IFR1", **_FIXED})
    plain = changed(settings, {"survey.tool_code": ""})
    assert derivation.reference(settings, 0).sigma_total < derivation.reference(plain, 0).sigma_total
    with pytest.raises(ValueError, match="MWD"):
        derivation.sensor_errors(changed(settings, {"survey.tool_code": "MWD+IFR7"}))
