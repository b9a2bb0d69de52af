# SPDX-License-Identifier: Apache-2.0
"""
Parameters of every filter, derived from the settings: one function per filter.

The settings state each fact of the tool and the place once, and only this module passes these facts to the filters.
Other parameters keep the default of the filter.
"""

from __future__ import annotations

import dataclasses
import datetime
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mwd_estimation.assembly.assembly import SIGMA_CORRECTED_DEG, Assembly, read_assembly
from mwd_estimation.assembly.sag import SagCorrection, correction_of
from mwd_estimation.core.calibrated_range import CalibratedRange
from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.input_gate import Ranges
from mwd_estimation.core.reference_field import LOCAL_GRAVITY, Reference
from mwd_estimation.gravity import accelerometer_only
from mwd_estimation.gravity.methods import method
from mwd_estimation.gyrocompass.seek_state import TACTICAL, TACTICAL_NOISE_DEG_RTH, SeekParams
from mwd_estimation.magnetic import interference_filter
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.settings.place import day_of, reference_of
from mwd_estimation.settings.tool import Gyro, Tool
from mwd_estimation.survey import tool_code
from mwd_estimation.survey.posterior.hypotheses import Priors
from mwd_estimation.survey.static_survey import BIN_NS
from mwd_estimation.survey.station import StationSettings
from mwd_sensors.core import earth
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.foreign_text import contents_hidden
from mwd_sensors.core.settings import SettingsError

# Filters that a survey does not need are imported by the functions that derive their parameters: their kernels take a
# tenth of the start time of `mwd survey`.
if TYPE_CHECKING:
    from mwd_estimation.attitude import drilling_dynamics, gyro_azimuth_filter, time_alignment, toolface_dwell
    from mwd_estimation.gyrocompass.session import SessionParams
    from mwd_estimation.health import monitor

# Smallest ratio of a gyro's noise or bias to the value of the default tool: no filter must treat a gyro as perfect.
_LEAST_GYRO = 0.02
# 1 sigma of accelerometer errors that the settings do not describe: errors of a MEMS unit without own calibration.
_FACTORY = {"bias_ug": 3000.0, "scale_ppm": 1500.0, "misalignment_mrad": 1.0}
_FACTORY_GYRO = (720.0, 1.0)  # 1 sigma of bias, deg/h, and misalignment, mrad, of the gyros of such a MEMS unit
# Random walk of the bias of a gyro with the default bias (an MTi-1), deg/h per sqrt(h); it scales with the bias.
_WALK_DEG_H_RTH = 10.0
# 1 sigma of the ramp of a precision gyro's bias while the tool warms up or cools, as a share of the bias per hour: the
# ramp of a tactical MEMS unit whose temperature rises by 10 degC in an hour.
_RAMP_PER_H = 0.6
# Smallest limit for the rate that a gyro may read at rest, rad/s: the bias of any gyro may change this much with
# temperature and age.
_REST_RATE = 0.01
# 1 sigma of the magnetic field of the string at the magnetometer, along the axis and in each direction across it, nT.
# non_magnetic: AMIL of the tool code; short: poles of 1000 uWb about 7 m away; steel: steel pipe around the
# magnetometer.
_STRINGS_NT = {"non_magnetic": (220.0, 0.0), "short": (1500.0, 0.0), "steel": (3000.0, 1000.0)}
# Probability that the field of steel pipe at a station differs from that at the other stations of the run, and rotates
# the measured field without changing its total and dip. In the field case of S1 this happened at each station of table
# 2, by 18 to 23 deg, and at no station of table 1.
_OF_STEEL = 0.3
# 1 sigma of noise, scale error and soft iron of a magnetometer across the axis, nT: 0.1 to 0.2 % of the Earth's field.
_MAG_SCATTER_NT = 100.0


def gravity_params(settings: EstimatorSettings, gravity: float | None) -> Any:
    """Return the parameters of the selected gravity method; gravity: local gravity, m/s^2, None if unknown."""
    return _of_tool(settings.tool, gravity, method(settings.gravity.method).Params())


def accelerometer_params(settings: EstimatorSettings, gravity: float | None) -> accelerometer_only.AccelerometerParams:
    """
    Return the parameters of the accelerometer-only method, which is used while the gyros are faulty.

    gravity: local gravity, m/s^2, None if unknown.
    """
    found: accelerometer_only.AccelerometerParams = _of_tool(
        settings.tool, gravity, accelerometer_only.AccelerometerParams()
    )
    return found


