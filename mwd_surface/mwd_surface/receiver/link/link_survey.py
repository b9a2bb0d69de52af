# SPDX-License-Identifier: Apache-2.0
"""
Survey from the words of a link: angles, totals, covariance and verdict, with the errors of a tool code.

The tool does not send its six axes. They are reconstructed from the received angles and totals, except for the
toolface. The errors of the tool code propagate through the reconstructed axes as through measured ones, and the
rounding of the words is added.
"""

from __future__ import annotations

import dataclasses
import math
import uuid
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from mwd_estimation.core import magnetic_geometry, reason_text
from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.north import North
from mwd_estimation.core.reference_field import Reference, best_north, north_correction, to_north
from mwd_estimation.survey import totals
from mwd_estimation.survey.quality_settings import QualitySettings
from mwd_estimation.survey.survey import RECEIVED_OVER, AzimuthEstimate, Nine, Survey, Verdict
from mwd_estimation.survey.totals import Deviations, deviation_covariance
from mwd_sensors.core import frames
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.telemetry import meanings
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.flow_spans import SURVEY_S
from mwd_surface.receiver.words import LinkValue

_VERDICTS = {"accept": Verdict.ACCEPT, "doubtful": Verdict.DOUBTFUL, "reject": Verdict.REJECT}
# Ordinary field, used only for the size of the errors where no field word was received.
_FIELD, _DIP = 5.0e-5, math.radians(65.0)
_NAMESPACE = uuid.UUID("5b0cfe2c-94f6-4d0e-9c1f-6f0cbd0a5f5e")


# Longest time from the beginning of a time at rest to the middle of the survey taken in it, s.
SETTLE_S = 6.0
# Tolerance for the difference between the clocks of two links when their times at rest are compared, s.
_CLOCKS_S = 5.0


@dataclasses.dataclass(frozen=True)
class SurveyTime:
    """
    Stamp of a survey, ns, and half of the time at rest around it, s.

    If the time at rest is unknown, its half is inf and the stamp is the latest possible time of the survey.
    """

    stamp_ns: int
    half_s: float

    @property
    def _rest_s(self) -> tuple[float, float]:
        """Begin and end of the time at rest, s; an unknown time at rest begins at -inf and ends at the stamp."""
        if not self.known:
            return -math.inf, self.stamp_ns / NANOSECONDS
        begin = self.stamp_ns / NANOSECONDS - min(self.half_s, SETTLE_S)
        return begin, begin + 2.0 * self.half_s

    @property
    def known(self) -> bool:
        """Whether the time at rest around the survey is known."""
        return math.isfinite(self.half_s)

    def in_rest_of(self, other: SurveyTime) -> bool:
        """Return whether the times at rest of both surveys overlap or, if one is unknown, may overlap."""
        (one_begin, one_end), (two_begin, two_end) = self._rest_s, other._rest_s
        return max(one_begin, two_begin) <= min(one_end, two_end) + _CLOCKS_S


class HeardSurvey(NamedTuple):
    """Survey as received over one link: name of the link, time, and the believed words by meaning."""

    link: str
    at: SurveyTime
    values: dict[str, LinkValue]


def survey(
    values: dict[str, LinkValue],
    at: SurveyTime,
    sequence: int,
    link: str,
    reference: Reference | None,
    errors: SensorErrors | None = None,
    quality: QualitySettings | None = None,
) -> Survey | None:
    """
    Return the survey in the believed words of one frame; None if the inclination is not among them.

    Parameters
    ----------
    values : dict
        Believed words by their meaning (`telemetry.meanings`).
    link : str
        Name of the link, for the reasons.
    reference : Reference or None
        Reference field at the site; without it the totals are not judged and the azimuth stays magnetic.
    errors : SensorErrors, optional
        Errors of the tool code; ordinary MWD by default.
    """
    if meanings.INCLINATION not in values:
        return None
    errors, quality = errors or SensorErrors(), quality or QualitySettings()
    inclination, azimuth = values[meanings.INCLINATION], values.get(meanings.AZIMUTH)
    f_t, b_t = _axes(values, reference)
    covariance_s = errors.covariance(f_t, b_t)
    angles = _angle_covariance(values, f_t, b_t, covariance_s, errors, reference)
    spread = deviation_covariance(f_t, b_t, reference, covariance_s, errors.axial_interference_nt * 1e-9)
    deviations = _deviations(values, reference, spread)
    verdicts, reasons = _verdicts(values, deviations, angles, quality)
    north, turn = north_of(reference)
    angle = math.nan if azimuth is None else to_north(azimuth.value, turn)
    sigma = math.sqrt(angles[4])
    return Survey(
        stamp_ns=at.stamp_ns,
        uuid=_uuid(values, at, link),
        sequence=sequence,
        inclination=inclination.value,
        azimuth=angle,
        north=int(north),
        duration=0.0 if math.isinf(at.half_s) else 2.0 * at.half_s,
        covariance=angles,
        azimuth_method="link" if azimuth is not None else "",
        azimuths=(AzimuthEstimate("link", int(north), angle, sigma, float(azimuth is not None)),),
        verdict=int(max(verdicts)),
        verdict_inclination=int(verdicts[0]),
        verdict_azimuth=int(verdicts[1]),
        verdict_toolface=int(Verdict.NOT_DETERMINED),
        headline=reasons[0] if max(verdicts) != Verdict.ACCEPT else "",
        reasons=(*reasons, f"{RECEIVED_OVER}{link.replace('_', ' ')}"),
        **_totals(values, deviations, quality),
        **_reference_fields(reference),
    )


