# SPDX-License-Identifier: Apache-2.0
"""A well of a dozen surveys with everything an export must print: two judgements, a rejection, corrections, a bit."""

import dataclasses
import functools
import math

from mwd_estimation.core.north import North
from mwd_estimation.survey.survey import AzimuthEstimate, Survey, Verdict
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.surveys.leg import Leg, TieOn
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.slide_sheet import ROTATE, SLIDE, DrilledStretch

S = 10**9
START = 1_778_767_020 * S + 123_456_789
WELL = Well(
    name="Åsgard Ω-1",
    wellbore="Ω-1 ST0",
    company="=Société & <Fils>",
    field="Demo",
    rig="Rig 7",
    service_company="Open MWD",
    latitude_deg=60.5,
    longitude_deg=2.8,
    depth_datum="RKB",
    datum_elevation=25.0,
    north_reference="grid",
    section_azimuth_deg=75.0,
    sensor_to_bit=12.5,
    geomagnetic_model="WMM2025 2026-05-14",
    error_model="ISCWSA MWD Rev5.11",
)
VERTICAL = TieOn.given(0.0, 0.0, 0.0)  # a person confirms that the hole above is vertical
SIGMA_I, SIGMA_A = math.radians(0.05), math.radians(0.4)
MADE = START + 100_000 * S


#: Fields of a survey without an azimuth.
NO_AZIMUTH = {"azimuth": math.nan, "covariance": (1e-6, *(math.nan,) * 8)}


def survey(k, inc_deg, azi_deg, **changes):
    magnetic = (azi_deg - 2.0) % 360.0
    methods = (
        AzimuthEstimate("raw", 1, math.radians(magnetic + 0.8), math.radians(1.0), 0.0, "axial interference"),
        AzimuthEstimate("corrected", 1, math.radians(magnetic), SIGMA_A),
        AzimuthEstimate("gyro", 1, math.nan, math.nan, 0.0, "rotating"),
    )
    values = {
        "stamp_ns": START + k * 1800 * S,
        "uuid": f"00000000-0000-4000-8000-{k:012d}",
        "sequence": k,
        "duration": 30.0,
        "samples": 3000,
        "inclination": math.radians(inc_deg),
        "azimuth": math.radians(magnetic) % math.tau,
        "north": int(North.MAGNETIC),
        "specific_force": (-9.81 * math.cos(math.radians(inc_deg)), 0.25, 9.81 * math.sin(math.radians(inc_deg))),
        "magnetic_field": (3.1e-5, -1.2e-5, 3.65e-5),
        "magnetic_field_covariance": (1e-16, 0.0, 0.0, 0.0, 1e-16, 0.0, 0.0, 0.0, 1e-16),
        "angular_rate": (1e-5, -2e-5, 7e-5),
        "temperature": 63.5,
        "gravity_toolface": 1.0,
        "magnetic_toolface": 2.0,
        "covariance": (SIGMA_I**2, 0.0, 0.0, 0.0, SIGMA_A**2, 0.0, 0.0, 0.0, 1e-6),
        "azimuth_method": "fused",
        "azimuths": methods,
        "g_total": 9.819 + 0.002 * math.sin(k),
        "b_total": 5.03e-5 + 9e-8 * math.cos(1.7 * k),
        "dip": math.radians(72.1 + 0.1 * math.sin(2.3 * k)),
        "g_reference": 9.819,
        "b_reference": 5.03e-5,
        "dip_reference": math.radians(72.1),
        "declination": math.radians(1.4),
        "convergence": math.radians(-0.6),
        "axial_interference": 8.5e-7,
        "sigma_axial_interference": 6e-8,
    }
    return Survey(**{**values, **changes})


def surveys(well=WELL, tie_on=VERTICAL):
    """Surveys every 30 m from 300 m: a build to 40 deg at azimuth 75 to 79 (grid); one bad, one by hand."""
    # Built once; a new object each time, because a list that was changed is another object.
    return dataclasses.replace(_built(well, tie_on))


@functools.cache
def _built(well, tie_on):
    whole = SurveyList(well=well, legs=(Leg(tie_on=tie_on),), tool="T-0042")
    for k in range(1, 13):
        inc, azi = max(0.0, 4.0 * (k - 2)), 75.0 + 0.4 * k
        changes = {}
        if k == 6:
            reasons = ("dip 78.5 deg is 6.4 over 72.1 +- 0.45",)
            changes = {"verdict": int(Verdict.REJECT), "reasons": reasons, "dip": math.radians(78.5)}
            changes |= {"verdict_azimuth": int(Verdict.REJECT), "verdict_toolface": int(Verdict.NOT_DETERMINED)}
            changes |= {"headline": "External magnetic field: move the sensor or use a gyro"}
            changes |= {"hypotheses": ("external", "cross_axial", "clean"), "hypothesis_odds": (0.9, 0.0995, 0.0005)}
            changes |= {"alternatives": (math.radians(190.0),), "alternative_odds": (0.25,)}
        if k == 9:
            changes = {"verdict": int(Verdict.DOUBTFUL), "reasons": ("total field 480 nT off, limit 300",)}
            changes["verdict_azimuth"] = int(Verdict.DOUBTFUL)
            changes["b_total"] = 5.078e-5
        whole = whole.add(survey(k, inc, azi, **changes), 270.0 + 30.0 * k, 0.4)
    whole = whole.accept(9, "Aslaug", "-casing; gyro agrees", START + 90_000 * S)
    return commented(whole, 3, '@washout, "slow" pumps\nsecond line')


def commented(surveys, sequence, comment):
    """Return a list with a comment on one of its surveys."""
    records = surveys.records
    return surveys.with_records(
        [dataclasses.replace(r, comment=comment) if r.survey.sequence == sequence else r for r in records]
    )


def stretches():
    """A slide of 9 m at the head of every second stand of the build, high side first, then a little to the right."""
    found = []
    for k in range(12):
        top, begin = 300.0 + 30.0 * k, START + k * 1800 * S
        slid = 9.0 if k % 2 else 0.0
        if slid:
            face = math.radians(359.7 if k < 4 else 8.0)
            found.append(DrilledStretch(SLIDE, top, top + slid, begin, begin + 900 * S, face, 0.93, magnetic=k == 1))
        found.append(
            DrilledStretch(ROTATE, top + slid, top + 30.0, begin + 900 * S, begin + 1700 * S, rotary_speed=12.5)
        )
    return tuple(found)


def table(plan=None, **changes):
    whole = surveys(dataclasses.replace(WELL, **changes.pop("well", {})), changes.pop("tie_on", VERTICAL))
    return survey_table(whole if plan is None else whole.along(plan), MADE, software="mwd 0.1.0", **changes)