def _of_tool(tool: Tool, gravity: float | None, default: Any) -> Any:
    """Return the parameters of a gravity method: its defaults, with values from the settings of tool and place."""
    usual, calibration, gyro = Gyro(), accelerometer_tilt(tool), tool.gyro
    if tool.accelerometer.assumed:
        # A figure with the default value counts as not stated: use the error of a unit without calibration instead.
        gyro = dataclasses.replace(
            gyro,
            bias_deg_h=_FACTORY_GYRO[0] if gyro.bias_deg_h == usual.bias_deg_h else gyro.bias_deg_h,
            misalignment_mrad=(
                _FACTORY_GYRO[1] if gyro.misalignment_mrad == usual.misalignment_mrad else gyro.misalignment_mrad
            ),
        )
    bias_ug, scale_ppm, misalignment_mrad = accelerometer_figures(tool)
    derived = {
        "gravity": gravity or STANDARD_GRAVITY,
        "gravity_sigma": LOCAL_GRAVITY if gravity else getattr(default, "gravity_sigma", 0.0),
        "gyro_range": math.radians(min(tool.gyro.range_deg_s)),
        "accel_range": min(tool.accelerometer.range_g) * STANDARD_GRAVITY,
        "coning": 0.0 if tool.samples == "integrated" else 1.0,
        "sampled": tool.samples == "points",
        # The filter's default noises include a reserve for motion that is not white; scale them with the tool's noise.
        "gyro_noise": _in_proportion(default, "gyro_noise", tool.gyro.noise_deg_sqrt_h, usual.noise_deg_sqrt_h),
        "bias_sigma": _in_proportion(default, "bias_sigma", gyro.bias_deg_h, usual.bias_deg_h),
        "misalignment_sigma": _in_proportion(
            default, "misalignment_sigma", gyro.misalignment_mrad, usual.misalignment_mrad
        ),
        "accel_bias_sigma": 1e-6 * bias_ug * STANDARD_GRAVITY,
        "accel_scale_sigma": 1e-6 * scale_ppm,
        "accel_misalignment_sigma": 1e-3 * misalignment_mrad,
        "mag_error": 1e-9 * math.hypot(tool.magnetometer.bias_nt, _string_nt(tool)[1], _MAG_SCATTER_NT),
        # Simpler methods estimate their sigma less accurately and have a sigma floor of their own.
        "sigma_floor": max(getattr(default, "sigma_floor", 0.0), calibration),
    }
    return default._replace(**{name: derived[name] for name in default._fields if name in derived})


def _in_proportion(default: Any, name: str, figure: float, usual: float) -> float:
    """Return the default of a parameter (0 if the method lacks it) times the ratio of `figure` to `usual`."""
    return float(getattr(default, name, 0.0)) * max(figure / usual, _LEAST_GYRO)


def accelerometer_tilt(tool: Tool) -> float:
    """
    Return the tilt of the gravity direction caused by the errors of the accelerometers, 1 sigma, rad.

    Scale errors rotate the vector by the difference of the errors of two axes, times sine and cosine of the angle from
    one of these axes; the root mean square over all attitudes is half of the scale error.
    """
    bias, scale, misalignment = accelerometer_figures(tool)
    return math.hypot(bias / 1e6, 0.5 * scale / 1e6, misalignment / 1e3)


def accelerometer_figures(tool: Tool) -> tuple[float, float, float]:
    """
    Return bias, ug, scale error, ppm, and misalignment, mrad, of the accelerometers, 1 sigma.

    Accelerometers that the settings do not describe get at least the errors of a MEMS unit without own calibration.
    """
    sensor = tool.accelerometer
    bias, scale, misalignment = sensor.bias_ug, sensor.scale_ppm, sensor.misalignment_mrad or 0.0
    if sensor.assumed:
        bias, scale = max(bias, _FACTORY["bias_ug"]), max(scale, _FACTORY["scale_ppm"])
        misalignment = _FACTORY["misalignment_mrad"]
    return bias, scale, misalignment


def input_ranges(settings: EstimatorSettings) -> Ranges:
    """
    Return the sensor ranges for the gate.

    The widest range of the three axes is used, because the gate works in axes of the units while a range may be stated
    in tool axes. The range of a precision unit is often left at the default, which suits its cross axes, although its x
    axis rotates with the string; its gate is therefore at least the gate of the conventional unit.
    """
    tool = settings.tool
    fastest = max(tool.gyro.range_deg_s)
    return Ranges(
        gyro=math.radians(fastest),
        accel=max(tool.accelerometer.range_g) * STANDARD_GRAVITY,
        mag=tool.magnetometer.range_ut * 1e-6 or math.inf,
        precision_gyro=math.radians(max(fastest, *tool.precision.gyro.range_deg_s)),
    )


