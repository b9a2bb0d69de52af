# SPDX-License-Identifier: Apache-2.0
"""One survey station without a run: angles, totals, azimuth with its sigma, and verdicts from six averaged axes."""

from __future__ import annotations

from numpy.typing import ArrayLike

from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.measurement import measured
from mwd_estimation.survey.run_model import RunModel, Taken
from mwd_estimation.survey.station_record import MethodAzimuth, Station
from mwd_estimation.survey.station_settings import StationSettings
from mwd_estimation.survey.verdict import judged

__all__ = ["MethodAzimuth", "Station", "StationSettings", "station"]


def station(
    f_t: ArrayLike,
    b_t: ArrayLike,
    reference: Reference | None = None,
    settings: StationSettings | None = None,
    *,
    covariance_f: ArrayLike | None = None,
    covariance_b: ArrayLike | None = None,
    faults: tuple[Reason, ...] = (),
) -> Station:
    """
    Compute one station from its six averaged axes: a run of length one.

    Parameters
    ----------
    f_t, b_t : array_like, shape (3,)
        Mean specific force, m/s^2 (up at rest), and mean field, T, in tool axes; NaN for a missing sensor.
    reference : Reference, optional
        Reference. Without it the azimuth is magnetic and uncorrected, and the station doubtful.
    covariance_f, covariance_b : array_like, shape (3, 3), optional
        Noise of the two means, (m/s^2)^2 and T^2; constant errors of the sensors come from the settings.
    faults : tuple of Reason
        Known faults of the readings; each rejects the station.

    Raises
    ------
    ValueError
        If the shapes are not (3,) and (3, 3).
    """
    settings = StationSettings() if settings is None else settings
    one = measured(f_t, b_t, reference, settings, covariance_f=covariance_f, covariance_b=covariance_b)
    return judged(one, RunModel(settings).take(Taken(one)), settings, faults)
