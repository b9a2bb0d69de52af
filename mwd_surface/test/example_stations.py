# SPDX-License-Identifier: Apache-2.0
"""Plain stations in a list: what tests of the live state and of its panels start from."""

import dataclasses

from mwd_estimation.core.north import North
from mwd_estimation.survey.survey import Survey
from mwd_surface.surveys.leg import Leg, TieOn
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.well import Well

G, B, DIP = 9.82, 50e-6, 1.2


def survey(sequence=1, **changes):
    """A station that agrees with its reference."""
    base = Survey(
        stamp_ns=sequence * 10**9,
        uuid=f"u{sequence}",
        sequence=sequence,
        inclination=0.1 * sequence,
        azimuth=1.0,
        north=int(North.GRID),
        covariance=(1e-6, 0, 0, 0, 4e-6, 0, 0, 0, 1e-6),
        azimuth_method="fused",
        g_total=G,
        b_total=B,
        dip=DIP,
        g_reference=G,
        b_reference=B,
        dip_reference=DIP,
    )
    return dataclasses.replace(base, **changes)


def listed(*surveys):
    """The list of these stations, 100 m apart."""
    vertical = Leg(tie_on=TieOn.given(0.0, 0.0, 0.0))
    found = SurveyList(well=Well(north_reference="grid", section_azimuth_deg=60.0), legs=(vertical,))
    for k, one in enumerate(surveys):
        found = found.add(one, 100.0 * (k + 1), 1.0)
    return found
