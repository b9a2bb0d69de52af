"""Whether the two ways to know the azimuth, by gyro and by the field, say the same at a survey; in words where not."""

from __future__ import annotations

import math

from mwd_surface.surveys.survey_record import AzimuthEstimate, North, Survey

_GYRO = ("gyro", "carried")
# Free of the drill string's axial interference; the raw one is expected to be off.
_FIELD = ("msa", "corrected")
_SIGMAS = 3.0


def disagreement(survey: Survey) -> str:
    """
    One sentence where the best gyro azimuth and the best corrected magnetic one are more than 3 sigma apart; else "".

    Both are compared from true north with the declination of the survey; one that is not available says nothing.
    """
    gyro, field = _best(survey, _GYRO), _best(survey, _FIELD)
    if gyro is None or field is None:
        return ""
    apart = math.remainder(_true(survey, field) - _true(survey, gyro), math.tau)
    sigma = math.hypot(gyro.sigma, field.sigma)
    if abs(apart) <= _SIGMAS * sigma:
        return ""
    return (
        f"survey {survey.sequence}: {field.method} azimuth is {math.degrees(apart):+.1f} deg"
        f" ({abs(apart) / max(sigma, 1e-9):.1f} sigma) from the {gyro.method} azimuth"
    )


def _best(survey: Survey, methods: tuple[str, ...]) -> AzimuthEstimate | None:
    norths = {North.TRUE, North.GRID} | ({North.MAGNETIC} if survey.has_reference else set())
    known = [a for a in survey.azimuths if a.method in methods and a.sigma >= 0.0 and a.north in norths]
    return min(known, key=lambda a: (methods.index(a.method), a.sigma), default=None)


def _true(survey: Survey, one: AzimuthEstimate) -> float:
    if one.north == North.MAGNETIC:
        return one.azimuth + survey.declination
    return one.azimuth + survey.convergence if one.north == North.GRID else one.azimuth
