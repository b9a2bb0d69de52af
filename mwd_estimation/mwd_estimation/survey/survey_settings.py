# SPDX-License-Identifier: Apache-2.0
"""Settings for taking and computing surveys."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting

SHORTEST_S, LONGEST_S = 1.0, 600.0  # shortest and longest averaging time, s


@dataclasses.dataclass(frozen=True)
class SurveySettings:
    """Settings for taking and computing surveys."""

    automatic: bool = setting(True, "Take a survey automatically in each interval in which the tool is at rest.")
    settle_s: float = setting(
        2.0,
        "Time for the string to settle before averaging. Raising it leaves out more of the string's "
        "swinging, but delays each survey.",
        low=0.0,
        high=120.0,
        expert=True,
    )
    duration_s: float = setting(
        8.0,
        "Averaging time of a survey. Raising it lowers the noise; each survey takes longer.",
        low=SHORTEST_S,
        high=LONGEST_S,
    )
    wait_for_gyro_s: float = setting(
        120.0,
        "Longest time that an automatic survey waits for the gyro azimuth; it continues to average while it waits. "
        "Raising it gives better gyro azimuths if the string stands still long enough. 0: do not wait.",
        low=0.0,
        high=3600.0,
        expert=True,
    )
    north: str = setting(
        "best",
        "North of the azimuths. best: grid north if the convergence is known, else true north if the declination is "
        "known, else magnetic north.",
        choices=("best", "grid", "true", "magnetic"),
    )
    gyro_method: str = setting(
        "seek",
        "North seeking with the precision unit: seek (tool at rest, in one or two positions; gyro biases are "
        "estimated) or s1 (filter of paper S1: tool at rest, for a small gyro bias only).",
        choices=("seek", "s1"),
        expert=True,
    )
    tool_code: str = setting(
        "",
        "ISCWSA / OWSG tool code, for example MWD+SRGM. Its error magnitudes replace bias, scale, interference and "
        "alignment errors of the section `tool` in surveys, and the limits of the verdict follow from them. Empty: the "
        "errors of the section `tool`.",
    )
    motion: float = setting(
        1.0,
        "Factor on the limits of motion within which a survey is taken. With 1 the limits are 0.03 rad/s for the mean "
        "rate and for the standard deviation of the rate, and 0.25 m/s^2 for the standard deviation of the force. "
        "Raising it allows surveys in a creeping string or with pumps on; their sigma is larger.",
        low=0.1,
        high=10.0,
        expert=True,
    )
