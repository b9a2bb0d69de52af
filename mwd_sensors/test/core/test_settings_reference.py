# SPDX-License-Identifier: Apache-2.0
"""The parameter reference: users' parameters first, experts' after, each with type, default, unit and range."""

from dataclasses import dataclass

from mwd_sensors.core.settings import setting
from mwd_sensors.core.settings_reference import parameter_tables


@dataclass(frozen=True)
class _Inner:
    gain: float = setting(0.5, "Gain | of it.", unit="1/s", low=0.0, high=2.0, expert=True)


@dataclass(frozen=True)
class _Settings:
    inner: _Inner = setting(_Inner, "Inner")
    mode: str = setting("a", "What to do.", choices=("a", "b"))
    axes: tuple[float, float] = setting((1.0, 2.0), "Both axes.", low=0.1)
    on: bool = setting(True, "Do it.")


def test_users_parameters_come_first_and_say_type_default_unit_and_range():
    plain, expert = parameter_tables(_Settings()).split("### For experts")
    assert "| `mode` | string | a |  | a, b | What to do. |" in plain
    assert "| `axes` | double[] | 1, 2 |  | at least 0.1 | Both axes. |" in plain
    assert "| `on` | bool | true |" in plain
    assert "| `inner.gain` | double | 0.5 | 1/s | 0 to 2 | Gain \\| of it. |" in expert
    assert "For experts" not in parameter_tables(_Inner())
