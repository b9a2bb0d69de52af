# SPDX-License-Identifier: Apache-2.0
"""Limits of the verdict on a survey, for surveys of the estimator and surveys from a telemetry link alike."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.settings import setting

TOOLCODE, CUSTOM = "toolcode", "custom"


def _limits(gravity_mg: float, field_nt: float, dip_deg: float) -> Array:
    """Return the limits on the deviations of gravity, m/s^2, field, T, and dip, rad, from the reference, shape (3,)."""
    return np.array([gravity_mg * 1e-3 * STANDARD_GRAVITY, field_nt * 1e-9, math.radians(dip_deg)])


#: Multiple of a fixed limit beyond which a survey is rejected, not doubtful.
REJECT_FACTOR = 1.5
# Named sets of limits. service: defaults of a service company; iscwsa: rule of thumb of the ISCWSA e-book, which states
# no limit for gravity.
LIMITS = {"service": _limits(2.5, 300.0, 0.45), "iscwsa": _limits(2.5, 300.0, 0.25)}


@dataclass(frozen=True)
class QualitySettings:
    """Settings of the limits at which a survey is accepted or doubtful."""

    limits: str = setting(
        TOOLCODE,
        "Limits on the deviations of total gravity, total field and dip: toolcode (from the errors of the tool at this "
        "attitude), service (2.5 mG, 300 nT, 0.45 deg), iscwsa (2.5 mG, 300 nT, 0.25 deg), custom (custom_limits).",
        choices=(TOOLCODE, *LIMITS, CUSTOM),
    )
    custom_limits: tuple[float, float, float] = setting(
        (2.5, 300.0, 0.45),
        "Custom limits on the deviations of total gravity (mG), total field (nT) and dip (deg) from the reference. "
        "Beyond the limit of gravity a survey is doubtful, beyond the limit of field or dip its azimuth; beyond 1.5 "
        "times the limit they are rejected. Raising them accepts worse accelerometers and more interference.",
        unit="mG, nT, deg",
        low=0.01,
        high=10000.0,
        expert=True,
    )
    far_deg: float = setting(
        10.0,
        "Error of the azimuth that the well cannot tolerate. Lowering it accepts only azimuths with a smaller sigma, "
        "about a third of this value.",
        low=0.1,
        high=90.0,
        expert=True,
    )
    far_probability: float = setting(
        0.007,
        "Largest probability of an error above far_deg with which an azimuth is accepted. Raising it accepts more "
        "stations near interference, but more of the accepted stations have a large error.",
        low=0.0001,
        high=0.5,
        expert=True,
    )

    def __post_init__(self) -> None:
        """Raise ValueError for custom limits that are probably in another order, or a field limit below 1 nT."""
        gravity_mg, field_nt, dip_deg = self.custom_limits
        if gravity_mg > 100.0 or dip_deg > 10.0:
            raise ValueError(
                f"custom_limits: {gravity_mg:g} mG and {dip_deg:g} deg are too large for limits; the order is gravity "
                "(mG), field (nT), dip (deg)"
            )
        if field_nt < 1.0:
            raise ValueError(f"custom_limits: {field_nt:g} nT is below the lowest limit on the field, 1 nT")

    @property
    def fixed(self) -> Array | None:
        """
        Fixed limits of gravity, m/s^2, field, T, and dip, rad; None if the limits follow from the tool code.

        Raises
        ------
        ValueError
            If the name of the limits is unknown.
        """
        if self.limits == TOOLCODE:
            return None
        if self.limits == CUSTOM:
            return _limits(*self.custom_limits)
        if self.limits not in LIMITS:
            raise ValueError(f"limits: {self.limits!r} is not one of {', '.join(LIMITS)}, {TOOLCODE}, {CUSTOM}")
        return LIMITS[self.limits]
