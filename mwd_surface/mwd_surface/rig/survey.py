# SPDX-License-Identifier: Apache-2.0
"""
Accepted survey as all rig interfaces send it: the numbers of the well path, in SI and rad.

Inclination, azimuth and position are those of the definitive path, the same as in the exports and the report.
Quantities that only the survey has are added: totals, the six axes and the sigmas. None means "not known".
"""

from __future__ import annotations

import dataclasses
import math

from mwd_estimation.core.north import North
from mwd_estimation.core.status import Status
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.survey import Survey, Three, Verdict
from mwd_sensors.core.unknown import or_none
from mwd_surface.list_files.remark import sentences
from mwd_surface.surveys.azimuth_source import AzimuthSource, azimuth_source
from mwd_surface.surveys.station_checks import revision_doubt
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import Judgement, SurveyRecord
from mwd_surface.trajectory.well_path import ASSUMED, Definitive

LAST = 32  # largest number of surveys that the rig interfaces have
_UNCORRECTED = Status.UNCORRECTED | Status.CORRECTION_REFUSED | Status.MAG_DISTURBED
# Fields that depend on the whole path above the station, and fields that depend on the interval above the station only.
_PLACE = frozenset({"vertical_depth", "position_north", "position_east", "vertical_section"})
_CURVATURE = frozenset({"dogleg_severity", "build_rate", "turn_rate"})


@dataclasses.dataclass(frozen=True)
class AcceptedSurvey:
    """
    One station in use.

    Units: m, rad, rad/m, m/s^2, T, degC. stamp_ns, decided_ns: time of the measurement and of the acceptance, ns since
    the epoch. revision: revision number of the estimator's result; 0 for the first result.
    azimuth: from the north of the well. azimuth_uncorrected: from magnetic north, before the correction for
    interference, or None. source: composition of the azimuth. overridden: whether a person accepted the survey against
    the automatic verdict. remark: why the azimuth is doubtful, or empty. assumption: assumption, in addition to
    measurements, on which depth and position are based, or empty. assumed: names of the fields based on the assumption.
    """

    sequence: int
    uuid: str
    revision: int
    stamp_ns: int
    decided_ns: int
    measured_depth: float
    inclination: float
    azimuth: float
    north: North
    vertical_depth: float
    position_north: float
    position_east: float
    vertical_section: float
    dogleg_severity: float
    build_rate: float
    turn_rate: float
    azimuth_uncorrected: float | None
    sigma_inclination: float | None
    sigma_azimuth: float | None
    g_total: float | None
    b_total: float | None
    dip: float | None
    axial_interference: float | None
    temperature: float | None
    specific_force: Three
    magnetic_field: Three | None
    verdict: Verdict
    overridden: bool
    source: AzimuthSource
    remark: str = ""
    assumption: str = ""
    assumed: frozenset[str] = frozenset()

    @property
    def key(self) -> tuple[str, int, int]:
        """Key that changes with another survey, another decision on the survey, or another revision of its result."""
        return self.uuid, self.decided_ns, self.revision

    @property
    def gyro_share(self) -> float | None:
        """Share of the gyro in the azimuth, 0 to 1; None if unknown."""
        return self.source.gyro_share if self.source.known else None


def accepted_surveys(surveys: SurveyList) -> tuple[AcceptedSurvey, ...]:
    """Return the stations in use on the current leg and its parents, oldest first, at most the `LAST` newest."""
    path = surveys.definitive()
    places = {sequence: k for k, sequence in enumerate(path.sequence) if sequence}
    used = sorted(
        (r for r in surveys.records if r.in_use and r.survey.sequence in places), key=lambda r: r.survey.stamp_ns
    )
    return tuple(_accepted(r, path, places[r.survey.sequence]) for r in used[-LAST:])


def _accepted(record: SurveyRecord, path: Definitive, k: int) -> AcceptedSurvey:
    s, source = record.survey, azimuth_source(record.survey)
    magnetic = math.isfinite(s.magnetic_field[0])
    n, e, d = (float(v) for v in path.positions[k])
    return AcceptedSurvey(
        sequence=s.sequence,
        uuid=s.uuid,
        revision=s.revision,
        stamp_ns=s.stamp_ns,
        decided_ns=record.judged_ns or s.stamp_ns,
        measured_depth=float(path.md[k]),
        inclination=float(path.inclination[k]),
        azimuth=float(path.azimuth[k]),
        north=path.north,
        vertical_depth=d,
        position_north=n,
        position_east=e,
        vertical_section=float(path.vertical_section[k]),
        dogleg_severity=float(path.dogleg_severity[k]),
        build_rate=float(path.build_rate[k]),
        turn_rate=float(path.turn_rate[k]),
        azimuth_uncorrected=_uncorrected(s),
        sigma_inclination=or_none(s.sigma_inclination),
        sigma_azimuth=or_none(s.sigma_azimuth),
        g_total=or_none(s.g_total),
        b_total=or_none(s.b_total),
        dip=or_none(s.dip),
        axial_interference=or_none(s.axial_interference),
        temperature=or_none(s.temperature),
        specific_force=s.specific_force,
        magnetic_field=s.magnetic_field if magnetic else None,
        verdict=Verdict(s.verdict),
        overridden=record.judgement == Judgement.ACCEPTED and s.verdict != Verdict.ACCEPT,
        source=source,
        remark=revision_doubt(record, path.north) or _remark(s, source, path.north),
        assumption="; ".join(sentences(path.assumptions)),
        assumed=_assumed(path, k),
    )


def _assumed(path: Definitive, k: int) -> frozenset[str]:
    """Return the names of those fields of the survey at index k of a path that are based on an assumption."""
    return (_PLACE if path.assumed else frozenset()) | (_CURVATURE if path.kind[k - 1] == ASSUMED else frozenset())


def _uncorrected(s: Survey) -> float | None:
    """Return the azimuth from magnetic north without correction, rad, or None if it is not known."""
    for estimate in s.azimuths:
        if estimate.method == AzimuthMethod.RAW and math.isfinite(estimate.sigma):
            return s.turned(estimate.azimuth, North(estimate.north), North.MAGNETIC)
    return s.azimuth_from(North.MAGNETIC) if s.azimuth_method in ("", AzimuthMethod.RAW) else None


def _remark(s: Survey, source: AzimuthSource, north: North) -> str:
    if s.azimuth_from(north) is None:
        return "the survey has no azimuth; the azimuth of the station above is used"
    doubt = Status(s.status) & _UNCORRECTED
    if doubt and not source.corrected:
        return "the azimuth is not corrected for interference"
    return ""
