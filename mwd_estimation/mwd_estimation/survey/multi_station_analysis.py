"""
Multi-station analysis: what is wrong with the sensors and the steel around them, from many stations of one run.

The Earth's field and gravity look the same at every station: total gravity, horizontal and downward field. What moves
them from station to station as the tool turns and the hole bends are the tool's own errors, which stay with its axes:
bias and scale of each magnetometer, axial interference being the bias of the axial one, and of each accelerometer.
They are estimated together with what is wrong with the reference itself, each with a prior from the tool code, by
nonlinear least squares:

    b = B-true + bias + scale b,   f = F-true + bias + scale f
    residual = (|f|, H, V)(f - ..., b - ...) - reference - error of the reference

Where a gyro has given azimuths too, they show what the field's size and dip cannot: axial interference in a hole that
stays horizontal and east-west.

An error the run's attitudes do not show keeps its prior sigma; it is named, and the azimuth's sigma carries it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares
from scipy.stats import chi2

from mwd_estimation.core import magnetic_geometry
from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.azimuth_selection import RAW
from mwd_estimation.survey.station import Station, StationSettings, station
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.frames import gravity_toolface, inclination, wrap_pi
from mwd_sensors.core.settings import setting

MSA = "msa"
NAMES = (
    "axial interference and bias",
    "cross-axial bias y",
    "cross-axial bias z",
    "magnetometer scale x",
    "magnetometer scale y",
    "magnetometer scale z",
    "accelerometer bias x",
    "accelerometer bias y",
    "accelerometer bias z",
    "accelerometer scale x",
    "accelerometer scale y",
    "accelerometer scale z",
    "reference horizontal field",
    "reference downward field",
    "reference gravity",
)
_SENSORS = 12
# Gravity where no reference gives it, 1 sigma from pole to equator, m/s^2.
_GRAVITY_RANGE = 0.02
# Stations from which on their scatter is worth an estimate.
_MANY = 8
# Axial interference of a tool that is freed of it, expected and imaginable, nT.
_NONE_NT = 1.0


@dataclass(frozen=True)
class MultistationSettings:
    """Priors beyond the tool code, noise of a station, and when to refuse."""

    axial_interference_nt: float = setting(
        2000.0, "Axial interference thought possible, 1 sigma", unit="nT", low=1.0, high=100000.0
    )
    cross_axial_bias_nt: float = setting(
        150.0, "Cross-axial bias thought possible, 1 sigma: a hot spot in the collar beside the sensors' own",
        unit="nT", low=1.0, high=100000.0,
    )  # fmt: skip
    magnetometer_noise_nt: float = setting(20.0, "Noise of a station's mean field, each axis", unit="nT", low=0.1)
    accelerometer_noise_mps2: float = setting(
        0.002, "Noise of a station's mean specific force, each axis", unit="m/s^2", low=1e-6
    )
    adapt_noise: bool = setting(True, "Take less noise than set where the residuals show less (eight stations or more)")
    field_variation_nt: float = setting(
        60.0, "What the field strength itself varies from station to station (MFIR)", unit="nT", low=0.0
    )
    dip_variation_deg: float = setting(
        0.08, "What the dip itself varies from station to station (MDIR)", unit="deg", low=0.0
    )
    outlier_sigma: float = setting(4.5, "A station whose misfit is beyond this many sigma is left out", low=2.0)
    max_outliers: float = setting(
        0.25, "More than this share of stations left out, and the analysis is refused", low=0.0, high=0.9
    )
    observable: float = setting(
        0.7,
        "An error whose sigma does not fall below this share of its prior is called not observable",
        low=0.05,
        high=1.0,
    )
    min_probability: float = setting(0.001, "Refused where chi-square is less probable than this", low=0.0, high=0.5)
    max_sigma_deg: float = setting(
        1.5, "Refused where the azimuth's median sigma stays above this", unit="deg", low=0.01, high=90.0
    )


@dataclass(frozen=True)
class GyroAzimuths:
    """
    Azimuths of a gyro at the stations of a run, from magnetic north.

    Attributes
    ----------
    azimuth, sigma : ndarray, shape (n,)
        rad; nan where the gyro gave none. Sigma is what errs at each station anew.
    common : float or ndarray, shape (n,)
        1 sigma of what errs alike at all of them, rad: the gyro's sensitivity to gravity, the declination.
    """

    azimuth: Array
    sigma: Array
    common: float | Array = 0.0


@dataclass(frozen=True)
class Multistation:
    """
    What the stations of a run say together.

    Attributes
    ----------
    estimate, sigma, prior : ndarray, shape (15,)
        The errors in the order of `NAMES` (T, plain, m/s^2, plain, T, T, m/s^2), their 1 sigma after and before.
    covariance : ndarray, shape (15, 15)
    azimuth, sigma_azimuth, inclination, sigma_inclination, toolface : ndarray, shape (n,)
        Corrected, magnetic, rad. Sigmas hold noise and what is left of the errors; declination and alignment come on
        top.
    azimuth_raw, sigma_raw : ndarray, shape (n,)
        Uncorrected, and with the prior's sigma.
    by_gyro : ndarray, shape (n,)
        How far the corrected azimuth follows a turn of all the gyro's azimuths together: 0 not at all, 1 wholly.
    used : ndarray of bool, shape (n,)
        False for stations left out as outliers; they are corrected all the same.
    chi_square, degrees, probability : float, int, float
        Of the used stations' residuals and the priors together.
    observable : ndarray of bool, shape (15,)
        Whether the run's attitudes show an error.
    readings_covariance : ndarray, shape (n, 6, 6)
        Of the corrected (f, b) of each station: noise and what is left of the errors.
    refused : str
        Why the corrected azimuths must not be used; empty where they may.
    remarks : tuple of str
        What could not be seen, what was left out.
    """

    estimate: Array
    sigma: Array
    prior: Array
    covariance: Array
    azimuth: Array
    sigma_azimuth: Array
    inclination: Array
    sigma_inclination: Array
    toolface: Array
    azimuth_raw: Array
    sigma_raw: Array
    by_gyro: Array
    used: np.ndarray
    chi_square: float
    degrees: int
    probability: float
    observable: np.ndarray
    readings_covariance: Array
    refused: str
    remarks: tuple[str, ...]

    def corrected(self, f_t: ArrayLike, b_t: ArrayLike) -> tuple[Array, Array]:
        """Specific force, m/s^2, and field, T, shape (..., 3), with the estimated errors taken off."""
        return _corrected(np.asarray(f_t, dtype=float), np.asarray(b_t, dtype=float), self.estimate)


def analyse(
    f_t: ArrayLike,
    b_t: ArrayLike,
    reference: Reference,
    errors: SensorErrors | None = None,
    settings: MultistationSettings | None = None,
    gyro: GyroAzimuths | None = None,
) -> Multistation:
    """
    Estimate the errors common to the stations of one run, and their azimuths without them.

    Parameters
    ----------
    f_t, b_t : array_like, shape (n, 3)
        Mean specific force, m/s^2, and field, T, in tool axes, of n >= 2 stations with the same tool and assembly.
    reference : Reference
        With a field; its sigmas are the prior of its own error, common to all stations.
    errors : SensorErrors, optional
        Priors of bias and scale, such as `toolcode.sensor_errors(code)`.
    settings : MultistationSettings, optional
    gyro : GyroAzimuths, optional
        Where given, the corrected azimuths hold what the gyro knows: do not weigh it in again.

    Returns
    -------
    Multistation

    Raises
    ------
    ValueError
        Shapes, fewer than two stations, readings that are not finite, a reference without field.
    """
    errors = SensorErrors() if errors is None else errors
    settings = MultistationSettings() if settings is None else settings
    f, b = np.asarray(f_t, dtype=float), np.asarray(b_t, dtype=float)
    if f.ndim != 2 or f.shape[1] != 3 or f.shape != b.shape:
        raise ValueError(f"f_t and b_t: expected the same shape (n, 3), got {f.shape} and {b.shape}")
    if len(f) < 2:
        raise ValueError(f"f_t: a multi-station analysis needs two stations or more, got {len(f)}")
    if not (np.isfinite(f).all() and np.isfinite(b).all()):
        raise ValueError("f_t and b_t: every reading must be finite; leave incomplete stations out")
    if not reference.has_field:
        raise ValueError("reference: a multi-station analysis needs the strength and dip of the field")
    if gyro is not None and (np.shape(gyro.azimuth) != (len(f),) or np.shape(gyro.sigma) != (len(f),)):
        raise ValueError(f"gyro: expected an azimuth and a sigma for each of {len(f)} stations, nan where none")
    problem = _Problem(f, b, reference, errors, settings, gyro)

    used = np.ones(len(f), dtype=bool)
    while True:
        solution = problem.solve(used)
        misfit = problem.misfit(solution)
        worst = int(np.argmax(np.where(used, misfit, 0.0)))
        if misfit[worst] <= settings.outlier_sigma or used.sum() <= max(3, (1.0 - settings.max_outliers) * len(f)):
            break
        used[worst] = False
    degrees = int(3 * used.sum()) + problem.compared(used)
    chi_square = float(np.sum(problem.residual(solution, used) ** 2))
    probability = float(chi2.sf(chi_square, degrees))
    # Few stations tell nothing of the noise.
    if settings.adapt_noise and used.sum() >= _MANY:
        for _ in range(2):
            problem.quieten(solution, used)
            solution = problem.solve(used)
    slope = problem.slope(solution, used)
    covariance_x = np.asarray(np.linalg.inv(slope.T @ slope), dtype=float)
    estimate = problem.scale @ solution
    covariance = problem.scale @ covariance_x @ problem.scale.T
    prior = np.sqrt(np.diagonal(problem.scale @ problem.scale.T))
    sigma = np.sqrt(np.diagonal(covariance))
    f_c, b_c = _corrected(f, b, estimate)
    jacobian = magnetic_geometry.angle_jacobian(f_c, b_c)
    spread = problem.reading_covariance(solution, covariance, used)
    angles = jacobian @ spread @ np.swapaxes(jacobian, 1, 2)
    before = problem.reading_covariance(np.zeros(15), problem.scale @ problem.scale.T, np.zeros(len(f), dtype=bool))
    jacobian_raw = magnetic_geometry.angle_jacobian(f, b)
    raw = jacobian_raw @ before @ np.swapaxes(jacobian_raw, 1, 2)
    sigma_azimuth = np.minimum(np.sqrt(angles[:, 1, 1]), np.pi)
    sigma_raw = np.minimum(np.sqrt(raw[:, 1, 1]), np.pi)
    observable = sigma / prior < settings.observable
    return Multistation(
        estimate=estimate,
        sigma=sigma,
        prior=prior,
        covariance=covariance,
        azimuth=magnetic_geometry.raw_azimuth(f_c, b_c),
        sigma_azimuth=sigma_azimuth,
        inclination=inclination(f_c),
        sigma_inclination=np.sqrt(angles[:, 0, 0]),
        toolface=gravity_toolface(f_c),
        azimuth_raw=magnetic_geometry.raw_azimuth(f, b),
        sigma_raw=sigma_raw,
        by_gyro=np.einsum("ni,ni->n", jacobian[:, 1], problem.by_gyro(solution, covariance_x, used)),
        used=used,
        chi_square=chi_square,
        degrees=degrees,
        probability=probability,
        observable=observable,
        readings_covariance=spread,
        refused=_refusal(settings, used, probability, chi_square, degrees, sigma_azimuth, sigma_raw, misfit),
        remarks=_remarks(used, observable),
    )


def corrected_station(old: Station, k: int, analysis: Multistation, settings: StationSettings | None = None) -> Station:
    """
    A station again, from its corrected readings, with the method "msa" added and, unless refused, chosen.

    Parameters
    ----------
    old : Station
        As `station` made it.
    k : int
        Its place among those analysed.
    analysis : Multistation
    settings : StationSettings, optional
        Those the station was made with; alignment, north and limits are kept, the sensors' errors come from the
        analysis.

    Returns
    -------
    Station
        Where the analysis was refused, or the station left out of it, the station as it was, with "msa" refused.
    """
    settings = StationSettings() if settings is None else settings
    aligned = replace(
        settings.errors,
        accelerometer_bias_mps2=0.0,
        accelerometer_scale=0.0,
        magnetometer_bias_nt=0.0,
        magnetometer_scale=0.0,
        axial_interference_nt=_NONE_NT,
    )
    # What is left of the interference is in the readings' covariance.
    settings = replace(settings, errors=aligned, azimuth_method=RAW, plausible_interference_nt=_NONE_NT)
    f_t, b_t = analysis.corrected(old.f_t, old.b_t)
    covariance = analysis.readings_covariance[k]
    new = station(f_t, b_t, old.reference, settings, covariance_f=covariance[:3, :3], covariance_b=covariance[3:, 3:])
    refused = analysis.refused or ("" if analysis.used[k] else "left out of the analysis as an outlier")
    method = replace(new.azimuths[0], method=MSA, refused=refused)
    if refused:
        return replace(old, azimuths=(*old.azimuths, method))
    text = (
        f"corrected by {int(analysis.used.sum())} stations: axial {analysis.estimate[0] * 1e9:+.0f} +- "
        f"{analysis.sigma[0] * 1e9:.0f} nT"
    )
    return replace(
        new,
        method=MSA,
        corrected=True,
        azimuths=(*old.azimuths, method),
        interference=float(analysis.estimate[0]),
        sigma_interference=float(analysis.sigma[0]),
        interference_chi_square=math.nan,
        g_total=old.g_total,
        b_total=old.b_total,
        dip=old.dip,
        f_t=old.f_t,
        b_t=old.b_t,
        reasons=(*new.reasons, text),
    )


class _Problem:
    """Residuals of the stations against one reference, whitened, with the priors beneath them."""

    def __init__(
        self,
        f: Array,
        b: Array,
        reference: Reference,
        errors: SensorErrors,
        settings: MultistationSettings,
        gyro: GyroAzimuths | None = None,
    ) -> None:
        self.f, self.b, self.gyro = f, b, gyro
        gravity = STANDARD_GRAVITY if reference.gravity is None else reference.gravity
        self.reference = np.array([gravity, reference.horizontal, reference.vertical])
        bias = errors.magnetometer_bias_nt
        magnetometer = [
            math.hypot(bias, settings.axial_interference_nt) * 1e-9,
            math.hypot(bias, settings.cross_axial_bias_nt) * 1e-9,
            math.hypot(bias, settings.cross_axial_bias_nt) * 1e-9,
            *([max(errors.magnetometer_scale, 1e-7)] * 3),
        ]
        accelerometer = [max(errors.accelerometer_bias_mps2, 1e-7)] * 3 + [max(errors.accelerometer_scale, 1e-8)] * 3
        # Errors = scale @ x, with x of unit prior.
        self.scale = np.zeros((15, 15))
        self.scale[range(_SENSORS), range(_SENSORS)] = magnetometer + accelerometer
        self.scale[12:14, 12:14] = np.linalg.cholesky(reference.covariance + np.eye(2) * 1e-22)
        self.scale[14, 14] = _GRAVITY_RANGE if reference.gravity is None else max(reference.sigma_gravity, 1e-7)
        self.noise = np.diag(
            [settings.accelerometer_noise_mps2**2] * 3 + [(settings.magnetometer_noise_nt * 1e-9) ** 2] * 3
        )
        total, dip = float(np.hypot(*self.reference[1:])), math.atan2(self.reference[2], self.reference[1])
        turn = np.array([[math.cos(dip), -total * math.sin(dip)], [math.sin(dip), total * math.cos(dip)]])
        varying = np.diag([settings.field_variation_nt * 1e-9, math.radians(settings.dip_variation_deg)]) ** 2
        self.varying = turn @ varying @ turn.T
        self._weigh()

    def _weigh(self) -> None:
        # The weights stay those of the readings as they are: the noise hardly depends on the small errors sought.
        _, inputs = self._values(np.zeros(15))
        covariance = inputs @ self.noise @ np.swapaxes(inputs, 1, 2)
        covariance[:, 1:, 1:] += self.varying
        self.white = np.linalg.inv(np.linalg.cholesky(covariance))

    def quieten(self, x: Array, used: np.ndarray) -> None:
        """
        Scale the noise down to what the residuals show, accelerometers and field apart; never up.

        More scatter than expected is a reason to refuse, not to widen; less means better sensors than the settings say.
        """
        slope = self._whitened_slope(x)[used]
        residual = self._whitened(x)[used]
        every = slope.reshape(-1, 15)
        covariance = np.linalg.inv(every.T @ every + np.eye(15))
        leverage = np.einsum("nki,ij,nkj->nk", slope, covariance, slope)

        def share(columns: slice) -> float:
            freedom = max(float(np.sum(1.0 - leverage[:, columns])), 1.0)
            return min(max(float(np.sum(residual[:, columns] ** 2)) / freedom, 1e-4), 1.0)

        gravity, field = share(slice(0, 1)), share(slice(1, 3))
        # The residuals cannot tell magnetometer noise from a varying field: the noise, which the azimuth feels, stays
        # as it is set while what is seen allows it, and the variation gives way first.
        _, inputs = self._values(np.zeros(15))
        by_noise = float(np.mean(np.einsum("nki,ij,nkj->nk", inputs[:, 1:], self.noise, inputs[:, 1:])))
        by_variation = 0.5 * float(np.trace(self.varying))
        seen = field * (by_noise + by_variation)
        self.noise = self.noise * np.repeat([gravity, min(seen / by_noise, 1.0)], 3)[:, None]
        self.varying = self.varying * max((seen - by_noise) / max(by_variation, 1e-30), 0.0)
        self._weigh()

    def _values(self, errors: Array) -> tuple[Array, Array]:
        """(|f|, H, V) of the corrected readings, shape (n, 3), and their slopes by (f, b), shape (n, 3, 6)."""
        f, b = _corrected(self.f, self.b, errors)
        g = np.linalg.norm(f, axis=1, keepdims=True)
        down = -f / g
        vertical = np.sum(b * down, axis=1, keepdims=True)
        level = b - vertical * down
        horizontal = np.linalg.norm(level, axis=1, keepdims=True)
        north = level / horizontal
        slope = np.zeros((len(f), 3, 6))
        slope[:, 0, :3] = -down
        slope[:, 1, :3], slope[:, 1, 3:] = vertical * north / g, north
        slope[:, 2, :3], slope[:, 2, 3:] = -horizontal * north / g, down
        return np.concatenate([g, horizontal, vertical], axis=1), slope

    def _by_errors(self) -> Array:
        """Slopes of the corrected (f, b) by the twelve sensor errors, shape (n, 6, 12)."""
        slope = np.zeros((len(self.f), 6, _SENSORS))
        for axis in range(3):
            slope[:, 3 + axis, axis] = -1.0
            slope[:, 3 + axis, 3 + axis] = -self.b[:, axis]
            slope[:, axis, 6 + axis] = -1.0
            slope[:, axis, 9 + axis] = -self.f[:, axis]
        return slope

    def solve(self, used: np.ndarray) -> Array:
        """Most probable normalised errors, shape (15,), from the used stations and the priors."""
        found = least_squares(self.residual, np.zeros(15), self.slope, args=(used,), method="lm")
        return np.asarray(found.x, dtype=float)

    def residual(self, x: Array, used: np.ndarray) -> Array:
        """Whitened residuals of the used stations and the priors, shape (3 n + 15 + gyro azimuths,)."""
        return np.concatenate([self._whitened(x)[used].ravel(), x, self._gyro_residual(x, used)])

    def slope(self, x: Array, used: np.ndarray) -> Array:
        """Derivative of `residual`, shape (3 n + 15 + gyro azimuths, 15)."""
        return np.concatenate([self._whitened_slope(x)[used].reshape(-1, 15), np.eye(15), self._gyro_slope(x, used)])

    def compared(self, used: np.ndarray) -> int:
        """Number of used stations with an azimuth of the gyro."""
        return int(self._seen(used).sum())

    def _seen(self, used: np.ndarray) -> np.ndarray:
        if self.gyro is None:
            return np.zeros(len(self.f), dtype=bool)
        return np.asarray(used & np.isfinite(self.gyro.azimuth) & np.isfinite(self.gyro.sigma))

    def _gyro_white(self, seen: np.ndarray) -> Array:
        """What whitens the differences from the gyro: each one's noise, the station's own, and the common error."""
        if self.gyro is None:
            return np.zeros((0, 0))
        slope = magnetic_geometry.angle_jacobian(self.f[seen], self.b[seen])[:, 1, :]
        own = self.gyro.sigma[seen] ** 2 + np.einsum("ni,ij,nj->n", slope, self.noise, slope)
        common = np.broadcast_to(self.gyro.common, seen.shape)[seen]
        return np.linalg.inv(np.linalg.cholesky(np.diag(own) + np.outer(common, common)))

    def _gyro_residual(self, x: Array, used: np.ndarray) -> Array:
        seen = self._seen(used)
        if self.gyro is None or not seen.any():
            return np.zeros(0)
        f, b = _corrected(self.f[seen], self.b[seen], self.scale @ x)
        off = wrap_pi(magnetic_geometry.raw_azimuth(f, b) - self.gyro.azimuth[seen])
        return np.asarray(self._gyro_white(seen) @ off)

    def _gyro_slope(self, x: Array, used: np.ndarray) -> Array:
        seen = self._seen(used)
        if not seen.any():
            return np.zeros((0, 15))
        f, b = _corrected(self.f[seen], self.b[seen], self.scale @ x)
        slope = np.zeros((int(seen.sum()), 15))
        slope[:, :_SENSORS] = np.einsum(
            "ni,nij->nj", magnetic_geometry.angle_jacobian(f, b)[:, 1, :], self._by_errors()[seen]
        )
        return np.asarray(self._gyro_white(seen) @ slope @ self.scale)

    def by_gyro(self, x: Array, covariance: Array, used: np.ndarray) -> Array:
        """Slope of the corrected readings, shape (n, 6), by a turn of all gyro azimuths; covariance of x, (15, 15)."""
        seen = self._seen(used)
        if self.gyro is None or not seen.any():
            return np.zeros((len(self.f), 6))
        shift = covariance @ self._gyro_slope(x, used).T @ self._gyro_white(seen).sum(axis=1)
        return np.asarray(self._by_errors() @ (self.scale @ shift)[:_SENSORS])

    def misfit(self, x: Array) -> Array:
        """Length of each station's whitened residual, shape (n,): in one of a thousand stations beyond 4 by chance."""
        return np.asarray(np.linalg.norm(self._whitened(x), axis=1))

    def _whitened(self, x: Array) -> Array:
        errors = self.scale @ x
        values, _ = self._values(errors)
        off = values - self.reference - np.array([errors[14], errors[12], errors[13]])
        return np.asarray(np.squeeze(self.white @ off[:, :, None], 2))

    def _whitened_slope(self, x: Array) -> Array:
        _, inputs = self._values(self.scale @ x)
        slope = np.zeros((len(self.f), 3, 15))
        slope[:, :, :_SENSORS] = inputs @ self._by_errors()
        slope[:, 0, 14], slope[:, 1, 12], slope[:, 2, 13] = -1.0, -1.0, -1.0
        return np.asarray(self.white @ slope @ self.scale)

    def reading_covariance(self, x: Array, covariance: Array, used: np.ndarray) -> Array:
        """
        Covariance of the corrected (f, b) of each station, shape (n, 6, 6): its noise and the errors left.

        A station that was used has shifted the errors by its own noise: their product is in it.
        """
        by_errors = self._by_errors()
        left = covariance[:_SENSORS, :_SENSORS]
        out = self.noise + by_errors @ left @ np.swapaxes(by_errors, 1, 2)
        _, inputs = self._values(self.scale @ x)
        slope = self._whitened_slope(x) @ np.linalg.inv(self.scale)
        gain = covariance[None, :_SENSORS] @ np.swapaxes(slope, 1, 2) @ self.white
        both = -by_errors @ gain @ inputs @ self.noise * used[:, None, None]
        return np.asarray(out + both + np.swapaxes(both, 1, 2))