def _uuid(values: dict[str, LinkValue], at: SurveyTime, link: str) -> str:
    codes = ",".join(f"{name}:{one.raw}" for name, one in sorted(values.items()))
    return str(uuid.uuid5(_NAMESPACE, f"{link} {at.stamp_ns} {codes}"))


def _totals(values: dict[str, LinkValue], deviations: Deviations, quality: QualitySettings) -> dict[str, Any]:
    """Return the received totals, with their deviations from the reference and the limits of these deviations."""
    limits = totals.bounds(deviations, quality)
    apart = (deviations.gravity, deviations.field, deviations.dip)
    return {
        "g_total": _value(values, meanings.G_TOTAL, math.nan),
        "b_total": _value(values, meanings.B_TOTAL, math.nan),
        "dip": _value(values, meanings.DIP, math.nan),
        "temperature": _value(values, meanings.TEMPERATURE, math.nan),
        **{name: float(off) for name, off in zip(("g_deviation", "b_deviation", "dip_deviation"), apart, strict=True)},
        **{name: float(limit) for name, limit in zip(("g_limit", "b_limit", "dip_limit"), limits, strict=True)},
    }


def _value(values: dict[str, LinkValue], quantity: str, otherwise: float) -> float:
    found = values.get(quantity)
    return otherwise if found is None else found.value


def _axes(values: dict[str, LinkValue], reference: Reference | None) -> tuple[Array, Array]:
    """
    Return specific force, m/s^2, and field, T, shape (3,) each, in tool axes with the toolface at high side.

    They reproduce the received values. Values that were not received are those of the reference, else usual ones.
    """
    usual = (reference.total, reference.dip) if reference is not None else (None, None)
    g = _value(values, meanings.G_TOTAL, STANDARD_GRAVITY)
    b = _value(values, meanings.B_TOTAL, usual[0] or _FIELD)
    dip = _value(values, meanings.DIP, _DIP if usual[1] is None else usual[1])
    mat_nt = frames.mat_nt(values[meanings.INCLINATION].value, _value(values, meanings.AZIMUTH, 0.0), 0.0)
    f_t = mat_nt.T @ np.array([0.0, 0.0, -g])
    return f_t, mat_nt.T @ (b * np.array([math.cos(dip), 0.0, math.sin(dip)]))


def _angle_covariance(
    values: dict[str, LinkValue],
    f_t: Array,
    b_t: Array,
    covariance_s: Array,
    errors: SensorErrors,
    reference: Reference | None,
) -> Nine:
    """
    Return the covariance of (inclination, azimuth, toolface), rad^2, row by row; NaN except its first two variances.

    A variance comes from the sigma that the tool sent, else from the tool code; the rounding of the word is added.
    """
    inclination = values[meanings.INCLINATION]
    covariance_s = covariance_s.copy()
    covariance_s[3, 3] += (errors.axial_interference_nt * 1e-9) ** 2
    jacobian = magnetic_geometry.angle_jacobian(f_t, b_t)
    code = jacobian @ covariance_s @ jacobian.T + errors.alignment(inclination.value)
    variance_i, variance_a = float(code[0, 0]), float(code[1, 1])
    if reference is not None:
        horizontal = float(np.linalg.norm(b_t)) * math.cos(float(magnetic_geometry.dip(f_t, b_t)))
        variance_a += reference.sigma_declination**2 + (reference.sigma_declination_field / horizontal) ** 2
    if meanings.SIGMA_INCLINATION in values:
        variance_i = values[meanings.SIGMA_INCLINATION].value ** 2
    if meanings.SIGMA_AZIMUTH in values:
        variance_a = values[meanings.SIGMA_AZIMUTH].value ** 2
    variance_i += inclination.sigma**2
    azimuth = values.get(meanings.AZIMUTH)
    variance_a = math.nan if azimuth is None else min(variance_a + azimuth.sigma**2, math.pi**2)
    unknown = math.nan
    return variance_i, unknown, unknown, unknown, variance_a, unknown, unknown, unknown, unknown


