"""
One survey station: six averaged axes to angles, totals, azimuth by each method with its sigma, and a verdict with
reasons.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from mwd_estimation.core import magnetic_geometry
from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reference_field import Reference, best_north, north_correction, to_north
from mwd_estimation.magnetic import axial_correction
from mwd_estimation.survey import acceptance as quality
from mwd_estimation.survey import azimuth_selection
from mwd_estimation.survey.acceptance import ACCEPT, DOUBTFUL, REJECT, Deviations, QualitySettings
from mwd_estimation.survey.azimuth_selection import CORRECTED, RAW
from mwd_estimation.survey.station_deviations import deviations, gross_faults
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import (
    gravity_toolface,
    inclination,
    magnetic_toolface,
    mat_from_quat,
    mat_nt,
    quat_from_rotvec,
    wrap_tau,
)
from mwd_sensors.core.settings import setting

# What a station without a magnetic azimuth is left with.
NO_AZIMUTH = ": inclination and toolface only"
# What an unknown angle of the azimuth's kind is said to be known to.
_UNKNOWN_SIGMA = math.pi
# With a smaller share of the field horizontal there is no azimuth at all.
_LEVEL = 1e-6
# Less is no reading, T, m/s^2.
_NO_FIELD = 1e-12
_NO_GRAVITY = 1e-3


@dataclass(frozen=True)
class StationSettings:
    """How a station is worked out."""

    azimuth_method: str = setting(
        "auto",
        "Which magnetic azimuth is taken: auto corrects for axial interference where there is some and it can be done",
        choices=("auto", RAW, CORRECTED),
    )
    north: str = setting(
        "best",
        "North the azimuth refers to; best is grid, else true, else magnetic",
        choices=("best", "grid", "true", "magnetic"),
    )
    plausible_interference_nt: float = setting(
        3000.0,
        "Axial interference imaginable at all, 1 sigma: where more of it than expected shows or could hide",
        unit="nT",
        low=1.0,
    )
    sag_correction_deg: float = setting(
        0.0,
        "Added to the inclination, times its sine: sag of the assembly in a horizontal hole",
        unit="deg",
        low=-5.0,
        high=5.0,
    )
    misalignment_y_deg: float = setting(
        0.0, "Hole axis against tool axis, turned about y (towards -z)", unit="deg", low=-10.0, high=10.0
    )
    misalignment_z_deg: float = setting(
        0.0, "Hole axis against tool axis, turned about z (towards +y)", unit="deg", low=-10.0, high=10.0
    )
    toolface_offset_deg: float = setting(
        0.0, "Added to both toolfaces: sensor housing against scribe line", unit="deg", low=-360.0, high=360.0
    )
    errors: SensorErrors = setting(SensorErrors, "What calibration leaves in the sensors")
    quality: QualitySettings = setting(QualitySettings, "Limits of the verdict")


@dataclass(frozen=True)
class MethodAzimuth:
    """
    Azimuth of one method, rad from the station's north, 1 sigma, and the reason it was refused (empty where it was
    not).

    Sigma is that of the tool's axis: how the tool lies in the hole errs alike for every method and is the station's
    `alignment`. A refused azimuth is still given with its sigma: it is to be looked at, not to be used.
    """

    method: str
    azimuth: float
    sigma: float
    refused: str = ""


@dataclass(frozen=True)
class Station:
    """
    A survey station; angles in rad, totals in SI, nan where a reading or the reference is missing.

    Attributes
    ----------
    inclination, sigma_inclination : float
        From the vertical.
    gravity_toolface, magnetic_toolface, sigma_toolface : float
        From high side, from the named north, and 1 sigma of the first.
    g_total, b_total, dip : float
        As measured: m/s^2, T, rad. No correction is in them.
    azimuth, sigma_azimuth : float
        The one chosen, from the named north; sigma is pi where nothing is known.
    north : str
        magnetic, true or grid.
    method : str
        raw or corrected: which azimuth was chosen.
    corrected : bool
        Whether the chosen azimuth is freed of axial interference.
    azimuths : tuple of MethodAzimuth
        Every method tried.
    interference, sigma_interference : float
        Axial field not of the Earth, T.
    interference_chi_square : float
        Misfit of the across-axis field, one degree of freedom.
    covariance : ndarray, shape (3, 3)
        Of (inclination, chosen azimuth, gravity toolface), rad^2, all errors included.
    alignment : ndarray, shape (3, 3)
        The part of it that is common to all methods: tool against hole.
    deviations : Deviations
        Totals against the reference; for a corrected azimuth with the interference taken off.
    verdict : str
        accept, doubtful or reject.
    reasons : tuple of str
        In words for a driller; an accepted station says what it was measured against.
    azimuth_doubts : tuple of str
        Those of the reasons that doubt nothing but the magnetic azimuth: with another azimuth they have no weight.
    limits : tuple of float
        Deviation of gravity, field and dip beyond which the verdict is doubtful, m/s^2, T, rad; nan: not judged.
    reference : Reference or None
        What it was judged and corrected by.
    north_correction : float
        Added to the magnetic azimuth, rad.
    f_t, b_t : ndarray, shape (3,)
        The readings.
    """

    inclination: float
    sigma_inclination: float
    gravity_toolface: float
    magnetic_toolface: float
    sigma_toolface: float
    g_total: float
    b_total: float
    dip: float
    azimuth: float
    sigma_azimuth: float
    north: str
    method: str
    corrected: bool
    azimuths: tuple[MethodAzimuth, ...]
    interference: float
    sigma_interference: float
    interference_chi_square: float
    covariance: Array = field(repr=False)
    alignment: Array = field(repr=False)
    deviations: Deviations = field(repr=False)
    verdict: str
    reasons: tuple[str, ...]
    reference: Reference | None
    north_correction: float
    f_t: Array = field(repr=False)
    b_t: Array = field(repr=False)
    azimuth_doubts: tuple[str, ...] = ()
    limits: tuple[float, float, float] = (math.nan, math.nan, math.nan)

    def by_method(self, method: str) -> MethodAzimuth | None:
        """The azimuth of one method, None where it was not tried."""
        return next((azimuth for azimuth in self.azimuths if azimuth.method == method), None)


def station(
    f_t: ArrayLike,
    b_t: ArrayLike,
    reference: Reference | None = None,
    settings: StationSettings | None = None,
    *,
    covariance_f: ArrayLike | None = None,
    covariance_b: ArrayLike | None = None,
    doubts: tuple[str, ...] = (),
    faults: tuple[str, ...] = (),
) -> Station:
    """
    Work out one station from its six averaged axes.

    Parameters
    ----------
    f_t, b_t : array_like, shape (3,)
        Mean specific force, m/s^2 (up at rest), and mean field, T, in tool axes. A nan marks a missing sensor.
    reference : Reference, optional
        Without one the azimuth is magnetic and uncorrected, and the station says so.
    settings : StationSettings, optional
    covariance_f, covariance_b : array_like, shape (3, 3), optional
        Noise of the two means, (m/s^2)^2 and T^2; what the sensors get wrong alike comes from the settings.
    doubts, faults : tuple of str
        What others saw while the station was taken: each makes it doubtful, respectively rejected.

    Returns
    -------
    Station

    Raises
    ------
    ValueError
        Shapes other than (3,) and (3, 3).
    """
    settings = StationSettings() if settings is None else settings
    f_raw, b_raw = _vector("f_t", f_t), _vector("b_t", b_t)
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = _to_hole(settings)
    noise = np.zeros((6, 6))
    noise[:3, :3], noise[3:, 3:] = _matrix("covariance_f", covariance_f), _matrix("covariance_b", covariance_b)
    g_total, b_total = float(np.linalg.norm(f_raw)), float(np.linalg.norm(b_raw))
    if not (np.isfinite(f_raw).all() and g_total > _NO_GRAVITY):
        reasons = ("no accelerometer reading: nothing can be worked out", *faults, *doubts)
        return _blind(f_raw, b_raw, reference, reasons)
    has_field = bool(np.isfinite(b_raw).all()) and b_total > _NO_FIELD
    has_field = has_field and math.cos(float(magnetic_geometry.dip(f_raw, b_raw))) > _LEVEL
    # Without a horizontal field any field serves for the slopes of inclination and toolface.
    f_h, b_h = turn[:3, :3] @ f_raw, turn[:3, :3] @ (b_raw if has_field else np.array([1e-5, 2e-5, 3e-5]))
    covariance_s = turn @ noise @ turn.T + settings.errors.covariance(f_h, b_h)
    inc, toolface = float(inclination(f_h)), float(gravity_toolface(f_h))
    dip = float(magnetic_geometry.dip(f_h, b_h)) if has_field else math.nan
    horizontal = b_total * math.cos(dip)
    if reference is not None and reference.has_field:
        horizontal = reference.horizontal

    findings = _Findings()
    doubted: tuple[str, ...] = ()
    north, turn_north = _north(reference, settings.north, findings, has_field)
    alignment = settings.errors.alignment(inc)
    jacobian = magnetic_geometry.angle_jacobian(f_h, b_h)
    correction, refused, hidden = None, "", False
    expected, plausible = settings.errors.axial_interference_nt * 1e-9, settings.plausible_interference_nt * 1e-9
    if has_field:
        if reference is not None and reference.has_field:
            correction = axial_correction.axial_correction(
                f_h,
                b_h,
                reference.horizontal,
                reference.vertical,
                covariance_s,
                reference.covariance,
                plausible=plausible,
            )
            refused = quality.correction_refusal(correction, inc, settings.quality)
        hidden = correction is not None and azimuth_selection.hidden(
            correction, jacobian, covariance_s, expected, plausible
        )
        methods = [azimuth_selection.raw(f_h, b_h, jacobian, covariance_s, expected, plausible, correction)]
        if correction is not None and math.isfinite(float(correction.azimuth)):
            methods.append(azimuth_selection.corrected(correction, jacobian, covariance_s))
        chosen = azimuth_selection.choose(settings.azimuth_method, methods, correction, refused, expected, plausible)
        azimuth = to_north(chosen.azimuth, turn_north)
        north_variance = _north_variance(reference, north, horizontal)
        covariance = chosen.covariance + alignment
        covariance[1, 1] += north_variance
        toolface_north = float(magnetic_toolface(mat_nt(inc, azimuth, toolface)))
    else:
        methods, chosen, north_variance = [], None, 0.0
        covariance = jacobian @ covariance_s @ jacobian.T + alignment
        covariance[1, :], covariance[:, 1] = 0.0, 0.0
        covariance[1, 1] = _UNKNOWN_SIGMA**2
        azimuth = toolface_north = b_total = math.nan
    covariance = _capped(covariance)

    corrected = chosen is not None and chosen.name == CORRECTED
    interference = float(correction.interference) if correction is not None else math.nan
    sigma_interference = float(correction.sigma_interference) if correction is not None else math.nan
    apart = deviations(
        f_h, b_h, reference, covariance_s, settings.errors, interference if corrected else 0.0, has_field
    )
    judgement = quality.judge(apart, settings.quality.limits)
    g_limit, b_limit, dip_limit = quality.bounds(apart, settings.quality.limits).tolist()
    findings.add(judgement.verdict, *judgement.reasons)
    b_earth = b_h - np.array([interference if corrected else 0.0, 0.0, 0.0])
    earth = (
        (float(np.linalg.norm(b_earth)), float(magnetic_geometry.dip(f_h, b_earth))) if has_field else (b_total, dip)
    )
    findings.add(REJECT, *gross_faults(g_total, *earth, reference))
    if has_field:
        _judge_field(findings, settings, reference, north, horizontal)
        doubted = _judge_interference(findings, settings, correction, corrected, refused)
        doubted += _judge_hidden(findings, float(jacobian[1, 3]), hidden)
        if math.sin(inc) < math.sin(math.radians(settings.quality.min_azimuth_inclination_deg)):
            findings.remark("near vertical: azimuth and high side are loose, use magnetic toolface")
    else:
        what = "horizontal field" if np.isfinite(b_raw).all() else "magnetometer reading"
        doubted = (f"no {what}{NO_AZIMUTH}",)
        findings.add(REJECT, *doubted)
    findings.add(DOUBTFUL, *doubts)
    findings.add(REJECT, *faults)
    held_against = quality.within(apart, settings.quality.limits) if findings.verdict == ACCEPT else ""

    offset = math.radians(settings.toolface_offset_deg)
    sag = math.radians(settings.sag_correction_deg) * math.sin(inc)
    return Station(
        inclination=min(max(inc + sag, 0.0), math.pi),
        sigma_inclination=math.sqrt(covariance[0, 0]),
        gravity_toolface=float(wrap_tau(toolface + offset)),
        magnetic_toolface=float(wrap_tau(toolface_north + offset)),
        sigma_toolface=math.sqrt(covariance[2, 2]),
        g_total=g_total,
        b_total=b_total,
        dip=dip,
        azimuth=azimuth,
        sigma_azimuth=math.sqrt(covariance[1, 1]),
        north=north,
        method="none" if chosen is None else chosen.name,
        corrected=corrected,
        azimuths=tuple(
            MethodAzimuth(
                method.name,
                to_north(method.azimuth, turn_north),
                min(math.sqrt(method.covariance[1, 1] + north_variance), _UNKNOWN_SIGMA),
                refused if method.name == CORRECTED else "",
            )
            for method in methods
        ),
        interference=interference,
        sigma_interference=sigma_interference,
        interference_chi_square=float(correction.chi_square) if correction is not None else math.nan,
        covariance=covariance,
        alignment=alignment,
        deviations=apart,
        verdict=findings.verdict,
        reasons=tuple(text for text in (*findings.reasons, held_against, *findings.remarks) if text),
        reference=reference,
        north_correction=turn_north,
        f_t=f_raw,
        b_t=b_raw,
        azimuth_doubts=doubted,
        limits=(g_limit, b_limit, dip_limit),
    )


class _Findings:
    """Verdict so far, the reasons that made it, and remarks that did not."""

    def __init__(self) -> None:
        self.verdict = ACCEPT
        self.reasons: list[str] = []
        self.remarks: list[str] = []

    def add(self, verdict: str, *reasons: str) -> None:
        """The graver verdict stands, if there is a reason for the new one."""
        if reasons:
            self.verdict = quality.worse(self.verdict, verdict)
            self.reasons += reasons

    def remark(self, text: str) -> None:
        """Something to know that is no reason."""
        self.remarks.append(text)


def _north(reference: Reference | None, wanted: str, findings: _Findings, has_field: bool) -> tuple[str, float]:
    """Name of the north and what to add to a magnetic azimuth, rad; magnetic, with a reason, if unknown."""
    north = best_north(reference) if wanted == "best" else wanted
    turn = north_correction(reference, north)
    if turn is not None:
        return north, turn
    if north == "true" and not has_field:
        # A gyro finds it without a declination, and there is nothing else to refer to it.
        return north, 0.0
    missing = "declination and convergence" if north == "grid" else "declination"
    findings.add(DOUBTFUL, f"{north} azimuth needs the {missing}: azimuth is magnetic")
    return "magnetic", 0.0


def _judge_field(
    findings: _Findings, settings: StationSettings, reference: Reference | None, north: str, horizontal: float
) -> None:
    if reference is None or not reference.has_field:
        findings.add(DOUBTFUL, f"no reference field: {north} azimuth, uncorrected, total field and dip not judged")
    limit = settings.quality.min_horizontal_field_nt
    if horizontal < limit * 1e-9:
        findings.add(
            DOUBTFUL,
            f"horizontal field only {horizontal * 1e9:.0f} nT, limit {limit:.0f} nT: "
            "a compass is weak here, take a gyro",
        )


def _judge_interference(
    findings: _Findings,
    settings: StationSettings,
    correction: axial_correction.AxialCorrection | None,
    corrected: bool,
    refused: str,
) -> tuple[str, ...]:
    """Say what shows; returned is what doubts nothing but the magnetic azimuth."""
    if settings.azimuth_method == CORRECTED and not corrected:
        findings.add(DOUBTFUL, "azimuth not corrected for axial interference: " + (refused or "no reference field"))
    expected_nt = settings.errors.axial_interference_nt
    if correction is None:
        return ()
    if not (corrected or azimuth_selection.shows(correction, expected_nt * 1e-9)):
        return ()
    nt, sigma_nt = float(correction.interference) * 1e9, float(correction.sigma_interference) * 1e9
    text = f"axial interference {nt:+.0f} +- {sigma_nt:.0f} nT"
    if corrected and refused:
        doubt = f"{text} corrected as well as it can be: {refused}"
        findings.add(DOUBTFUL, doubt)
        return (doubt,)
    if corrected:
        findings.remark(f"{text} corrected")
    elif settings.azimuth_method == RAW:
        findings.add(DOUBTFUL, f"{text} seen, azimuth uncorrected as asked")
    elif refused and settings.azimuth_method != CORRECTED:
        findings.remark(f"{text} not corrected: {refused}")
    return ()


def _judge_hidden(findings: _Findings, slope: float, hidden: bool) -> tuple[str, ...]:
    """
    Doubt an azimuth whose interference this attitude hides; slope: of the azimuth by the axial field, rad/T.

    A corrected one too: it is chosen where its uncertain estimate happens to be large.
    """
    if not hidden:
        return ()
    text = (
        "axial interference can hardly be seen in this attitude, 1000 nT of it turn the azimuth by "
        f"{math.degrees(abs(slope) * 1e-6):.1f} deg: use multi-station correction or a gyro"
    )
    findings.add(DOUBTFUL, text)
    return (text,)


def _north_variance(reference: Reference | None, north: str, horizontal: float) -> float:
    if north == "magnetic" or reference is None:
        return 0.0
    return reference.declination_variance(horizontal)


def _to_hole(settings: StationSettings) -> Array:
    """Rotation (3, 3) from tool axes to hole axes by the known misalignment."""
    angles = np.array([0.0, math.radians(settings.misalignment_y_deg), math.radians(settings.misalignment_z_deg)])
    return np.asarray(mat_from_quat(quat_from_rotvec(-angles)))


def _capped(covariance: Array) -> Array:
    """Covariance with no angle less certain than the full circle; correlations kept."""
    sigma = np.sqrt(np.diagonal(covariance))
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(sigma > _UNKNOWN_SIGMA, _UNKNOWN_SIGMA / sigma, 1.0)
    return np.asarray(covariance * scale[:, None] * scale[None, :])


def _blind(f_t: Array, b_t: Array, reference: Reference | None, reasons: tuple[str, ...]) -> Station:
    nan = math.nan
    return Station(
        inclination=nan,
        sigma_inclination=nan,
        gravity_toolface=nan,
        magnetic_toolface=nan,
        sigma_toolface=nan,
        g_total=nan,
        b_total=float(np.linalg.norm(b_t)),
        dip=nan,
        azimuth=nan,
        sigma_azimuth=nan,
        north="magnetic",
        method="none",
        corrected=False,
        azimuths=(),
        interference=nan,
        sigma_interference=nan,
        interference_chi_square=nan,
        covariance=np.full((3, 3), nan),
        alignment=np.full((3, 3), nan),
        deviations=Deviations(nan, nan, nan, np.full((3, 3), nan)),
        verdict=REJECT,
        reasons=reasons,
        reference=reference,
        north_correction=0.0,
        f_t=f_t,
        b_t=b_t,
    )


def _vector(name: str, value: ArrayLike) -> Array:
    vector = np.array(value, dtype=float)
    if vector.shape != (3,):
        raise ValueError(f"{name}: expected three axes, shape (3,), got {vector.shape}")
    return vector


def _matrix(name: str, value: ArrayLike | None) -> Array:
    matrix = np.zeros((3, 3)) if value is None else np.array(value, dtype=float)
    if matrix.shape != (3, 3):
        raise ValueError(f"{name}: expected shape (3, 3), got {matrix.shape}")
    return matrix
