# SPDX-License-Identifier: Apache-2.0
"""
Texts of the reasons, for messages, tables and logs. No program parses these sentences.

Each text is a format string over the fields of `Reason`. The format of a number names its unit, which also converts it
from SI: ``{value:+.1f deg}`` prints 0.1 rad as ``+5.7 deg``, ``{value:+.1f (deg)}`` prints it as ``+5.7``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from mwd_estimation.core.fault_messages import describe
from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_sensors.core.constants import STANDARD_GRAVITY

# Conversion factors: one SI unit, expressed in the named unit.
UNITS = {
    "deg": math.degrees(1.0),
    "deg/s": math.degrees(1.0),
    "deg/h": math.degrees(3600.0),
    "rad/s": 1.0,
    "r/min": 30.0 / math.pi,
    "nT": 1e9,
    "uT": 1e6,
    "T": 1.0,
    "mG": 1e3 / STANDARD_GRAVITY,
    "m/s^2": 1.0,
    "ppm": 1e6,
    "urad": 1e6,
    "sigma": 1.0,
    "%": 100.0,
    "s": 1.0,
}
# Names of azimuth methods in messages, where they differ from the internal names.
METHODS = {"msa": "multi-station", "carried": "gyro-propagated"}
# Names of the hypotheses on the cause of a magnetic disturbance.
HYPOTHESES = {
    "clean": "nothing beyond the tool code",
    "axial": "string magnetised along its axis",
    "cross_axial": "magnetised collar",
    "external": "steel outside the string",
    "reference": "wrong reference or magnetic storm",
    "place": "field of another place",
    "shielding": "magnetic mud or soft iron that shields the magnetometer",
    "scale": "magnetometer with a wrong scale",
    "sensor": "accelerometers turned in their mount",
}
_REST = "let the tool rest longer, or turn it between two rests"
_UNCERTAIN = "azimuth may be wrong by more than {limit:.0f deg} (probability {value:.1f %}): "
_BIAS_UNKNOWN = (
    "the gyro bias is known only to {values[0]:.2g deg/h}, which leaves the azimuth uncertain by {value:.0f deg}: "
)

WORDS: dict[Code, str] = {
    Code.GRAVITY_OFF: "total gravity {value:+.1f mG} off the reference, limit {limit:.1f mG}: "
    "the tool moved, or an accelerometer is wrong",
    Code.GRAVITY_OFF_STANDARD: "total gravity {value:+.1f mG} off standard gravity (nearer than the place's), "
    "limit {limit:.1f mG}: the tool moved, or an accelerometer is wrong",
    Code.FIELD_OFF: "total field {value:+.0f nT} off the reference, limit {limit:.0f nT}: "
    "external interference, or a magnetometer is wrong",
    Code.DIP_OFF: "dip {value:+.2f deg} off the reference, limit {limit:.2f deg}: "
    "magnetic interference (casing or another well near), or a sensor is wrong",
    Code.TOTALS_OFF_TOGETHER: "total gravity, total field and dip together do not fit: "
    "chi-square {value:.1f}, limit {limit:.1f}",
    Code.WITHIN_LIMITS: "within limits: {causes_listed}",
    Code.GRAVITY_WITHIN: "total gravity {value:+.1f mG} off the reference (limit {limit:.1f mG})",
    Code.GRAVITY_WITHIN_STANDARD: "total gravity {value:+.1f mG} off standard gravity (nearer than the place's; "
    "limit {limit:.1f mG})",
    Code.FIELD_WITHIN: "total field {value:+.0f nT} off the reference (limit {limit:.0f nT})",
    Code.DIP_WITHIN: "dip {value:+.2f deg} off the reference (limit {limit:.2f deg})",
    Code.GRAVITY_NOT_EARTH: "total gravity {value:.4g m/s^2} is not the Earth's",
    Code.GRAVITY_IN_G: "total gravity {value:.4g m/s^2} is not the Earth's: a reading in g?",
    Code.FIELD_NOT_EARTH: "total field {value:.0f nT} is not the Earth's",
    Code.FIELD_IN_OTHER_UNIT: "total field {value:.4g T} is not the Earth's: a reading in {names[0]}?",
    Code.DIP_SIGN: "dip {value:.1f deg} has the opposite sign of the reference: accelerometers or magnetometers "
    "are connected with a flipped sign, or the dip or latitude of the reference was given with the wrong sign",
    Code.NO_ACCELEROMETER: "no accelerometer reading: nothing can be computed",
    Code.NO_MAGNETOMETER: "no magnetometer reading",
    Code.NO_NUMBER: "no number in {names_listed}",
    Code.TABLE_UNIT: "the total of {names[0]} shows that the readings are in {names[1]}, not in the unit used: "
    "correct the unit of the columns and compute again",
    Code.DEAD_AXIS: "{names[0]} stays the same while the other axes turn: the axis is dead, or its column is wrong; "
    "check the tool",
    Code.WIRING: "{names[1]} (according to the {names[0]}): {remedies}; correct the columns and compute again",
    Code.NO_HORIZONTAL_FIELD: "no horizontal field",
    Code.INCLINATION_ONLY: "{causes}: only inclination and toolface are computed",
    Code.NORTH_UNKNOWN: "an azimuth from {names[0]} north needs the {names[1]}: the azimuth is from magnetic north",
    Code.NO_REFERENCE_FIELD: "no reference field: the azimuth is from {names[0]} north and not corrected, and total "
    "field and dip are not checked",
    Code.STRING_ROTATED: "the survey was taken while the string turned at {value:.0f r/min}, so it has no toolface",
    Code.SAG_CORRECTED: "inclination corrected for sag by {value:+.2f deg}",
    Code.MAGNETIC_STORM: "magnetic storm: the field at observatory {names[0]} was {value:.0f nT} off its quiet level "
    "(limit {limit:.0f nT}); the reference contains it, survey again when the field is quiet",
    Code.EXTERNAL_FIELD_UNKNOWN: "external field unknown: the file of observatory {names[0]} has no data of this time; "
    "add data of this time to the file and process again",
    Code.CORRECTION_NEAR_VERTICAL: "hole only {value:.2f deg} from vertical: axial interference hardly "
    "changes the azimuth there and the toolface is too uncertain to correct the azimuth",
    Code.CROSS_AXIAL_MISFIT: "across-axis field does not fit the reference (chi-square {value:.0f}, limit "
    "{limit:.1f}): the disturbance is not axial (casing, nearby well, hot spot in the collar) "
    "or the reference is not this place's",
    Code.TWO_AZIMUTHS_FIT_FIELD: "two azimuths, {values[0]:.1f (deg)} and {values[1]:.1f deg} from magnetic north, fit "
    "the readings without the axial magnetometer: horizontal hole, take a gyro",
    Code.CORRECTION_UNCERTAIN: "hole {values[0]:.0f deg} from horizontal and {values[1]:.0f deg} from magnetic "
    "east-west: corrected azimuth accurate only to {value:.1f deg}, limit {limit:.1f deg}; "
    "stations of the run in other directions help, or a gyro",
    Code.STATIONS_DO_NOT_FIT: "{value:.0f} of {values[0]:.0f} stations do not fit one set of errors: "
    "the disturbance changes along the run (casing, other wells) or the tool was changed",
    Code.STATIONS_IMPROBABLE: "the stations do not fit one set of errors and this reference: chi-square "
    "{values[0]:.0f} of {values[1]:.0f} degrees of freedom, probability {value:.1g}, limit {limit:g}",
    Code.MULTI_STATION_UNCERTAIN: "corrected azimuth accurate only to {value:.1f deg} (limit {limit:.1f deg}): "
    "the axial interference cannot be found from these attitudes; take stations at other azimuths or a gyro",
    Code.MULTI_STATION_NO_BETTER: "corrected azimuth no better than the raw one "
    "({value:.2f (deg)} against {limit:.2f deg})",
    Code.AZIMUTH_NOT_DETERMINED: "near vertical: the azimuth is not determined (sigma {value:.0f deg}), "
    "use the magnetic toolface",
    Code.AZIMUTHS_FIT: "more than one azimuth fits: {value:.1f deg} with {limit:.1f %}{alternatives}; "
    "take a gyro, or survey again at another toolface",
    Code.EXTERNAL_FIELD: "external magnetic field (probability {value:.0f %}; casing, fish or another well near): "
    "move the sensor away or use a gyro",
    Code.FIELD_UNEXPLAINED: "no disturbance explains the magnetic reading (chi-square {value:.0f}, limit {limit:.0f}): "
    "check the magnetometer and the reference field",
    Code.FIELD_OF_ANOTHER_PLACE: "the field fits another place: its deviation from the reference is the same at the "
    "stations of the run; check latitude, longitude and date of the place, or the given reference",
    Code.REFERENCE_SLIP: "the reference is probably given wrong: the readings ({values[0]:.0f nT}, dip "
    "{values[1]:.1f deg}) fit {names[0]}; correct the reference and process again",
    Code.SENSOR_DEFECT: "the accelerometers are probably turned in their mount (probability {value:.0f %}): "
    "check the tool at surface, or change the tool",
    Code.MOUNT_MAY_BE_TURNED: "inclination may be wrong by {value:.1f deg} (1 sigma): the dip also fits accelerometers "
    "turned in their mount; survey again at another toolface, check the tool at surface",
    Code.READINGS_REPEATED: "all digits of the readings equal those of station {value:.0f} of this run: old data were "
    "sent again; survey again",
    Code.UNCERTAIN_STRING: _UNCERTAIN + "drill-string interference cannot be determined well enough at this "
    "attitude, at any toolface; take a gyro, or stations of this run where the hole has another direction",
    Code.UNCERTAIN_COLLAR: _UNCERTAIN + "the field of a magnetised collar cannot be determined well enough; take "
    "stations at other toolfaces, or a gyro",
    Code.UNCERTAIN_EXTERNAL: _UNCERTAIN + "there may be steel near (casing, fish, another well); "
    "move the sensor away or use a gyro",
    Code.UNCERTAIN_REFERENCE: _UNCERTAIN + "the field does not fit the reference; "
    "check place, date and magnetic storms",
    Code.UNCERTAIN_SENSOR: _UNCERTAIN + "a sensor may be out of calibration, or shielded by magnetic mud; "
    "check the tool at surface",
    Code.UNCERTAIN_FOR_ANY_TOOL: "the sigma of the azimuth is {value:.0f deg}, and {limit:.0f deg} here even "
    "with a faultless magnetic tool: the horizontal field is weak, or the string is of steel; use a gyro at two "
    "toolfaces",
    Code.GYRO_DISAGREES: "gyro and magnetic azimuth disagree (probability {value:.0f %} that the gyro is wrong): "
    "let the tool rest and survey again, at another toolface if it can be turned",
    Code.PROPAGATED_DISAGREES: "the azimuth is {value:+.1f deg} ({values[0]:.1f sigma}) from the azimuth that the "
    "gyros propagated from the last accepted station: external magnetic field, or that station was wrong; survey again",
    Code.HYPOTHESES: "possible disturbances of the field: {odds}",
    Code.GYRO_ONLY_UNCERTAIN: _UNCERTAIN + "the azimuth is from the gyro alone; " + _REST,
    Code.GYRO_NORTH_UNKNOWN: "no gyro azimuth from {names[0]} north because the angle from true to {names[0]} north is "
    "not known: complete the settings of place",
    Code.SENSOR_FAULT: "{fault}; {remedy}",
    Code.SENSOR_FAULT_ENDED: "{fault}, until {value:.1f s} after this survey began: take the survey again",
    Code.SENSOR_SUSPECT: "the {names[0]} was in doubt while this survey was averaged: take the survey again",
    Code.PRECISION_UNIT_FAULT: "{fault}: {remedy}",
    Code.PRECISION_UNIT_SUSPECT: "a check contradicts the precision unit: the unit is not used until the cause "
    "is known",
    Code.LATITUDE_UNKNOWN: "the latitude is not known: set place.lat_deg and place.lon_deg",
    Code.LATITUDE_POLAR: "latitude {value:.1f deg} is too near the pole: the Earth's rotation is vertical there and "
    "no gyro finds north above latitude {limit:.0f deg}",
    Code.NO_PRECISION_UNIT: "no samples of the precision unit arrive (gyro/data_raw)",
    Code.TOOL_NOT_STILL: "the tool has not kept still",
    Code.SEEK_LEVELLING: "the gyro needs {limit:.0f s} of data, had {value:.0f s}: the direction of gravity is "
    "still being measured",
    Code.SEEK_TOO_SHORT: "the gyro needs {limit:.0f s} of data, had {value:.0f s}",
    Code.SEEK_IMPROVES: "azimuth accurate to {value:.1f deg} after {values[0]:.0f s}",
    Code.GYRO_CLIPPED: "a gyro clipped (range {values[1]:.0f deg/s}) in {value:.0f} of {values[0]:.0f} samples: "
    "turn slower or stop the pumps",
    Code.TURNED_AT_REST: "the tool turned for {value:.0f s} of {values[0]:.0f s}: "
    "a still shot needs the string at rest",
    Code.TURNED_TOO_LITTLE: "the tool turned for only {value:.0f s} of {values[0]:.0f s}: keep the string turning",
    Code.NO_SECOND_POSITION: "the tool was not turned to a second position: "
    "turn it half a turn about its axis and wait again",
    Code.TOOL_MOVED: "the tool moved: keep off bottom and in one place",
    Code.HOLE_AXIS_MOVED: "the tool moved: its axis changed direction {value:.0f} times; "
    "keep off bottom and in one place",
    Code.HOLE_AXIS_SWINGS: "the tool shakes: its axis swings by {value:.2f deg}; a still shot needs pumps off",
    Code.VERTICAL_HOLE: "inclination {value:.1f deg}: a vertical hole has no azimuth; "
    "use the azimuth of the scribe line",
    Code.EAST_WEST_HOLE: "the hole lies within {value:.0f deg} of horizontal east-west (azimuth about "
    "{values[0]:.0f deg}): turning the tool about its axis does not show north there; "
    "take a still shot with a known gyro bias",
    Code.GYRO_BIAS_EXCESSIVE: "the {names[0]} is estimated as {value:.3g deg/h}, the settings state a "
    "sigma of {limit:.3g (deg/h)}: check the gyro unit",
    Code.GYRO_SCALE_EXCESSIVE: "the {names[0]} is estimated as {value:.3g ppm}, the settings state a "
    "sigma of {limit:.3g (ppm)}: check the gyro unit",
    Code.GYRO_LEAK_EXCESSIVE: "the {names[0]} is estimated as {value:.3g urad}, the settings state a "
    "sigma of {limit:.3g (urad)}: check the gyro unit",
    Code.TWO_AZIMUTHS_FIT_GYRO: "two azimuths fit equally, {values[0]:.1f (deg)} and {values[1]:.1f deg}: so "
    "near the horizontal, turning the tool does not show whether the hole points north or south of east-west; "
    "seek longer, or choose by the magnetometer",
    Code.LATITUDE_MISFIT: "the Earth rate found does not fit latitude {values[0]:.1f deg} "
    "({value:.1f sigma}): the tool moved, or a gyro error is larger than stated",
    Code.LATITUDE_OTHER: "the latitude of {values[0]:.1f deg} is wrong with a probability of {value:.0f %}; another "
    "latitude, such as {values[1]:.1f deg}, gives another azimuth; check the latitude and its sign",
    Code.GYRO_BIAS_UNKNOWN: _BIAS_UNKNOWN + "turn the tool half a turn about its axis and wait again",
    Code.GYRO_BIAS_UNKNOWN_STATIC: _BIAS_UNKNOWN + "the method S1 cannot use a second position",
    Code.SEEK_UNCERTAIN: "the sigma of the azimuth is {value:.0f deg} after {values[0]:.0f s}, "
    "limit {limit:.0f deg}; wait longer",
    Code.TOO_FEW_SAMPLES: "too few samples to tell whether the tool keeps still: {value:.0f} in half a second, "
    "{limit:.0f} are needed",
    Code.SAMPLES_MISSING: "samples are missing",
    Code.TOOL_TURNS: "the tool turns: {value:.3f rad/s}, limit {limit:.3f}",
    Code.TOOL_MOVES: "the tool moves: angular rate varies by {value:.3f rad/s}, limit {limit:.3f}",
    Code.TOOL_SHAKES: "the tool shakes: {value:.2f m/s^2}, limit {limit:.2f}",
    Code.TOOL_SHIFTS: "the tool shifts: {value:.2f m/s^2} in {values[0]:g s}, limit {limit:.2f}",
    Code.FIELD_TURNS: (
        "the magnetic field changes by {value:.0f nT} in {values[0]:g s}, limit {limit:.0f}, and no gyro shows whether"
        " the tool turns"
    ),
    Code.STRING_DOES_NOT_TURN: "the string does not turn: take a survey at rest",
    Code.TOO_FEW_WITH_GRAVITY: "too few samples with a known gravity",
    Code.TIME_WENT_BACK: "time went back: the estimate restarts",
    Code.NOISE_STATED: "the messages state more noise than the tool's settings: the estimate restarts; send the "
    "request again",
}


class _Number(float):
    """A number in SI, converted to the unit in its format; the unit is printed unless it stands in parentheses."""

    def __format__(self, spec: str) -> str:
        number, _, unit = spec.partition(" ")
        if not unit:
            return format(float(self), number)
        converted = format(float(self) * UNITS[unit.strip("()")], number)
        return converted if unit.startswith("(") else f"{converted} {unit}"


def text(reason: Reason) -> str:
    """Return the sentence for one reason."""
    causes = [text(one) for one in reason.causes]
    fault = None if reason.fault is None else describe(reason.fault)
    fields: dict[str, Any] = {
        "value": None if reason.value is None else _Number(reason.value),
        "limit": None if reason.limit is None else _Number(reason.limit),
        "values": [_Number(one) for one in reason.values],
        "names": [METHODS.get(name, name) for name in reason.names],
        "names_listed": ", ".join(reason.names),
        "remedies": ", or ".join(reason.names[2:]),
        "causes": "; ".join(causes),
        "causes_listed": ", ".join(causes),
        "odds": ", ".join(
            f"{HYPOTHESES.get(name, name)} {100.0 * odds:.0f} %"
            for name, odds in zip(reason.names, reason.values, strict=False)
        ),
        "alternatives": "".join(
            f", {math.degrees(angle):.1f} deg with {100.0 * odds:.1f} %"
            for angle, odds in zip(reason.values[::2], reason.values[1::2], strict=False)
        ),
        "fault": "" if fault is None else fault.message,
        "remedy": "" if fault is None else fault.remedy,
    }
    return WORDS[reason.code].format(**fields)


def texts(reasons: Iterable[Reason]) -> list[str]:
    """Return the sentences for several reasons, in the same order."""
    return [text(one) for one in reasons]


def joined(reasons: Iterable[Reason] | None) -> str:
    """Return the sentences of all reasons joined to one text; empty if there are no reasons."""
    return "; ".join(texts(reasons or ()))
