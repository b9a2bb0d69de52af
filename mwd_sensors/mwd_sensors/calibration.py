"""
Calibration of a probe from a tumble and temperature run, and its application (S0's temperature compensation).

Model of one triad: reading = inverse(matrix) @ truth + bias + bias_per_c * (temperature - reference temperature).
On a stand of known attitudes the model is linear in its figures. Without a stand, the strength of gravity and of the
field, the dip between them, and the turns between rests are enough, up to one common rotation of the triads.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from mwd_sensors.frames import mat_from_quat, quat_from_rotvec, quat_multiply

Array = NDArray[np.float64]

MIN_POSES = 12


@dataclasses.dataclass(frozen=True)
class TriadCalibration:
    """
    Correction of one triad.

    Attributes
    ----------
    matrix : ndarray, shape (3, 3)
        Corrected = matrix @ (reading - bias - bias_per_c * (temperature - reference_c)).
    bias, bias_per_c : ndarray, shape (3,)
        SI and SI/degC.
    reference_c : float
        degC.
    before, after : float
        Root mean square of the residuals without and with the correction, SI: of the vector on a stand, of the
        strength without one, of gravity's direction (rad) for gyros turned without one.
    poses : int
        Rests (or turns) used.
    """

    matrix: Array
    bias: Array
    bias_per_c: Array
    reference_c: float
    before: float
    after: float
    poses: int

    def __call__(self, reading: ArrayLike, celsius: ArrayLike) -> Array:
        """Corrected vectors, shape (..., 3), of readings (..., 3) at temperatures (...), degC."""
        warm = np.asarray(celsius, dtype=float)[..., None] - self.reference_c
        free = np.asarray(reading, dtype=float) - self.bias - self.bias_per_c * warm
        return np.asarray(np.einsum("ij,...j->...i", self.matrix, free))


@dataclasses.dataclass(frozen=True)
class Calibration:
    """Corrections of a whole unit; a triad that was not measured is None."""

    gyro: TriadCalibration
    accelerometer: TriadCalibration
    magnetometer: TriadCalibration | None


@dataclasses.dataclass(frozen=True)
class Rests:
    """
    Means over intervals at rest.

    Attributes
    ----------
    first, last : ndarray, shape (m,)
        Indices of the first sample and past the last one.
    gyro, accel, mag : ndarray, shape (m, 3)
        rad/s, m/s^2, T; mag is nan where there is none.
    celsius : ndarray, shape (m,)
    """

    first: NDArray[np.int64]
    last: NDArray[np.int64]
    gyro: Array
    accel: Array
    mag: Array
    celsius: Array


def rests(
    gyro: ArrayLike,
    accel: ArrayLike,
    mag: ArrayLike | None,
    celsius: ArrayLike,
    rate: float,
    seconds: float = 2.0,
    quiet_rate: float = 0.02,
    quiet_force: float = 0.15,
) -> Rests:
    """
    Find the intervals at rest of a tumble run.

    Parameters
    ----------
    gyro, accel, mag : array_like, shape (n, 3)
        rad/s, m/s^2, T (or None), at one rate.
    celsius : array_like, shape (n,)
    rate : float
        Hz.
    seconds : float
        Shortest rest.
    quiet_rate, quiet_force : float
        At rest every half second keeps within this of its mean, rad/s and m/s^2.

    Raises
    ------
    ValueError
        Fewer than `MIN_POSES` rests: the run cannot carry a calibration.
    """
    w, f = np.asarray(gyro, dtype=float), np.asarray(accel, dtype=float)
    t = np.asarray(celsius, dtype=float)
    b = np.full_like(f, np.nan) if mag is None else np.asarray(mag, dtype=float)
    window = max(2, round(0.5 * rate))
    count = len(f) // window
    shape = (count, window, 3)
    spans = [np.ptp(x[: count * window].reshape(shape), axis=1).max(axis=1) for x in (w, f)]
    # A steady rotation is quiet too: at rest two windows in a row also agree in their specific force.
    mean_f = f[: count * window].reshape(shape).mean(axis=1)
    drift = np.linalg.norm(np.diff(mean_f, axis=0, prepend=mean_f[:1]), axis=1)
    drift = np.maximum(drift, np.append(drift[1:], 0.0))
    quiet = (spans[0] < quiet_rate) & (spans[1] < quiet_force) & (drift < 0.5 * quiet_force)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], quiet.astype(np.int8), [0]])))
    pairs = [(a * window, z * window) for a, z in edges.reshape(-1, 2) if (z - a) * window >= seconds * rate]
    if len(pairs) < MIN_POSES:
        raise ValueError(
            f"only {len(pairs)} rests of {seconds:g} s were found; a tumble needs at least {MIN_POSES} attitudes"
        )
    means = [np.array([x[a:z].mean(axis=0) for a, z in pairs]) for x in (w, f, b, t)]
    first, last = (np.array(column, dtype=np.int64) for column in zip(*pairs, strict=True))
    return Rests(first, last, means[0], means[1], means[2], means[3])


def fit_stand(reading: ArrayLike, truth: ArrayLike, celsius: ArrayLike) -> TriadCalibration:
    """
    Calibrate on a stand that knows its attitude.

    Parameters
    ----------
    reading, truth : array_like, shape (m, 3)
        Mean readings and true vectors in tool axes, SI.
    celsius : array_like, shape (m,)

    Raises
    ------
    ValueError
        The attitudes do not determine all nine figures.
    """
    y, x, t = (np.asarray(a, dtype=float) for a in (reading, truth, celsius))
    reference, scale = float(t.mean()), float(np.sqrt(np.mean(x**2)))
    columns = [x / scale, np.ones((len(x), 1))]
    varied = np.ptp(t) > 1.0
    if varied:
        columns.append((t - reference)[:, None] / np.ptp(t))
    design = np.concatenate(columns, axis=1)
    if np.linalg.cond(design) > 1e4:
        raise ValueError("truth: these attitudes do not determine scale, misalignment and bias; turn the probe further")
    solution = np.linalg.lstsq(design, y, rcond=None)[0]
    matrix = np.linalg.inv(solution[:3].T / scale)
    per_c = solution[4] / np.ptp(t) if varied else np.zeros(3)
    fitted = TriadCalibration(matrix, solution[3], per_c, reference, 0.0, 0.0, len(y))
    return dataclasses.replace(fitted, before=_rms(y - x), after=_rms(fitted(y, t) - x))


def fit_strength(reading: ArrayLike, strength: float, celsius: ArrayLike) -> TriadCalibration:
    """
    Calibrate from the strength of a field alone (gravity), any attitudes, none of them known.

    reading, shape (m, 3); strength, SI; celsius, shape (m,). The matrix is symmetric: the rotation that strength
    cannot see is left out.

    Raises
    ------
    ValueError
        The attitudes do not determine the figures.
    """
    y, t = np.asarray(reading, dtype=float) / strength, np.asarray(celsius, dtype=float)
    reference, varied = float(t.mean()), bool(np.ptp(t) > 1.0)
    warm = (t - reference) / (np.ptp(t) if varied else 1.0)

    def residual(p: Array) -> Array:
        return np.asarray(np.linalg.norm((y - _biases(p[6:], warm, varied)) @ _symmetric(p[:6]), axis=1) - 1.0)

    start = np.concatenate([[1.0, 1.0, 1.0], np.zeros(9 if varied else 6)])
    found = least_squares(residual, start, x_scale="jac", method="lm")
    _determined(found.jac)
    per_c = found.x[9:12] * strength / np.ptp(t) if varied else np.zeros(3)
    return TriadCalibration(
        matrix=_symmetric(found.x[:6]),
        bias=found.x[6:9] * strength,
        bias_per_c=per_c,
        reference_c=reference,
        before=_rms(np.linalg.norm(y, axis=1) - 1.0) * strength,
        after=_rms(found.fun) * strength,
        poses=len(y),
    )


def fit_magnetometer(
    reading: ArrayLike, f_t: ArrayLike, strength: float, dip: float, celsius: ArrayLike
) -> TriadCalibration:
    """
    Calibrate a magnetometer from the strength of the field and its dip against calibrated accelerometers.

    Parameters
    ----------
    reading, f_t : array_like, shape (m, 3)
        T; corrected specific force, m/s^2: the dip ties the magnetic axes to those of the accelerometers.
    strength, dip : float
        Of the field where the run was made, T and rad.
    celsius : array_like, shape (m,)

    Raises
    ------
    ValueError
        The attitudes do not determine the figures.
    """
    y, t, f = (
        np.asarray(reading, dtype=float) / strength,
        np.asarray(celsius, dtype=float),
        np.asarray(f_t, dtype=float),
    )
    down = -f / np.linalg.norm(f, axis=1, keepdims=True)
    reference, varied = float(t.mean()), bool(np.ptp(t) > 1.0)
    warm = (t - reference) / (np.ptp(t) if varied else 1.0)

    def residual(p: Array) -> Array:
        b = (y - _biases(p[9:], warm, varied)) @ p[:9].reshape(3, 3).T
        return np.concatenate([np.linalg.norm(b, axis=1) - 1.0, np.sum(b * down, axis=1) - np.sin(dip)])

    start = np.concatenate([np.eye(3).ravel(), np.zeros(6 if varied else 3)])
    found = least_squares(residual, start, x_scale="jac", method="lm")
    _determined(found.jac)
    per_c = found.x[12:15] * strength / np.ptp(t) if varied else np.zeros(3)
    return TriadCalibration(
        matrix=found.x[:9].reshape(3, 3),
        bias=found.x[9:12] * strength,
        bias_per_c=per_c,
        reference_c=reference,
        before=_rms(residual(start)) * strength,
        after=_rms(found.fun) * strength,
        poses=len(y),
    )


def fit_gyro(gyro: ArrayLike, at_rest: Rests, accelerometer: TriadCalibration, rate: float) -> TriadCalibration:
    """
    Calibrate gyros: bias and its temperature from the rests, scale and misalignment from the turns between them.

    Parameters
    ----------
    gyro : array_like, shape (n, 3)
        Readings of the whole run, rad/s.
    at_rest : Rests
        Of the same run.
    accelerometer : TriadCalibration
        Tells the direction of gravity in each rest: a turn must carry one into the next.
    rate : float
        Hz.

    Raises
    ------
    ValueError
        The turns do not determine the figures (they must go round all axes).
    """
    w, t = np.asarray(gyro, dtype=float), at_rest.celsius
    reference, varied = float(t.mean()), bool(np.ptp(t) > 1.0)
    design = np.column_stack([np.ones(len(t)), t - reference]) if varied else np.ones((len(t), 1))
    solution = np.linalg.lstsq(design, at_rest.gyro, rcond=None)[0]
    bias, per_c = solution[0], solution[1] if varied else np.zeros(3)
    f = accelerometer(at_rest.accel, t)
    down = -f / np.linalg.norm(f, axis=1, keepdims=True)
    turns = []
    for k in range(len(t) - 1):
        a, z = int(at_rest.last[k]) - round(0.5 * rate), int(at_rest.first[k + 1]) + round(0.5 * rate)
        warm = 0.5 * (t[k] + t[k + 1]) - reference
        turns.append((w[a:z] - bias - per_c * warm) / rate)
    # Turns of all pairs of rests run side by side; short ones are filled up with zeros, which do not turn.
    longest = max(len(turn) for turn in turns)
    steps = np.zeros((longest, len(turns), 3))
    for k, turn in enumerate(turns):
        steps[: len(turn), k] = turn

    def residual(p: Array) -> Array:
        return np.asarray((_carried(steps @ p.reshape(3, 3).T, down[:-1]) - down[1:]).ravel())

    start = np.eye(3).ravel()
    found = least_squares(residual, start, x_scale="jac", method="lm")
    _determined(found.jac)
    return TriadCalibration(
        matrix=found.x.reshape(3, 3),
        bias=bias,
        bias_per_c=per_c,
        reference_c=reference,
        before=float(np.sqrt(np.mean(residual(start) ** 2) * 3.0)),
        after=float(np.sqrt(np.mean(found.fun**2) * 3.0)),
        poses=len(turns),
    )


def calibrate(
    gyro: ArrayLike,
    accel: ArrayLike,
    mag: ArrayLike | None,
    celsius: ArrayLike,
    rate: float,
    gravity: float,
    field: tuple[float, float] | None,
) -> Calibration:
    """
    Calibrate a unit from one tumble run, without a stand.

    Parameters
    ----------
    gyro, accel, mag : array_like, shape (n, 3)
        Readings, rad/s, m/s^2, T (or None).
    celsius : array_like, shape (n,)
        Temperature at each sample.
    rate : float
        Hz.
    gravity : float
        m/s^2.
    field : (float, float) or None
        Strength, T, and dip, rad, of the field where the run was made; needed for magnetometers.

    Raises
    ------
    ValueError
        Too few rests, or attitudes that do not determine the figures.
    """
    found = rests(gyro, accel, mag, celsius, rate)
    accelerometer = fit_strength(found.accel, gravity, found.celsius)
    magnetometer = None
    if mag is not None and field is not None:
        f_t = accelerometer(found.accel, found.celsius)
        magnetometer = fit_magnetometer(found.mag, f_t, field[0], field[1], found.celsius)
    return Calibration(fit_gyro(gyro, found, accelerometer, rate), accelerometer, magnetometer)


def as_table(calibration: Calibration) -> dict[str, Any]:
    """A calibration as plain numbers, for YAML or JSON; `from_table` reads it back exactly."""
    triads = {field.name: getattr(calibration, field.name) for field in dataclasses.fields(calibration)}
    return {
        name: {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in vars(triad).items()}
        for name, triad in triads.items()
        if triad is not None
    }


def from_table(table: Mapping[str, Any]) -> Calibration:
    """
    Calibration of a table as `as_table` makes it.

    Raises
    ------
    ValueError
        A missing triad or figure, a wrong shape, a number that is not finite, or a matrix far from the identity.
    """
    read: dict[str, TriadCalibration] = {}
    for name, triad in table.items():
        if name not in _TRIADS:
            raise ValueError(f"calibration: no triad {name!r}; known: {', '.join(_TRIADS)}")
        figures = {}
        for key, shape in _SHAPES.items():
            try:
                figures[key] = np.array(triad[key], dtype=float)
            except (KeyError, TypeError, ValueError) as error:
                raise ValueError(f"calibration: {name}.{key} is missing or not a number") from error
            if figures[key].shape != shape or not np.isfinite(figures[key]).all():
                raise ValueError(f"calibration: {name}.{key} must be finite and of shape {shape}")
        if np.abs(figures["matrix"] - np.eye(3)).max() > 0.5:
            raise ValueError(f"calibration: {name}.matrix is far from the identity; is it in other units?")
        read[name] = TriadCalibration(
            matrix=figures["matrix"],
            bias=figures["bias"],
            bias_per_c=figures["bias_per_c"],
            reference_c=float(figures["reference_c"]),
            before=float(figures["before"]),
            after=float(figures["after"]),
            poses=int(figures["poses"]),
        )
    for name in ("gyro", "accelerometer"):
        if name not in read:
            raise ValueError(f"calibration: {name} is missing")
    return Calibration(read["gyro"], read["accelerometer"], read.get("magnetometer"))


_TRIADS = ("gyro", "accelerometer", "magnetometer")
_SHAPES: dict[str, tuple[int, ...]] = {
    "matrix": (3, 3),
    "bias": (3,),
    "bias_per_c": (3,),
    "reference_c": (),
    "before": (),
    "after": (),
    "poses": (),
}


def _carried(steps: Array, down: Array) -> Array:
    """Gravity's direction (k, 3) in tool axes after the rotation vectors steps (n, k, 3)."""
    # Halved pairwise: rotations are joined as a tree, so that a long turn takes few array operations.
    q = quat_from_rotvec(steps)
    while len(q) > 1:
        odd = q[-1:] if len(q) % 2 else q[:0]
        q = np.concatenate([quat_multiply(q[0 : len(q) - len(odd) : 2], q[1 : len(q) : 2]), odd])
    # Tool to level grows by right factors: the direction turns back by the whole.
    return np.asarray(np.einsum("kji,kj->ki", mat_from_quat(q[0]), down))


def _symmetric(p: Array) -> Array:
    return np.array([[p[0], p[3], p[4]], [p[3], p[1], p[5]], [p[4], p[5], p[2]]])


def _biases(p: Array, warm: Array, varied: bool) -> Array:
    return p[:3] + warm[:, None] * p[3:6] if varied else np.broadcast_to(p[:3], (len(warm), 3))


def _determined(jacobian: Array) -> None:
    scaled = jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    if np.linalg.cond(scaled) > 1e5:
        raise ValueError("these attitudes do not determine scale, misalignment and bias; turn the probe further")


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(np.atleast_2d(x.T).T ** 2, axis=-1))))
