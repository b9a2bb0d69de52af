# SPDX-License-Identifier: Apache-2.0
"""Settings for taking and computing surveys."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting

SHORTEST_S, LONGEST_S = 1.0, 600.0  # shortest and longest averaging time, s


@dataclasses.dataclass(frozen=True)
class SurveySettings:
    """Settings for taking and computing surveys."""

    automatic: bool = setting(True, "Take a survey by itself in each interval in which the tool keeps still.")
    settle_s: float = setting(
        2.0,
        "Time for the string to settle before averaging. Raising it delays each survey and leaves out more of the "
        "string's swinging.",
        unit="s",
        low=0.0,
        high=120.0,
        expert=True,
    )
    duration_s: float = setting(
        8.0,
        "Averaging time of a survey. Raising it lowers the noise and takes longer.",
        unit="s",
        low=SHORTEST_S,
        high=LONGEST_S,
    )
    wait_for_gyro_s: float = setting(
        120.0,
        "Longest time that a survey taken by itself waits for the gyro azimuth and averages on. Raising it gives "
        "better gyro azimuths where the string stands still long enough; 0: do not wait.",
        unit="s",
        low=0.0,
        high=3600.0,
        expert=True,
    )
    north: str = setting(
        "best",
        "North that azimuths refer to; best is grid, else true, else magnetic, as far as the reference goes.",
        choices=("best", "grid", "true", "magnetic"),
    )
    gyro_method: str = setting(
        "seek",
        "North from the precision unit: seek (still or in two positions, biases estimated), s1 (the paper's filter: "
        "still, small bias only).",
        choices=("seek", "s1"),
        expert=True,
    )
    tool_code: str = setting(
        "",
        "ISCWSA / OWSG tool code whose magnitudes replace the tool's biases, scales, interference and alignment in "
        "surveys, for example MWD+SRGM; empty: the figures of `tool`. The limits of the verdict follow it.",
    )
    motion: float = setting(
        1.0,
        "Motion in which a survey is still taken, as a multiple of a mean rate and a standard deviation of the rate of "
        "0.03 rad/s and a standard deviation of the force of 0.25 m/s^2. Raising it takes surveys in a creeping string "
        "or with pumps on; their sigma grows.",
        low=0.1,
        high=10.0,
        expert=True,
    )