def _deviations(values: dict[str, LinkValue], reference: Reference | None, covariance: Array) -> Deviations:
    """
    Return the totals minus the reference, NaN where either is unknown, with their covariance.

    The variances of the rounding of the words are added to `covariance` in place.
    """
    found = []
    for k, (quantity, of_reference) in enumerate(
        ((meanings.G_TOTAL, "gravity"), (meanings.B_TOTAL, "total"), (meanings.DIP, "dip"))
    ):
        one, known = values.get(quantity), getattr(reference, of_reference, None)
        found.append(math.nan if one is None or known is None else one.value - known)
        covariance[k, k] += 0.0 if one is None else one.sigma**2
    return Deviations(found[0], found[1], found[2], covariance)


def _verdicts(
    values: dict[str, LinkValue], deviations: Deviations, angles: Nine, quality: QualitySettings
) -> tuple[tuple[Verdict, Verdict], list[str]]:
    """Return the verdicts of inclination and azimuth, and the reasons, most serious first."""
    field = totals.judge(deviations, quality)
    nothing = dataclasses.replace(deviations, field=math.nan, dip=math.nan)
    gravity = totals.judge(nothing, quality)
    inclination, azimuth = _VERDICTS[gravity.verdict], _VERDICTS[field.verdict]
    reasons = reason_text.texts(field.reasons)
    if meanings.AZIMUTH not in values:
        azimuth = Verdict.REJECT
        reasons.insert(0, "the azimuth was not received: let the tool send the survey again")
    elif _far_off(math.sqrt(angles[4]), quality.far_deg) > quality.far_probability:
        azimuth = max(azimuth, Verdict.DOUBTFUL)
        reasons.insert(0, f"sigma of the azimuth is {math.degrees(math.sqrt(angles[4])):.1f} deg")
    missing = [name for name, quantity in _TOTALS.items() if quantity not in values]
    if missing:
        reasons.append(f"not received, so not checked: {', '.join(missing)}")
    return (inclination, azimuth), reasons or reason_text.texts(totals.against_limits(deviations, quality))


def _far_off(sigma: float, far_deg: float) -> float:
    """Return the probability that an azimuth with this sigma, rad, is wrong by more than `far_deg`."""
    return math.erfc(math.radians(far_deg) / (math.sqrt(2.0) * sigma))


_TOTALS = {"total gravity": meanings.G_TOTAL, "total field": meanings.B_TOTAL, "dip": meanings.DIP}


def north_of(reference: Reference | None) -> tuple[North, float]:
    """Return the best north that the reference allows, and the angle to add to a magnetic azimuth for it, rad."""
    north = best_north(reference)
    return North[north.upper()], north_correction(reference, north) or 0.0


def _reference_fields(reference: Reference | None) -> dict[str, Any]:
    if reference is None:
        return {}
    given = {
        "g_reference": reference.gravity,
        "b_reference": reference.total,
        "dip_reference": reference.dip,
        "declination": reference.declination,
        "convergence": reference.convergence,
        "reference_source": reference.source,
    }
    return {name: value for name, value in given.items() if value is not None}


# Surveys of all links.

_OF_SURVEY = (meanings.INCLINATION, meanings.AZIMUTH, meanings.G_TOTAL, meanings.B_TOTAL, meanings.DIP)
_SPARE_S = 30.0  # time in addition to the slowest link for which a survey waits for more words, s
# Largest difference of two words that may be roundings of one value, as a multiple of the sum of their sigmas: half a
# step of each word. The sigma of a word is its step over sqrt(12).
_HALF_STEPS = 0.5 * math.sqrt(12.0) * 1.01


@dataclasses.dataclass
class _LinkStation:
    """Newest survey: its received words, its values, and the link from which each value comes."""

    heard: HeardSurvey
    values: dict[str, LinkValue]
    links: dict[str, str]
    until_ns: int  #: stamp until which the survey waits for more words
    published: frozenset[str] = frozenset()  #: names of the angles already returned