def _corrected(f: Array, b: Array, errors: Array) -> tuple[Array, Array]:
    return f - errors[6:9] - errors[9:12] * f, b - errors[0:3] - errors[3:6] * b


def _remarks(used: np.ndarray, observable: np.ndarray) -> tuple[str, ...]:
    remarks = []
    hidden = [NAMES[k] for k in range(6) if not observable[k]]
    if hidden:
        remarks.append(f"not observable from these attitudes: {', '.join(hidden)}")
    if not used.all():
        left_out = ", ".join(str(k + 1) for k in np.flatnonzero(~used))
        remarks.append(f"left out as outliers: station {left_out} of {len(used)}")
    return tuple(remarks)


def _refusal(
    settings: MultistationSettings,
    used: np.ndarray,
    probability: float,
    chi_square: float,
    degrees: int,
    sigma: Array,
    sigma_raw: Array,
    misfit: Array,
) -> str:
    share = float(np.mean(~used))
    if share > settings.max_outliers or (np.where(used, misfit, 0.0).max() > settings.outlier_sigma):
        return (
            f"{int((~used).sum())} of {len(used)} stations do not fit one set of errors: "
            "the disturbance changes along the run (casing, other wells) or the tool was changed"
        )
    if probability < settings.min_probability:
        return (
            f"the stations do not fit one set of errors and this reference: chi-square {chi_square:.0f} of {degrees} "
            f"degrees of freedom, probability {probability:.1g}, limit {settings.min_probability:g}"
        )
    typical, before = float(np.degrees(np.median(sigma))), float(np.degrees(np.median(sigma_raw)))
    if typical > settings.max_sigma_deg:
        return (
            f"corrected azimuth good only to {typical:.1f} deg (limit {settings.max_sigma_deg:.1f} deg): "
            "the attitudes do not show the axial interference; take stations at other azimuths or a gyro"
        )
    if typical > before:
        return f"corrected azimuth no better than the raw one ({typical:.2f} against {before:.2f} deg)"
    return ""