def health_params(settings: EstimatorSettings) -> monitor.MonitorParams:
    """Return the parameters of the health checks of the conventional unit and the magnetometer."""
    from mwd_estimation.health import monitor

    tool, usual = settings.tool, monitor.MonitorParams()
    return monitor.MonitorParams(
        gyro_range=math.radians(min(tool.gyro.range_deg_s)),
        accel_range=min(tool.accelerometer.range_g) * STANDARD_GRAVITY,
        mag_range=tool.magnetometer.range_ut * 1e-6 or math.inf,
        # The checks wait for magnetic samples for their default time, or for the set delay if it is longer.
        mag_lag_ns=max(usual.mag_lag_ns, round(tool.magnetometer.delay_s * 1e9)),
        rest_rate=max(_REST_RATE, usual.rest_rate * (tool.gyro.bias_deg_h / Gyro().bias_deg_h)),
        mag_expected=tool.magnetometer.present,
    )


def precision_gyro_bias(settings: EstimatorSettings) -> float:
    """Return the bias of the precision unit's gyros, 1 sigma, rad/s, for the comparison of the two units."""
    return math.radians(settings.tool.precision.gyro.bias_deg_h) / 3600.0


def time_alignment_params(settings: EstimatorSettings) -> time_alignment.TimeAlignmentParams:
    """Return the parameters for pairing magnetic samples with gravity."""
    from mwd_estimation.attitude import time_alignment

    attitude, tool = settings.attitude, settings.tool
    return time_alignment.TimeAlignmentParams(
        mag_lag_ns=round(tool.magnetometer.delay_s * 1e9),
        vertical_enter=math.radians(attitude.vertical_deg),
        vertical_leave=math.radians(attitude.vertical_deg + 1.0),
        latency_s=tool.latency_s,
    )


def interference_params(settings: EstimatorSettings) -> interference_filter.InterferenceParams:
    """Return the parameters of the filter that estimates the field of the drill string."""
    tool, usual = settings.tool, interference_filter.InterferenceParams()
    # The prior of the axial interference scales with the expected field, and is at least the bias of the magnetometer.
    axial = usual.axial * (_string_nt(tool)[0] / _string_nt(Tool())[0])
    return interference_filter.InterferenceParams(axial=max(axial, tool.magnetometer.bias_nt * 1e-9))


def gyro_azimuth_params(settings: EstimatorSettings) -> gyro_azimuth_filter.GyroAzimuthParams:
    """Return the parameters of the gyro-propagated azimuth; those without a setting keep the filter's default."""
    from mwd_estimation.attitude import gyro_azimuth_filter

    tool, usual = settings.tool, gyro_azimuth_filter.GyroAzimuthParams()
    precision = tool.precision.gyro
    walk = _WALK_DEG_H_RTH * tool.gyro.bias_deg_h / Gyro().bias_deg_h
    figures = (
        (tool.gyro, tool.gyro.noise_deg_sqrt_h, walk),
        (precision, precision.noise_deg_sqrt_h or TACTICAL_NOISE_DEG_RTH, precision.walk_deg_h_sqrt_h),
    )
    conventional, fine = (
        gyro_azimuth_filter.gyro_unit(noise, gyro.bias_deg_h, walk, gyro.misalignment_mrad * 1e3, gyro.g_deg_h_g)
        for gyro, noise, walk in figures
    )
    return usual._replace(
        units=(conventional._replace(lag=usual.units[0].lag), fine._replace(lag=usual.units[1].lag)),
        precision_range=0.98 * math.radians(min(precision.range_deg_s)),
        bin_ns=BIN_NS,
        vertical_sin2=math.sin(math.radians(settings.attitude.vertical_deg)) ** 2,
    )


def gyrocompass_params(settings: EstimatorSettings) -> SeekParams:
    """Return the parameters of the gyro azimuth of a station."""
    gyro, latitude_deg = settings.tool.precision.gyro, settings.place.lat_deg
    return dataclasses.replace(
        TACTICAL,
        method=settings.survey.gyro_method,
        latitude_deg=math.nan if latitude_deg is None else latitude_deg,
        height_m=settings.place.height_m,
        gyro_noise_deg_rth=gyro.noise_deg_sqrt_h,
        gyro_bias_deg_h=gyro.bias_deg_h,
        gyro_x_bias_deg_h=gyro.bias_deg_h,
        gyro_walk_deg_h_rth=gyro.walk_deg_h_sqrt_h,
        gyro_ramp_deg_h2=_RAMP_PER_H * gyro.bias_deg_h,
        leak_urad=gyro.misalignment_mrad * 1e3,
        g_sensitivity_deg_h_g=gyro.g_deg_h_g,
        g_calibration_deg_h_g=gyro.g_calibration_deg_h_g,
        gyro_range_dps=min(gyro.range_deg_s),
    )