class LinkSurveys:
    """
    Surveys of one tool, in order of time.

    Parameters
    ----------
    tools : sequence of ToolConfiguration
        Configuration of each link. With several links, a survey that lacks a word waits for another link to bring it.
    reference : callable
        Returns the reference field at a stamp, ns, or None if no reference is configured.
    errors : SensorErrors, optional
        Errors of the tool code, used where the tool sends no sigma.
    quality : QualitySettings, optional
        Acceptance limits of a survey, the same as the estimator's.
    """

    def __init__(
        self,
        tools: Sequence[ToolConfiguration],
        reference: Callable[[int], Reference | None],
        errors: SensorErrors | None = None,
        quality: QualitySettings | None = None,
    ) -> None:
        self._reference, self._errors = reference, errors
        self.quality = quality or QualitySettings()  #: acceptance limits of the surveys to come
        sent = {meanings.meaning_of(item.name) for tool in tools for items in tool.surveys for item in items}
        self._wanted = sent & set(_OF_SURVEY)
        longest = max(tool.transmit_delay_s + tool.head_s + 2.0 * _longest_s(tool) for tool in tools)
        self._wait_ns = round((longest + _SPARE_S) * NANOSECONDS) if len(tools) > 1 else 0
        self._station: _LinkStation | None = None
        self._count = 0

    def take(self, heard: HeardSurvey, now_ns: int) -> list[Survey]:
        """Add the words of one frame, all received until the stamp `now_ns`, ns; return the surveys now complete."""
        station, out = self._station, []
        if station is None or not _same(station, heard):
            out = self._ended(station)
            links = dict.fromkeys(heard.values, heard.link)
            station = self._station = _LinkStation(heard, dict(heard.values), links, now_ns + self._wait_ns)
        else:
            for quantity, value in heard.values.items():
                if quantity not in station.values or _better(value, station.values[quantity], quantity):
                    station.values[quantity], station.links[quantity] = value, heard.link
            # Words sent again after a time at rest too short for a survey belong to the previous survey.
            if heard.at.half_s < station.heard.at.half_s and heard.at.in_rest_of(station.heard.at):
                station.heard = station.heard._replace(at=heard.at)
        return out + self.advance(now_ns)

    def advance(self, now_ns: int) -> list[Survey]:
        """Return a list with the present survey if it is complete, or has waited long enough at a stamp, ns."""
        station = self._station
        if station is None or (not self._wanted <= station.values.keys() and now_ns < station.until_ns):
            return []
        return self._ended(station)

    def finish(self) -> list[Survey]:
        """Return a list with the survey that still waits when no more words come."""
        return self._ended(self._station)

    def _ended(self, station: _LinkStation | None) -> list[Survey]:
        """
        Return a list with the survey of a station.

        The list is empty without an inclination, and if the survey was returned before and no angle has come since.
        """
        if station is None:
            return []
        known = frozenset(station.values.keys() & {meanings.INCLINATION, meanings.AZIMUTH})
        if meanings.INCLINATION not in known or known <= station.published:
            return []
        links = " and ".join(sorted(set(station.links.values())))
        at = station.heard.at
        reference = self._reference(at.stamp_ns)
        found = survey(station.values, at, self._count + 1, links, reference, self._errors, self.quality)
        if found is None:
            return []
        station.published = known
        self._count += 1
        return [found]


def _longest_s(tool: ToolConfiguration) -> float:
    return max(tool.seconds(items) for items in tool.surveys)


def _same(station: _LinkStation, heard: HeardSurvey) -> bool:
    """
    Return whether received words belong to the survey of a station.

    - A tool takes a new survey in each time at rest that is long enough. In a straight hole the new survey may have the
      same codes as the previous survey, so words from two long times at rest never belong to one survey.
    - Words from one time at rest over different links belong to one survey.
    - Words from one time at rest over the same link, or from times at rest that are too short or unknown, belong to one
      survey if they agree in every quantity that both have, and if one of these quantities is an angle. Otherwise the
      tool may have sent a second survey, taken while the string moved. A time at rest that was not seen ended before
      the survey was sent.
    - Equal totals alone are not enough, because totals hardly change from station to station.
    """
    one, two = station.heard.at, heard.at
    same_rest = one.in_rest_of(two)
    if not same_rest and SURVEY_S <= 2.0 * two.half_s < math.inf:
        return False
    if same_rest and one.known and two.known and station.heard.link != heard.link:
        return True
    both = [name for name in _OF_SURVEY if name in station.values and name in heard.values]
    angles = {meanings.INCLINATION, meanings.AZIMUTH}.intersection(both)
    return (
        len(both) >= 2 and bool(angles) and all(_agree(station.values[name], heard.values[name], name) for name in both)
    )


def _agree(one: LinkValue, two: LinkValue, quantity: str) -> bool:
    """Return whether two words may have the same value: equal codes, or equal within rounding if their steps differ."""
    if one.sigma == two.sigma:
        return one.raw == two.raw
    off = one.value - two.value
    if quantity == meanings.AZIMUTH:
        off = math.remainder(off, math.tau)
    return abs(off) <= _HALF_STEPS * (one.sigma + two.sigma)


def _better(new: LinkValue, old: LinkValue, quantity: str) -> bool:
    """Return whether `new` should replace `old`: if they agree, by its smaller sigma, else by its higher confidence."""
    if _agree(new, old, quantity):
        return new.sigma < old.sigma
    return new.confidence > old.confidence
