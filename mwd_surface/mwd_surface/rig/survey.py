# SPDX-License-Identifier: Apache-2.0
"""
Accepted survey as all rig interfaces send it: a view of its record and of the well path, in SI and rad.

Inclination, azimuth and position are those of the definitive path, the same as in the exports and the report.
Quantities that only the survey has are added: totals, the six axes and the sigmas. None means "not known".
"""

from __future__ import annotations

import dataclasses
import functools
import math

from mwd_estimation.core.north import North
from mwd_estimation.core.status import Status
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.survey import Survey, Verdict
from mwd_sensors.core.unknown import or_none
from mwd_surface.list_files.remark import sentences
from mwd_surface.surveys.azimuth_source import AzimuthSource, azimuth_source
from mwd_surface.surveys.station_checks import revision_doubt
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import Judgement, SurveyRecord
from mwd_surface.trajectory.well_path import ASSUMED, Definitive

LAST = 32  # largest number of surveys that the rig interfaces have
_UNCORRECTED = Status.UNCORRECTED | Status.CORRECTION_REFUSED | Status.MAG_DISTURBED
# Fields of the signal table that depend on the whole path above the station, on the interval above it, and on the path
# only through the station.
_PLACE = frozenset({"vertical_depth", "position_north", "position_east", "vertical_section"})
_CURVATURE = frozenset({"dogleg_severity", "build_rate", "turn_rate"})
_OF_PATH = _PLACE | _CURVATURE | {"measured_depth", "inclination", "azimuth"}


@dataclasses.dataclass(frozen=True, eq=False)
class AcceptedSurvey:
    """View of a station in use: its record, and its index on a path of the list."""

    record: SurveyRecord
    path: Definitive
    station: int

    @property
    def result(self) -> Survey:
        """Definitive result of the estimator."""
        return self.record.survey

    @property
    def key(self) -> tuple[str, int, int]:
        """Key that changes with another survey, another decision on the survey, or another revision of its result."""
        return self.result.uuid, self.decided_ns, self.result.revision

    @property
    def decided_ns(self) -> int:
        """Time of the acceptance, ns since the epoch."""
        return self.record.judged_ns or self.result.stamp_ns

    @property
    def overridden(self) -> bool:
        """Whether a person accepted the survey against the automatic verdict."""
        return self.record.judgement == Judgement.ACCEPTED and self.result.verdict != Verdict.ACCEPT

    @functools.cached_property
    def source(self) -> AzimuthSource:
        """Composition of the azimuth."""
        return azimuth_source(self.result)

    @functools.cached_property
    def remark(self) -> str:
        """Why the azimuth is doubtful; empty if it is not."""
        return revision_doubt(self.record, self.path.north) or _remark(self.result, self.source)

    @functools.cached_property
    def assumption(self) -> str:
        """Assumption, in addition to measurements, on which depth and position are based; empty without one."""
        return "; ".join(sentences(self.path.assumptions))

    @functools.cached_property
    def assumed(self) -> frozenset[str]:
        """Names of the fields that are based on an assumption."""
        curvature = _CURVATURE if self.path.kind[self.station - 1] == ASSUMED else frozenset()
        return curvature | (_PLACE if self.path.assumed else frozenset())

    def value(self, field: str) -> float | None:
        """
        Return a number by its field in the signal table, or the sigma of a field; None if unknown.

        Units: m, rad, rad/m, m/s^2, T, degC. The azimuth is from the north of the well; unknown if the survey has none,
        as in a nearly vertical hole, although the path then continues with the azimuth of the station above.
        """
        if field == "azimuth" and self.result.azimuth_from(self.path.north) is None:
            return None
        if field in _OF_PATH:
            return or_none(getattr(self.path, field)[self.station])
        if field == "azimuth_uncorrected":
            return _uncorrected(self.result)
        if field == "gyro_share":
            return self.source.gyro_share if self.source.known else None
        return or_none(getattr(self.result, field))


def accepted_surveys(surveys: SurveyList) -> tuple[AcceptedSurvey, ...]:
    """Return the stations in use on the current leg and its parents, oldest first, at most the `LAST` newest."""
    path = surveys.definitive()
    found = [AcceptedSurvey(r, path, k) for k, r in enumerate(surveys.records_on(path)) if r is not None]
    return tuple(sorted(found, key=lambda one: one.result.stamp_ns)[-LAST:])


def _uncorrected(s: Survey) -> float | None:
    """Return the azimuth from magnetic north without correction, rad, or None if it is not known."""
    for estimate in s.azimuths:
        if estimate.method == AzimuthMethod.RAW and math.isfinite(estimate.sigma):
            return s.turned(estimate.azimuth, North(estimate.north), North.MAGNETIC)
    return s.azimuth_from(North.MAGNETIC) if s.azimuth_method in ("", AzimuthMethod.RAW) else None


def _remark(s: Survey, source: AzimuthSource) -> str:
    doubt = Status(s.status) & _UNCORRECTED
    if doubt and not source.corrected:
        return "the azimuth is not corrected for interference"
    return ""
