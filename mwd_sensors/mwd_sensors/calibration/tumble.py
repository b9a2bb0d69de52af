"""
Calibration of a probe from a tumble and temperature run, and its application (S0's temperature compensation).

Model of one triad, with warm = temperature - reference temperature:
reading = (1 + scale_per_c * warm) * (inverse(matrix) @ truth) + bias + bias_per_c * warm.
On a stand of known attitudes the model is linear in its figures. Without a stand, the strength of gravity and of the
field, the dip between them, and the turns between rests are enough, up to one common rotation of the triads. Every
figure comes with its 1 sigma, from the scatter of the residuals.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import mat_from_quat, quat_from_rotvec, quat_multiply

MIN_POSES = 12


@dataclasses.dataclass(frozen=True)
class TriadCalibration:
    """
    Correction of one triad.

    Attributes
    ----------
    matrix : ndarray, shape (3, 3)
        Corrected = matrix @ ((reading - bias - bias_per_c * warm) / (1 + scale_per_c * warm)), where warm is the
        temperature above reference_c.
    bias, bias_per_c : ndarray, shape (3,)
        SI and SI/degC.
    scale_per_c : ndarray, shape (3,)
        1/degC; like bias_per_c zero where the run was made at one temperature.
    sigma_matrix, sigma_bias, sigma_bias_per_c, sigma_scale_per_c : ndarray
        1 sigma of each figure, as the scatter of the residuals says it.
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
    scale_per_c: Array
    sigma_matrix: Array
    sigma_bias: Array
    sigma_bias_per_c: Array
    sigma_scale_per_c: Array
    reference_c: float
    before: float
    after: float
    poses: int

    def __call__(self, reading: ArrayLike, celsius: ArrayLike) -> Array:
        """Corrected vectors, shape (..., 3), of readings (..., 3) at temperatures (...), degC."""
        warm = np.asarray(celsius, dtype=float)[..., None] - self.reference_c
        free = np.asarray(reading, dtype=float) - self.bias - self.bias_per_c * warm
        return np.asarray(np.einsum("ij,...j->...i", self.matrix, free / (1.0 + self.scale_per_c * warm)))


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
    strength = float(np.sqrt(np.mean(x**2)))
    heat = _Heat.of(t)
    solutions, sigmas = [], []
    for axis in range(3):
        columns = [x / strength, np.ones((len(x), 1))]
        if heat.varied:
            columns += [heat.warm[:, None], (heat.warm * x[:, axis] / strength)[:, None]]
        design = np.concatenate(columns, axis=1)
        if np.linalg.cond(design) > 1e4:
            raise ValueError(f"truth: {_POOR}")
        solution = np.linalg.lstsq(design, y[:, axis] / strength, rcond=None)[0]
        solutions.append(solution)
        sigmas.append(_sigmas(design, design @ solution - y[:, axis] / strength))
    p, sigma = np.array(solutions), np.array(sigmas)
    scale, gain = strength / heat.span, 1.0 / heat.span
    per_c, gain_per_c = (p[:, 4] * scale, p[:, 5] / p[:, :3].diagonal() * gain) if heat.varied else _NOTHING
    fitted = TriadCalibration(
        matrix=np.linalg.inv(p[:, :3]),
        bias=p[:, 3] * strength,
        bias_per_c=per_c,
        scale_per_c=gain_per_c,
        sigma_matrix=sigma[:, :3],
        sigma_bias=sigma[:, 3] * strength,
        sigma_bias_per_c=sigma[:, 4] * scale if heat.varied else np.zeros(3),
        sigma_scale_per_c=sigma[:, 5] * gain if heat.varied else np.zeros(3),
        reference_c=heat.reference_c,
        before=_rms(y - x),
        after=0.0,
        poses=len(y),
    )
    return dataclasses.replace(fitted, after=_rms(fitted(y, t) - x))


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
    y, heat = np.asarray(reading, dtype=float) / strength, _Heat.of(np.asarray(celsius, dtype=float))

    def residual(p: Array) -> Array:
        return np.asarray(np.linalg.norm(heat.freed(y, p[6:]) @ _symmetric(p[:6]), axis=1) - 1.0)

    start = np.concatenate([[1.0, 1.0, 1.0], np.zeros(3 + heat.figures)])
    found = least_squares(residual, start, x_scale="jac", method="lm")
    _determined(found.jac)
    sigma = _sigmas(found.jac, found.fun)
    return TriadCalibration(
        matrix=_symmetric(found.x[:6]),
        sigma_matrix=_symmetric(sigma[:6]),
        **heat.named(found.x[6:], sigma[6:], strength, _rms(found.fun)),
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
    y, f = np.asarray(reading, dtype=float) / strength, np.asarray(f_t, dtype=float)
    down = -f / np.linalg.norm(f, axis=1, keepdims=True)
    heat = _Heat.of(np.asarray(celsius, dtype=float))

    def residual(p: Array) -> Array:
        b = heat.freed(y, p[9:]) @ p[:9].reshape(3, 3).T
        return np.concatenate([np.linalg.norm(b, axis=1) - 1.0, np.sum(b * down, axis=1) - np.sin(dip)])

    start = np.concatenate([np.eye(3).ravel(), np.zeros(heat.figures)])
    found = least_squares(residual, start, x_scale="jac", method="lm")
    _determined(found.jac)
    sigma = _sigmas(found.jac, found.fun, 2)
    return TriadCalibration(
        matrix=found.x[:9].reshape(3, 3),
        sigma_matrix=sigma[:9].reshape(3, 3),
        **heat.named(found.x[9:], sigma[9:], strength, _rms(found.fun)),
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
    heat = _Heat.of(t)
    design = np.column_stack([np.ones(len(t)), heat.warm]) if heat.varied else np.ones((len(t), 1))
    solution = np.linalg.lstsq(design, at_rest.gyro, rcond=None)[0]
    left = design @ solution - at_rest.gyro
    scatter = np.array([_sigmas(design, column) for column in left.T])
    per_span = scatter[:, 1] / heat.span if heat.varied else np.zeros(3)
    sigma_bias, sigma_per_c = _with_drift(scatter[:, 0], per_span, np.sqrt(np.mean(left**2, axis=0)), heat.span)
    bias, per_c = solution[0], solution[1] / heat.span if heat.varied else np.zeros(3)
    f = accelerometer(at_rest.accel, t)
    down = -f / np.linalg.norm(f, axis=1, keepdims=True)
    turns = []
    between = 0.5 * (t[:-1] + t[1:]) - heat.reference_c
    for k in range(len(t) - 1):
        a, z = int(at_rest.last[k]) - round(0.5 * rate), int(at_rest.first[k + 1]) + round(0.5 * rate)
        turns.append((w[a:z] - bias - per_c * between[k]) / rate)
    # Turns of all pairs of rests run side by side; short ones are filled up with zeros, which do not turn.
    longest = max(len(turn) for turn in turns)
    steps = np.zeros((longest, len(turns), 3))
    for k, turn in enumerate(turns):
        steps[: len(turn), k] = turn

    def residual(p: Array) -> Array:
        gain = 1.0 + p[9:] * (between / heat.span)[:, None] if heat.varied else 1.0
        return np.asarray((_carried(steps / gain @ p[:9].reshape(3, 3).T, down[:-1]) - down[1:]).ravel())

    start = np.concatenate([np.eye(3).ravel(), np.zeros(3 if heat.varied else 0)])
    found = least_squares(residual, start, x_scale="jac", method="lm")
    _determined(found.jac)
    sigma = _sigmas(found.jac, found.fun, 3, interleaved=True)
    return TriadCalibration(
        matrix=found.x[:9].reshape(3, 3),
        bias=bias,
        bias_per_c=per_c,
        scale_per_c=found.x[9:] / heat.span if heat.varied else np.zeros(3),
        sigma_matrix=sigma[:9].reshape(3, 3),
        sigma_bias=sigma_bias,
        sigma_bias_per_c=sigma_per_c if heat.varied else np.zeros(3),
        sigma_scale_per_c=sigma[9:] / heat.span if heat.varied else np.zeros(3),
        reference_c=heat.reference_c,
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
            scale_per_c=figures["scale_per_c"],
            sigma_matrix=figures["sigma_matrix"],
            sigma_bias=figures["sigma_bias"],
            sigma_bias_per_c=figures["sigma_bias_per_c"],
            sigma_scale_per_c=figures["sigma_scale_per_c"],
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
    "scale_per_c": (3,),
    "sigma_matrix": (3, 3),
    "sigma_bias": (3,),
    "sigma_bias_per_c": (3,),
    "sigma_scale_per_c": (3,),
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


@dataclasses.dataclass(frozen=True)
class _Heat:
    """Temperature of a run: warm, shape (m,), runs over one unit, so that all figures of a fit are of one size."""

    reference_c: float
    span: float
    warm: Array
    varied: bool

    @classmethod
    def of(cls, celsius: Array) -> _Heat:
        reference, varied = float(celsius.mean()), bool(np.ptp(celsius) > 1.0)
        span = float(np.ptp(celsius)) if varied else 1.0
        return cls(reference, span, (celsius - reference) / span, varied)

    @property
    def figures(self) -> int:
        """Bias, and with it over temperature: bias and scale."""
        return 9 if self.varied else 3

    def freed(self, y: Array, p: Array) -> Array:
        """Readings without the errors p: bias, and over the run's span bias and scale."""
        if not self.varied:
            return np.asarray(y - p[:3])
        warm = self.warm[:, None]
        return np.asarray((y - p[:3] - warm * p[3:6]) / (1.0 + warm * p[6:9]))

    def named(self, p: Array, sigma: Array, strength: float, scatter: float) -> dict[str, Any]:
        """Figures of p and their sigmas under their names, SI; scatter: rms of the residuals over the strength."""
        none = np.zeros(3)
        per_c, gain = strength / self.span, 1.0 / self.span
        bias, bias_per_c = _with_drift(sigma[:3], sigma[3:6] if self.varied else none, scatter, 1.0)
        return {
            "reference_c": self.reference_c,
            "bias": p[:3] * strength,
            "sigma_bias": bias * strength,
            "bias_per_c": p[3:6] * per_c if self.varied else none,
            "sigma_bias_per_c": bias_per_c * per_c if self.varied else none,
            "scale_per_c": p[6:9] * gain if self.varied else none,
            "sigma_scale_per_c": sigma[6:9] * gain if self.varied else none,
        }


_NOTHING = np.zeros(3), np.zeros(3)
_POOR = "these attitudes do not determine scale, misalignment and bias; turn the probe further"


def _sigmas(jacobian: Array, residual: Array, parts: int = 1, interleaved: bool = False) -> Array:
    """
    1 sigma of the figures of a least-squares fit, from the scatter of its residuals.

    parts residuals belong to each rest: one after the other (interleaved), or all firsts before all seconds. A slow
    drift of the sensor leaves residuals that resemble their neighbours, and fewer of them count: the larger of the
    ordinary sigma and of that by Newey and West (Econometrica 55, 1987) with a fifth of the rests as its reach.
    """
    size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    scaled = jacobian / size
    inverse = np.linalg.inv(scaled.T @ scaled)
    rows, figures = scaled.shape
    spare = max(rows - figures, 1)
    ordinary = inverse.diagonal() * float(residual @ residual) / spare
    scores = scaled * residual[:, None]
    count = rows // parts
    scores = (
        scores.reshape(count, parts, -1).sum(axis=1) if interleaved else scores.reshape(parts, count, -1).sum(axis=0)
    )
    reach = count // 5
    spread = scores.T @ scores
    for lag in range(1, reach + 1):
        product = scores[lag:].T @ scores[:-lag]
        spread = spread + (1.0 - lag / (reach + 1.0)) * (product + product.T)
    robust = (inverse @ spread @ inverse).diagonal() * rows / spare
    return np.asarray(np.sqrt(np.maximum(ordinary, robust)) / size)


def _with_drift(sigma_bias: Array, sigma_bias_per_c: Array, scatter: Array | float, span: float) -> tuple[Array, Array]:
    """
    The same sigmas with an allowance for drift: half the scatter of the residuals in the bias, twice it over the span.

    A sensor that drifts while the temperature happens to rise cannot be told from one that feels the temperature.
    """
    return np.hypot(sigma_bias, 0.5 * scatter), np.hypot(sigma_bias_per_c, 2.0 * scatter / span)


def _determined(jacobian: Array) -> None:
    scaled = jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    if np.linalg.cond(scaled) > 1e5:
        raise ValueError(_POOR)


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(np.atleast_2d(x.T).T ** 2, axis=-1))))
