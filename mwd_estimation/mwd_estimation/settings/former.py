# SPDX-License-Identifier: Apache-2.0
"""
Parameters of before: where they are now, or the value that each has kept as a constant.

Set as a parameter, a name here is refused with a sentence. In recordings and files of settings it counts where its
value can be kept: `present` gives what has another name now, and leaves out a value that is the constant's.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

# Parameters of before with the value that each had by default. In brackets: what brings the number now.
CONSTANT: Mapping[str, float | str] = {
    "tool.gyro.walk_deg_h_sqrt_h": 10.0,  # in proportion to the bias (derivation.py)
    "tool.gyro.scale_ppm": 5000.0,  # of an x gyro that a tumble calibration has not reached (SessionParams)
    "tool.gyro.delay_ms": 0.5,  # filters of two sensors of one unit (gyro_azimuth.CONVENTIONAL)
    "tool.precision.gyro.ramp_per_h": 0.6,  # in proportion to the bias (derivation.py)
    "tool.precision.gyro.delay_ms": 2.0,  # (gyro_azimuth.TACTICAL)
    "tool.precision.accelerometer.noise_ug_sqrt_hz": 30.0,  # (SeekParams)
    "tool.precision.accelerometer.bias_ug": 200.0,  # (seek_params.TACTICAL)
    "tool.lever_m": 0.03,  # half the bore of a collar (bounded.Params)
    "tool.misalignment_deg": 0.1,  # XYM1, XYM2 of the ISCWSA MWD code (SensorErrors), or those of survey.tool_code
    "tool.course_misalignment_deg": 0.3,  # XYM3E, XYM4E, likewise
    "tool.sag_deg": 0.2,  # SAGE, likewise; 0.08 with a sag correction
    "place.storm_nt": 100.0,  # (reference_field.STORM)
    "survey.rotary_s": 30.0,  # a request may name another
    "survey.north_seek_s": 120.0,  # likewise
    "survey.min_gyro_s": 30.0,  # (SeekParams)
    "survey.max_rate": 0.03,  # survey.motion multiplies this and the next two
    "survey.max_rate_noise": 0.03,
    "survey.max_force_noise": 0.25,
    "verdict.magnetised_string": 0.3,  # (hypotheses.Priors)
    "verdict.wrong_reference": 0.12,  # likewise
    "verdict.max_gyro_sigma_deg": 20.0,  # beyond it an azimuth hardly weighs (seek_refusal.py)
    "dynamics.period_s": 1.0,  # (drilling_dynamics.py)
    "transmit.continuous_s": 10.0,  # (transmitter.py)
    "transmit.flow_threshold_lpm": 600.0,  # that of a tool configuration without it
    "tool.possible_axial_nt": 2000.0,  # in proportion to tool.axial_interference_nt (derivation.py)
    "place.gravity_mps2": 0.0,  # by the latitude
    "gravity.expert.max_bridged_gap_s": 10.0,  # (bounded.Params)
    "attitude.smoothing_s": 1.0,  # (time_alignment_state.Params)
    "tool.precision.gyro.scale_ppm": 500.0,  # (seek_params.TACTICAL); from 17 r/min on its x gyro is not read
    "tool.mount.frame": "sonde_link",  # (wire.SONDE_FRAME)
    "place.model": "wmm2025",  # (place.field)
    "gravity.expert.axial_speed": 1.0,  # a string is tripped at that speed (bounded.Params)
    "health.watch": True,
    "tool.precision.gyro.bias_scale": "at_most",  # nothing was asked for: the stations of a run tell more now
}

# Of these, what is in proportion to a parameter now: the constant's value is that of the parameter's default.
PROPORTIONAL: Mapping[str, str] = {
    "tool.gyro.walk_deg_h_sqrt_h": "tool.gyro.bias_deg_h",
    "tool.possible_axial_nt": "tool.axial_interference_nt",
}

# Parameters that are one list now: their former names, in its order, with the value that each had by default.
MERGED: Mapping[str, Mapping[str, float]] = {
    "tool.calibrated_c": {"tool.calibrated_low_c": -40.0, "tool.calibrated_high_c": 175.0},
    "tool.hole_axis_deg": {"tool.misalignment_y_deg": 0.0, "tool.misalignment_z_deg": 0.0},
    "place.source_sigmas": {
        "place.sigma_total_nt": 0.0,
        "place.sigma_dip_deg": 0.0,
        "place.sigma_declination_deg": 0.0,
    },
    "verdict.custom_limits": {
        "verdict.gravity_limit_mg": 2.5,
        "verdict.field_limit_nt": 300.0,
        "verdict.dip_limit_deg": 0.45,
    },
}
_SWITCHING, _HOLD_S = "transmit.rotation_switching", "transmit.rotation_hold_s"

# Other names, blocks of before among them, and what does their work now.
FORMER: Mapping[str, str] = {
    "method": "gravity.method",
    "reference": "place",
    "azimuth": "attitude, tool.magnetometer.delay_s and tool.latency_s",
    "carried": "attitude and tool.gyro",
    "interference": "tool.axial_interference_nt",
    "station": "survey, verdict and tool",
    "gyro": "tool.precision, survey.gyro_method and place.lat_deg",
    "multistation": "part of every survey; its priors are constants",
    "north": "the duration of a request, and tool.gyro",
    "rotary": "the duration of a request",
    "fusion": "verdict",
    "tool.calibration_mrad": "part of tool.accelerometer (bias_ug, scale_ppm, misalignment_mrad)",
    "survey.azimuth_method": (
        "decided by the posterior of the azimuth; raw and corrected stay beside it for comparison"
    ),
    "survey.multi_station": "part of every survey",
    "verdict.disagreement_sigmas": "decided by the posterior of the azimuth; see verdict.far_probability",
    "verdict.max_gyro_alone_sigma_deg": "verdict.far_deg",
    "verdict.unconfirmed": "not needed: a gyro that cannot confirm is no reason to doubt",
    "verdict.max_correction_sigma_deg": "verdict.far_deg",
    "verdict.sigma_factor": "decided by the probability of a large error; see verdict.far_deg",
    "verdict.least_sigma_deg": "verdict.far_deg: with the default probability its sigma is a third of it",
    **dict.fromkeys(("bounded", "s3", "mahony", "kalman", "raw"), "gravity.expert and tool"),
    **{name: f"a constant ({value})" for name, value in CONSTANT.items()},
    **dict.fromkeys(("survey.max_rate", "survey.max_rate_noise", "survey.max_force_noise"), "survey.motion"),
    "tool.precision.accelerometer": "two constants (noise 30 ug/sqrt(Hz), bias 200 ug)",
    "tool.precision.gyro.bias_scale": "found by the stations of a run; the bias stated is that of its type of unit",
    "verdict.magnetised_string": "a constant (0.3); tool.axial_interference_nt tells of a magnetic string",
    "tool.gyro.walk_deg_h_sqrt_h": "derived: in proportion to tool.gyro.bias_deg_h",
    "tool.possible_axial_nt": "derived: nine times tool.axial_interference_nt",
    "place.gravity_mps2": "derived: of place.lat_deg, or the standard value without it",
    **dict.fromkeys(MERGED["tool.calibrated_c"], "tool.calibrated_c, lowest and highest"),
    **dict.fromkeys(MERGED["tool.hole_axis_deg"], "tool.hole_axis_deg, about y and z"),
    "tool.mount.frame": "a constant (sonde_link): a static transform joins it to a frame of another name",
    "place.model": "place.field: model is the WMM2025, igrf the IGRF",
    **dict.fromkeys(
        MERGED["place.source_sigmas"],
        "place.source_sigmas, of total (nT), dip (deg) and declination (deg)",
    ),
    **dict.fromkeys(
        MERGED["verdict.custom_limits"],
        "verdict.custom_limits, of gravity (mG), field (nT) and dip (deg)",
    ),
    **dict.fromkeys(("health", "health.watch"), "always on: a faulty sensor is left out"),
    **dict.fromkeys(
        (_SWITCHING, _HOLD_S),
        "transmit.rotation_switching_s, the time for which the string has to turn or stand; 0: no switching",
    ),
    "transmit.flow_threshold_lpm": "flow_threshold_lpm of the tool configuration (transmit.tool_file)",
    "tool.sag_deg": "derived: 0.2 deg, or 0.08 with tool.sag_correction_deg or tool.assembly_file",
}


def former(block: str) -> dict[str, str]:
    """What is said of the former names of a block, by their names in it."""
    return {name.removeprefix(f"{block}."): now for name, now in FORMER.items() if name.startswith(f"{block}.")}


def present(recorded: Mapping[str, Any], usual: Mapping[str, Any]) -> dict[str, Any]:
    """
    Recorded parameters, name -> value, by their names of today where their values can be kept.

    A part of a list that is not recorded has its former default. A constant with the value that it has now is left out.
    All other names and values stay as they are. usual: today's parameters, name -> default.
    """
    found = dict(recorded)
    for name, parts in MERGED.items():
        if name not in recorded and parts.keys() & recorded.keys():
            found[name] = [found.pop(part, default) for part, default in parts.items()]
    switching = recorded.get(_SWITCHING, False)
    former_switching = isinstance(switching, bool) and {_SWITCHING, _HOLD_S} & recorded.keys()
    if "transmit.rotation_switching_s" not in recorded and former_switching:
        found.pop(_SWITCHING, None)
        hold_s = found.pop(_HOLD_S, 10.0)
        found["transmit.rotation_switching_s"] = hold_s if switching else 0.0
    # The model counted beside a field of a model only.
    if found.get("place.model") == "igrf":
        del found["place.model"]
        if found.get("place.field") == "model":
            found["place.field"] = "igrf"
    for name, value in CONSTANT.items():
        parameter = PROPORTIONAL.get(name)
        changed = parameter is not None and found.get(parameter, usual[parameter]) != usual[parameter]
        if not changed and found.get(name) == value:
            del found[name]
    return found