def north_params(settings: EstimatorSettings) -> SessionParams:
    """Return the parameters of a north seek on request."""
    from mwd_estimation.gyrocompass.session import SessionParams

    gyro = settings.tool.gyro
    return SessionParams(
        x_noise_deg_rth=gyro.noise_deg_sqrt_h,
        x_bias_deg_h=gyro.bias_deg_h,
    )


def reference(settings: EstimatorSettings, first_ns: int) -> Reference | None:
    """
    Return the reference of the place, with the sigmas of the tool code if one is set; None if no field is set.

    first_ns : stamp of the first sample, from which the date follows if no date is set.

    Raises
    ------
    ValueError
        See `reference_of` and `tool_code.reference_sigmas`; also if the tool code assumes an in-field reference but the
        field comes from a global model.
    """
    found = reference_of(settings.place, first_ns)
    return None if found is None else with_code(settings, found)


def reference_or_none(settings: EstimatorSettings, first_ns: int) -> Reference | None:
    """
    Return the result of `reference`; without a set date, a reference without values if `reference` raises ValueError.

    The `source` of a reference without values states the error. Thus a node whose clock is outside the years of the
    model still estimates gravity. Returns None if no field is set. If a date is set, errors are raised as in
    `reference`.
    """
    try:
        return reference(settings, first_ns)
    except ValueError as error:
        if settings.place.date:
            raise
        return Reference(source=f"none: {error}; set the clock, or place.date")


def check(settings: EstimatorSettings) -> None:
    """
    Check that the settings allow a reference, on the set date or, without a date, on a date within the model.

    Raises
    ------
    ValueError
        See `reference`; or the temperatures of the tool's calibration are in the wrong order.
    """
    low_c, high_c = settings.tool.calibrated_c
    if low_c > high_c:
        raise SettingsError(f"tool.calibrated_c: {low_c:g} degC is above {high_c:g} degC; exchange the two")
    day_of(settings.place)
    first_year, _ = earth.years(settings.place.model or earth.MODELS[0])
    day = datetime.datetime(math.ceil(first_year) + 1, 1, 1, tzinfo=datetime.UTC)
    reference(settings, round(day.timestamp()) * 10**9)


def with_code(settings: EstimatorSettings, found: Reference) -> Reference:
    """Return the reference with the sigmas of the tool code, if one is set; raise ValueError as in `reference`."""
    place, code = settings.place, settings.survey.tool_code
    if not code:
        return found
    if "IFR" in code and place.model:
        raise SettingsError(
            f"survey.tool_code: {code} needs an in-field reference and {found.source} is a global model; "
            "give the field of the IFR certificate (place.field fixed), or choose a code with SRGM, HRGM (HDGM) or "
            "LRGM (WMM, IGRF)"
        )
    # Keep the sigmas that a certificate states for this place; the sigmas of the tool code apply to all places.
    return found if place.source else tool_code.reference_for(code, found)


def sensor_errors(settings: EstimatorSettings) -> SensorErrors:
    """
    Return the errors of a station's readings: from the tool code if one is set, else from the settings of the tool.

    No tool code describes the rotation of the accelerometers in their mount. For this rotation the direction error in
    the settings of the tool is added in squares to the error that remains after a calibration of both triads.

    Raises
    ------
    ValueError
        If `survey.tool_code` does not name a tool code, or names a tool code that is not for magnetic surveys; or as in
        `assembly`.
    """
    tool, described = settings.tool, assembly(settings.tool)
    mount_deg = math.hypot(SensorErrors.mount_deg, math.degrees(1e-3 * (tool.accelerometer.misalignment_mrad or 0.0)))
    along, across = _string_nt(tool)
    if settings.survey.tool_code:
        errors = dataclasses.replace(tool_code.sensor_errors(settings.survey.tool_code), mount_deg=mount_deg)
        if tool.string != Tool().string:
            # Tool codes assume enough non-magnetic collars around the tool.
            errors = dataclasses.replace(errors, axial_interference_nt=along, cross_interference_nt=across)
        return errors if described is None else dataclasses.replace(errors, sag_deg=described.sigma_sag_deg)
    return SensorErrors(
        accelerometer_bias_mps2=tool.accelerometer.bias_ug / 1e6 * STANDARD_GRAVITY,
        accelerometer_scale=tool.accelerometer.scale_ppm / 1e6,
        magnetometer_bias_nt=tool.magnetometer.bias_nt,
        magnetometer_scale=tool.magnetometer.scale_ppm / 1e6,
        axial_interference_nt=along,
        cross_interference_nt=across,
        mount_deg=mount_deg,
        sag_deg=_sag_deg(tool, described),
    )


