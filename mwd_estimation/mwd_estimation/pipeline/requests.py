# SPDX-License-Identifier: Apache-2.0
"""Requests to the estimator in addition to its own surveys: a north seek and a survey in a turning string."""

from __future__ import annotations

import dataclasses

import numpy as np

from mwd_estimation.core.clip_flags import UnitSamples
from mwd_estimation.core.reasons import Reason
from mwd_estimation.gyrocompass.session import NorthSession
from mwd_estimation.gyrocompass.solution import Solution
from mwd_estimation.pipeline.precision_unit import first_not_before
from mwd_estimation.settings import derivation
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.rotary_survey import Progress as RotaryProgress
from mwd_estimation.survey.rotary_survey import RotarySurvey
from mwd_estimation.survey.static_survey import BIN_NS, Refusal, StillAverage
from mwd_sensors.core.arrays import Array, Samples, Stamps

LONGEST_S = 3600.0  # longest duration of a request, s
_ROTARY_S = 30.0  # duration of a rotary survey whose request states no duration, s


class Requests:
    """The current north seek and rotary survey, at most one of each."""

    def __init__(self, settings: EstimatorSettings) -> None:
        self._settings = settings
        self._north: NorthSession | None = None
        self._rotary: RotarySurvey | None = None
        # Rates of the conventional unit since the north seek was requested.
        self._rates = np.zeros(0, dtype=np.int64), np.zeros((0, 3))

    def start_north(self, duration_s: float, mode: str) -> None:
        """
        Start a north seek.

        duration_s: duration, 0 for the default; mode: see `NorthSession`.

        Raises
        ------
        ValueError
            If the request cannot be carried out, a seek is running already, or the latitude is unknown.
        """
        if self._north is not None:
            raise ValueError("north is already being sought")
        if self._settings.place.lat_deg is None:
            raise ValueError("the latitude is not known: set place.lat_deg and place.lon_deg")
        params, unit = derivation.north_params(self._settings), derivation.gyrocompass_params(self._settings)
        self._north = NorthSession(params, unit, _bounded(duration_s), mode)
        self._rates = np.zeros(0, dtype=np.int64), np.zeros((0, 3))

    def cancel_north(self) -> None:
        """Cancel the north seek."""
        self._north = None

    @property
    def north(self) -> NorthSession | None:
        """The current north seek; None if no seek runs."""
        return self._north

    def take_rates(self, stamps: Stamps, gyro: Array) -> None:
        """Pass stamps, ns, shape (n,), and rates, rad/s, shape (n, 3), of the conventional unit to the north seek."""
        if self._north is not None:
            self._rates = np.concatenate([self._rates[0], stamps]), np.concatenate([self._rates[1], gyro])

    def seek(self, end_ns: int, precision: UnitSamples) -> Solution | None:
        """
        Pass a bin that ends at `end_ns`, ns, to the north seek, unless the seek began later.

        Return the result when the seek ends, otherwise None.
        """
        stamps, rates = self._rates
        if self._north is None or not len(stamps) or stamps[0] >= end_ns:
            return None
        before = first_not_before(stamps, 0, end_ns)
        self._north.add(BIN_NS * 1e-9, precision, (stamps[:before], rates[:before]))
        self._rates = stamps[before:], rates[before:]
        if not self._north.done:
            return None
        found, self._north = self._north.solution(), None
        return found

    def end_north(self, reason: Reason) -> Solution | None:
        """End the north seek for a reason, and return its result; return None if no seek runs."""
        if self._north is None:
            return None
        found, self._north = dataclasses.replace(self._north.solution(), reason=reason), None
        return found

    def start_rotary(self, duration_s: float) -> None:
        """
        Start a rotary survey, which averages in axes that do not turn with the string.

        Raises
        ------
        ValueError
            If the duration, s, is not valid, or a rotary survey is running already.
        """
        if self._rotary is not None:
            raise ValueError("a rotary survey is already being taken")
        self._rotary = RotarySurvey(_bounded(duration_s) or _ROTARY_S)

    def cancel_rotary(self) -> None:
        """Cancel the rotary survey."""
        self._rotary = None

    @property
    def rotary_progress(self) -> RotaryProgress | None:
        """Progress of the rotary survey; None if no rotary survey runs."""
        return self._rotary.progress() if self._rotary is not None else None

    def average(self, samples: Samples, pairs: Samples) -> tuple[StillAverage | Refusal, float] | None:
        """
        Pass a block to the rotary survey.

        samples: dtype `attitude.sample.SAMPLE`; pairs: dtype `attitude.time_alignment.PAIR`. When the survey
        ends, return its average or refusal, and the rotary speed, rad/s; otherwise None.
        """
        if self._rotary is None:
            return None
        result = self._rotary.add(samples, pairs)
        if result is None:
            return None
        ended, self._rotary = self._rotary, None
        return result, 0.0 if isinstance(result, Refusal) else ended.rotary_speed


def _bounded(duration_s: float) -> float:
    """Return the duration of a request, s; raise ValueError if it is too long."""
    if duration_s > LONGEST_S:
        raise ValueError(f"duration: must be at most {LONGEST_S:g} s, got {duration_s:g}")
    return duration_s
