# SPDX-License-Identifier: Apache-2.0
"""
Comparison of several surveys at one depth: test for agreement within the tool code, and sensor biases.

A *rotation shot* repeats a survey with another toolface, a *check shot* with another tool or on another run. The hole
is the same, so the angles may differ only by errors that rotate with the tool, by errors that the tools do not share,
and by noise. The test is a chi-square of the differences against the covariance of the tool code's errors (R. Ekseth et
al., "The reliability problem related to directional survey data", IADC/SPE 103734, 2006, internal tests of magnetic
surveys, and SPE/IADC 105558, 2007, external tests).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mwd_estimation.core import magnetic_geometry
from mwd_estimation.core.chi_square import exceeded
from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.survey import tool_code
from mwd_estimation.survey.survey import Verdict
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.frames import gravity_toolface, inclination, wrap_pi
from mwd_surface.surveys.survey_record import SurveyRecord

# Surveys count as taken at one depth if they are at most this much deeper than the shallowest of them, m.
SAME_DEPTH = 0.5
# Curvature of the hole, rad/m, 1 sigma in each direction. At 1 sigma the hole turns by 0.1 deg in half a metre. Motors
# build up to twice this curvature.
_CURVATURE = math.radians(6.0) / 30.0
# Repeatability of a reading at one attitude, 1 sigma, m/s^2 and T: resolution of the telemetry and residual motion of
# the string.
REPEAT_FORCE, REPEAT_FIELD = 2e-3, 20e-9
# Smallest inclination at which azimuths are compared, rad.
_LEAST_INCLINATION = math.radians(3.0)
# Limits of the probability of a larger chi-square by chance. Below the first limit shots are doubtful, below the second
# they fail. The verdict of a survey uses the same limits.
_DOUBTFUL, _FAIL = 0.01, 0.001
# Biases are estimated only if every gap between the toolfaces of the shots is smaller than this, rad.
_WIDEST_GAP = math.pi
# Number of sigmas (of tool code and estimate, combined) above which a bias is out of specification.
_BIAS_SIGMAS = 3.0

PASS, DOUBTFUL, FAIL = "pass", "doubtful", "fail"


@dataclass(frozen=True)
class Bias:
    """Bias of one transverse axis: value with 1 sigma, and 1 sigma of the tool code (`expected`), m/s^2 or T."""

    sensor: str  #: "accelerometer" or "magnetometer"
    axis: str  #: "y" or "z"
    value: float
    sigma: float
    expected: float

    @property
    def excessive(self) -> bool:
        """Whether the bias is larger than the tool code allows, taking the uncertainty of the estimate into account."""
        return abs(self.value) > _BIAS_SIGMAS * math.hypot(self.expected, self.sigma)


@dataclass(frozen=True)
class CheckShot:
    """Comparison of the surveys at one depth."""

    md: float  #: mean depth, m
    rows: tuple[int, ...]  #: indices of the surveys in the input
    tools: tuple[str, ...]  #: tools with which the surveys were taken
    #: `inclination`, `azimuth`: mean of the shots, rad; azimuth magnetic and uncorrected, NaN if it is not compared.
    inclination: float
    azimuth: float
    #: `spread_inclination`, `spread_azimuth`: standard deviation of the shots about their mean, rad.
    spread_inclination: float
    spread_azimuth: float
    #: `expected_inclination`, `expected_azimuth`: the standard deviation expected from the tool code, rad.
    expected_inclination: float
    expected_azimuth: float
    chi_square: float  #: chi-square of all differences
    degrees_of_freedom: int
    probability: float  #: probability of a larger chi-square by chance
    biases: tuple[Bias, ...]  #: transverse biases; empty if the toolfaces do not allow an estimate
    verdict: str  #: pass, doubtful or fail


def check_shots(
    md: ArrayLike, f_t: ArrayLike, b_t: ArrayLike, errors: SensorErrors, tools: Sequence[str] = ()
) -> tuple[CheckShot, ...]:
    """
    Find the surveys that were repeated at one depth, and compare them.

    Parameters
    ----------
    md : array_like, shape (n,)
        Measured depth, m; a survey with NaN is not compared.
    f_t, b_t : array_like, shape (n, 3)
        Readings in tool axes, m/s^2 and T. A survey is left out if a reading is not finite, the force is at most
        1 m/s^2 or the field at most 1 uT.
    errors : SensorErrors
        Errors of the tool code.
    tools : sequence of str, optional
        Tool of each survey; different tools share no errors. By default all surveys are from one tool.

    Returns
    -------
    tuple of CheckShot
        Comparisons in the order of depth; empty if no survey was repeated.

    Raises
    ------
    ValueError
        The arguments differ in length, or the readings do not have three columns.
    """
    depth, force, field = (np.asarray(value, dtype=float) for value in (md, f_t, b_t))
    names = list(tools) or [""] * len(depth)
    if force.shape != (len(depth), 3) or field.shape != force.shape or len(names) != len(depth):
        raise ValueError(
            f"md, f_t, b_t, tools: must have the shapes (n,), (n, 3), (n, 3), (n,), got {depth.shape}, {force.shape},"
            f" {field.shape}, ({len(names)},)"
        )
    usable = np.isfinite(depth) & np.isfinite(force).all(axis=1) & np.isfinite(field).all(axis=1)
    usable &= (np.linalg.norm(force, axis=1) > 1.0) & (np.linalg.norm(field, axis=1) > 1e-6)
    found: list[list[int]] = []
    for row in sorted(np.flatnonzero(usable), key=lambda k: float(depth[k])):
        if found and depth[row] - depth[found[-1][0]] <= SAME_DEPTH:
            found[-1].append(int(row))
        else:
            found.append([int(row)])
    groups = (sorted(rows) for rows in found if len(rows) > 1)
    return tuple(
        _compared(depth[rows], rows, force[rows], field[rows], errors, [names[row] for row in rows]) for rows in groups
    )


def _compared(
    md: Array, rows: list[int], force: Array, field: Array, errors: SensorErrors, tools: list[str]
) -> CheckShot:
    """
    Return the comparison of the shots at one depth.

    md: measured depth of each shot, m, shape (n,); the direction of the hole may change between the shots. rows:
    indices of the shots in the input of `check_shots`. force, field: readings in tool axes, m/s^2 and T, shape (n, 3).
    """
    inclinations, azimuths = inclination(force), magnetic_geometry.raw_azimuth(force, field)
    first = float(azimuths[0])
    differences = np.stack([np.asarray(inclinations), wrap_pi(azimuths - first)])
    with_azimuth = math.sin(float(np.mean(inclinations))) >= math.sin(_LEAST_INCLINATION)
    # Along a curve the angles change in proportion to the depth; a change of azimuth is larger by the factor 1 /
    # sin(inclination).
    turned = np.outer(md - md.mean(), md - md.mean()) * _CURVATURE**2
    covariance = _covariance(force, field, errors, tools)
    covariance[0, 0] += turned
    covariance[1, 1] += turned / max(math.sin(float(np.mean(inclinations))), math.sin(_LEAST_INCLINATION)) ** 2
    count = len(rows)
    # Use deviations from the mean: an error common to all shots cannot be separated from the direction of the hole.
    centred = np.eye(count) - 1.0 / count
    expected = [math.sqrt(np.trace(centred @ covariance[k, k] @ centred) / (count - 1)) for k in range(2)]
    kinds = (0, 1) if with_azimuth else (0,)
    basis = np.linalg.qr(centred[:, : count - 1])[0]
    deviation = np.concatenate([basis.T @ differences[k] for k in kinds])
    joint = np.block([[basis.T @ covariance[j, k] @ basis for k in kinds] for j in kinds])
    chi_square = float(deviation @ np.linalg.solve(joint, deviation))
    degrees = len(deviation)
    probability = exceeded(chi_square, degrees)
    biases = _biases(force, field, errors) if len(set(tools)) == 1 else ()
    verdict = FAIL if probability < _FAIL else DOUBTFUL if probability < _DOUBTFUL else PASS
    if verdict == PASS and any(bias.excessive for bias in biases):
        verdict = DOUBTFUL
    return CheckShot(
        md=float(md.mean()),
        rows=tuple(rows),
        tools=tuple(dict.fromkeys(tools)),
        inclination=float(np.mean(inclinations)),
        azimuth=(first + float(differences[1].mean())) % math.tau if with_azimuth else math.nan,
        spread_inclination=float(np.std(differences[0], ddof=1)),
        spread_azimuth=float(np.std(differences[1], ddof=1)) if with_azimuth else math.nan,
        expected_inclination=expected[0],
        expected_azimuth=expected[1] if with_azimuth else math.nan,
        chi_square=chi_square,
        degrees_of_freedom=degrees,
        probability=probability,
        biases=biases,
        verdict=verdict,
    )


def _covariance(force: Array, field: Array, errors: SensorErrors, tools: list[str]) -> Array:
    """
    Return the covariance of (inclination, raw azimuth) of n shots, rad^2, shape (2, 2, n, n).

    The covariance contains the errors of the tool code, which shots of the same tool share, and the repeatability of
    each reading.
    """
    slopes = magnetic_geometry.angle_jacobian(force, field)[:, :2]
    count = len(force)
    # Errors of a tool common to all its shots: bias and scale of each axis, axial interference, misalignment in the
    # hole.
    bias = np.array([errors.accelerometer_bias_mps2] * 3 + [errors.magnetometer_bias_nt * 1e-9] * 3)
    scale = np.array([errors.accelerometer_scale] * 3 + [errors.magnetometer_scale] * 3)
    readings = np.hstack([force, field])
    tilts = []
    for axis in np.eye(3)[1:]:
        turned = np.hstack([np.cross(axis, force), np.cross(axis, field)])
        tilts.append(np.einsum("nij,nj->ni", slopes, turned) * math.radians(errors.misalignment_deg))
    columns = np.concatenate(
        [
            slopes * bias,
            slopes * (scale * readings[:, None, :]),
            slopes[:, :, 3:4] * errors.axial_interference_nt * 1e-9,
            np.stack(tilts, axis=-1),
        ],
        axis=-1,
    )
    same = np.array([[one == other for other in tools] for one in tools])
    shared = np.einsum("mip,njp->ijmn", columns, columns) * same
    repeat = np.array([REPEAT_FORCE**2] * 3 + [REPEAT_FIELD**2] * 3)
    own = np.einsum("nip,p,njp->ijn", slopes, repeat, slopes)
    covariance = shared + own[..., None] * np.eye(count)
    # Near the vertical, an error e across the vertical plane also changes the inclination, by e^2 / (2 inclination).
    across = np.diagonal(covariance[0, 0])
    covariance[0, 0] += np.diag(0.5 * (across / np.maximum(inclination(force), 1e-3)) ** 2)
    return np.asarray(covariance)


def _biases(force: Array, field: Array, errors: SensorErrors) -> tuple[Bias, ...]:
    """
    Return the biases of the y and z sensors of one rotated tool; empty if the toolfaces do not allow an estimate.

    The y and z readings at several toolfaces lie on a circle, whose centre is the pair of biases. At least three shots
    and no gap of 180 deg between toolfaces are needed. Sensors with a circle that is too small are left out.
    """
    faces = np.sort(np.asarray(gravity_toolface(force)))
    gaps = np.diff([*faces, faces[0] + math.tau])
    if len(faces) < 3 or gaps.max() >= _WIDEST_GAP:
        return ()
    found = []
    for sensor, readings, repeat, scale, expected in (
        ("accelerometer", force, REPEAT_FORCE, errors.accelerometer_scale, errors.accelerometer_bias_mps2),
        ("magnetometer", field, REPEAT_FIELD, errors.magnetometer_scale, errors.magnetometer_bias_nt * 1e-9),
    ):
        across = readings[:, 1:]
        radius = float(np.linalg.norm(across - across.mean(axis=0), axis=1).mean())
        if radius < 10.0 * repeat:
            continue
        # |r|^2 = 2 c r + const is linear in the centre c (I. Kasa, IEEE Trans. Instrum. Meas. 25 (1976), 8-14).
        design = np.column_stack([2.0 * across / radius, np.ones(len(across))])
        solved = np.linalg.lstsq(design, np.sum(across**2, axis=1) / radius, rcond=None)[0]
        # The error of |r|^2 / radius is twice the error of a reading; unequal scale errors of the axes turn the circle
        # into an ellipse.
        sigmas = 2.0 * math.hypot(repeat, scale * radius) * np.sqrt(np.diagonal(np.linalg.inv(design.T @ design)))
        found += [Bias(sensor, axis, float(solved[k]), float(sigmas[k]), expected) for k, axis in enumerate(("y", "z"))]
    return tuple(found)


# Repeated surveys of a list, and their comparison in words.

# Unit, factor from SI and number of decimals of a bias.
_UNITS = {"accelerometer": ("mG", 1e3 / STANDARD_GRAVITY, 2), "magnetometer": ("nT", 1e9, 0)}


def shots_of(records: Iterable[SurveyRecord], code: str) -> tuple[tuple[CheckShot, tuple[int, ...]], ...]:
    """
    Return the comparisons of surveys that were repeated at one depth, each with the numbers of its surveys.

    code: tool code of the well; for a code without magnetic sensors the default `SensorErrors` are used. Surveys
    without force, field or depth, and surveys with the verdict reject, are left out.
    """
    used = [
        record
        for record in records
        if record.survey.has_readings
        and math.isfinite(record.survey.b_total)
        and math.isfinite(record.measured_depth)
        and record.survey.verdict != Verdict.REJECT
    ]
    if len(used) < 2:
        return ()
    try:
        errors = tool_code.sensor_errors(code)
    except ValueError:
        errors = SensorErrors()
    found = check_shots(
        [record.measured_depth for record in used],
        [record.survey.specific_force for record in used],
        [record.survey.magnetic_field for record in used],
        errors,
        [record.tool for record in used],
    )
    return tuple((shot, tuple(used[k].survey.sequence for k in shot.rows)) for shot in found)


def tools_text(shot: CheckShot) -> str:
    """Return the names of the tools of a check shot; empty for a rotation shot, which has one tool only."""
    return " and ".join(tool or "an unnamed tool" for tool in shot.tools) if len(shot.tools) > 1 else ""


def sentence(shot: CheckShot) -> str:
    """Return a sentence on the comparison of surveys at one depth."""
    kind = "rotation shot"
    if len(shot.tools) > 1:
        kind = f"check shot by {tools_text(shot)}"
    spread, expected = math.degrees(shot.spread_inclination), math.degrees(shot.expected_inclination)
    parts = [f"inclination spread {spread:.3f} deg (expected {expected:.3f})"]
    if math.isfinite(shot.azimuth):
        parts.append(
            f"azimuth {math.degrees(shot.spread_azimuth):.2f} deg (expected {math.degrees(shot.expected_azimuth):.2f})"
        )
    parts += [bias_text(bias) for bias in shot.biases if bias.excessive]
    return f"{shot.md:.1f} m, {kind} of {len(shot.rows)} surveys: {shot.verdict}; " + ", ".join(parts)


def bias_text(bias: Bias) -> str:
    """Return a sentence with a bias, its 1 sigma, and the 1 sigma of the tool code."""
    unit, factor, decimals = _UNITS[bias.sensor]
    value, sigma, expected = (factor * x for x in (bias.value, bias.sigma, bias.expected))
    return (
        f"{bias.sensor} {bias.axis} bias {value:+.{decimals}f} +- {sigma:.{decimals}f} {unit}"
        f" (1 sigma of the tool code {expected:.{decimals}f})"
    )