def _string_nt(tool: Tool) -> tuple[float, float]:
    """Return 1 sigma of the string's field along and across the axis, nT, from the settings or the kind of string."""
    along, across = _STRINGS_NT[tool.string]
    return along if tool.axial_interference_nt is None else tool.axial_interference_nt, across


def _sag_deg(tool: Tool, described: Assembly | None) -> float:
    """
    Return 1 sigma of the remaining sag error, deg.

    It is given by the assembly file. Without a file it depends on whether the settings state a sag correction.
    """
    if described is not None:
        return described.sigma_sag_deg
    return SIGMA_CORRECTED_DEG if tool.sag_correction_deg != 0.0 else SensorErrors().sag_deg


def assembly(tool: Tool) -> Assembly | None:
    """
    Return the bottom-hole assembly from the file in the settings; None if no file is set.

    Raises
    ------
    SettingsError
        If the file cannot be read, is not an assembly, or a sag correction is set in addition to the file.
    """
    if not tool.assembly_file:
        return None
    if tool.sag_correction_deg != 0.0:
        raise SettingsError(
            "tool.sag_correction_deg: must be 0 together with tool.assembly_file, whose sag is computed"
        )
    try:
        with contents_hidden(tool.assembly_file, "`mwd sag`"):
            return read_assembly(Path(tool.assembly_file))
    except SettingsError as error:
        raise SettingsError(f"tool.assembly_file: {error}") from None


def sag_correction(tool: Tool) -> SagCorrection:
    """
    Return the correction of the inclination for sag, from the assembly file or from `sag_correction_deg`.

    Raises SettingsError as `assembly`, and ValueError as `sag.sag`.
    """
    described = assembly(tool)
    if described is None:
        return SagCorrection(math.radians(tool.sag_correction_deg))
    return correction_of(described)


def calibrated_range(tool: Tool) -> CalibratedRange:
    """Return the temperature range of the calibration of the tool, and the growth of its errors outside this range."""
    return CalibratedRange(
        *tool.calibrated_c,
        accelerometer_mps2_per_c=tool.accelerometer.bias_ug_per_c / 1e6 * STANDARD_GRAVITY,
        magnetometer_t_per_c=tool.magnetometer.bias_nt_per_c * 1e-9,
    )


def station_params(settings: EstimatorSettings) -> StationSettings:
    """Return the parameters for the calculation of a station."""
    tool, survey, verdict = settings.tool, settings.survey, settings.verdict
    return StationSettings(
        north=survey.north,
        sag=sag_correction(tool),
        hole_axis_deg=tool.hole_axis_deg,
        toolface_offset_deg=tool.toolface_offset_deg,
        errors=sensor_errors(settings),
        calibrated=calibrated_range(tool),
        quality=verdict,
        possible_axial=interference_params(settings).axial,
        priors=station_priors(settings),
    )


def station_priors(settings: EstimatorSettings) -> Priors:
    """Return the prior probabilities of the disturbances of a station; two of them are raised for a string of steel."""
    external = settings.verdict.external_field
    if settings.tool.string != "steel":
        return Priors(external=external)
    return Priors(external=max(external, _OF_STEEL), turned=_OF_STEEL)


def dwell_params(settings: EstimatorSettings) -> toolface_dwell.DwellParams:
    """Return the parameters of the decision when a toolface can be used for steering."""
    from mwd_estimation.attitude import toolface_dwell

    return toolface_dwell.DwellParams(settings.attitude.toolface_dwell_s, settings.attitude.toolface_dwell_cycles)


def dynamics_params(settings: EstimatorSettings, gravity: float | None) -> drilling_dynamics.DynamicsParams:
    """Return the parameters of the summary of drilling dynamics; gravity: local gravity, m/s^2, None if unknown."""
    from mwd_estimation.attitude import drilling_dynamics

    return drilling_dynamics.DynamicsParams(settings.dynamics.shock_threshold, gravity or STANDARD_GRAVITY)
