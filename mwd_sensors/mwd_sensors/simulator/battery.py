# SPDX-License-Identifier: Apache-2.0
"""
Battery of the sonde and the state that its electronics report.

The battery has less capacity in cold and in heat. Each drawn charge is divided by the capacity at the temperature of
that moment, and the battery is empty when the sum of these shares is 1. The voltage is modelled on lithium thionyl
chloride cells: it is nearly constant until the charge is almost used, minus the voltage drop over the internal
resistance, which grows in the cold. The charge counter of the tool has a scale error that is constant in a simulation.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.settings import setting
from mwd_sensors.telemetry.tool_limits import Pack

_VOLTS_OF_CELL = 3.6  # voltage of a full lithium thionyl chloride cell, V
# Used share of the charge at which the voltage of a cell begins to fall, and the fall until the cell is empty, V.
_KNEE, _FALL_V = 0.9, 1.6
_DOUBLES_C = 20.0  # cooling below 25 degC that doubles the internal resistance, K
_VOLT_SIGMA, _AMPERE_SIGMA = 0.02, 0.005  # noise of the tool's voltmeter and ammeter, 1 sigma, V and A
_BITS = {name: bit for bit, name in wire.SELF_TESTS.items()}


@dataclasses.dataclass(frozen=True)
class SondeBattery(Pack):
    """Settings of the sonde's battery, of its current with pumps on and off, and of its self-tests."""

    cells: int = setting(8, "Number of cells in series.", low=1, high=100)
    resistance_ohm: float = setting(
        1.5,
        "Internal resistance of the battery at 25 degC. Raising it lowers the voltage under load.",
        unit="ohm",
        low=0.0,
        high=1000.0,
    )
    counter_error: float = setting(
        0.02, "1 sigma of the relative error of the charge counter, as a share.", low=0.0, high=0.5
    )
    run_h: float = setting(
        0.0, "Run time of the electronics before the run. Raising it starts with an emptier battery.", low=0.0
    )
    failures: tuple[tuple[float, str], ...] = setting(
        (), "Self-tests that fail. Each row has the time from which the test fails, s, and the name of the test."
    )

    def __post_init__(self) -> None:
        """Raise ValueError for settings that `Pack` refuses, or for an unknown self-test."""
        super().__post_init__()
        for _, name in self.failures:
            if name not in _BITS:
                raise ValueError(f"failures: unknown self-test {name!r}; choose one of {', '.join(_BITS)}")


class BatteryModel:
    """
    State of the battery in a simulation, and errors of the tool's meters.

    Parameters
    ----------
    rng : Generator
        Random numbers for the errors of the meters.
    """

    def __init__(self, settings: SondeBattery, rng: np.random.Generator) -> None:
        self.settings, self._rng = settings, rng
        self._scale = 1.0 + settings.counter_error * float(rng.standard_normal())
        #: Used share of the charge: 1 means that the battery is empty.
        self.used = settings.used_ah / settings.capacity_ah
        self._charge = settings.used_ah * 3600.0

    def samples(self, t: Array, stamps: Stamps, celsius: Array, active: Array, step_s: float = 1.0) -> Samples:
        """
        Return the state of battery and self-tests at the ends of time steps.

        Parameters
        ----------
        t : ndarray, shape (n,)
            End of each step, simulation time, s. Call this method for all steps in order.
        stamps : ndarray of int64, shape (n,)
            Stamps of the ends, ns since 1970.
        celsius : ndarray, shape (n,)
            Temperature, degC.
        active : ndarray of bool, shape (n,)
            Whether the pumps are on.
        step_s : float
            Length of a step.

        Returns
        -------
        ndarray of dtype `wire.TOOL_STATUS`
        """
        item = self.settings
        samples = wire.TOOL_STATUS.empty(len(t))
        for k, (at, warm, on) in enumerate(zip(t.tolist(), celsius.tolist(), active.tolist(), strict=True)):
            current = item.active_a if on else item.idle_a
            self._charge += current * step_s
            self.used += current * step_s / (3600.0 * item.capacity_ah * item.share(warm))
            volt, ampere = self._rng.standard_normal(2)
            samples["battery_voltage"][k] = max(0.0, self._voltage(current, warm) + _VOLT_SIGMA * volt)
            samples["battery_current"][k] = current + _AMPERE_SIGMA * ampere
            samples["consumed_charge"][k] = self._charge * self._scale
            failed = sum({_BITS[name] for begin, name in item.failures if at >= begin})
            samples["self_tests"][k], samples["failed_self_tests"][k] = sum(_BITS.values()), failed
            samples["run_time"][k] = item.run_h * 3600.0 + at
        samples["stamp_ns"] = stamps
        return samples

    def _voltage(self, current: float, celsius: float) -> float:
        fall = _FALL_V * min(1.0, max(0.0, (self.used - _KNEE) / (1.0 - _KNEE)))
        resistance = self.settings.resistance_ohm * math.pow(2.0, max(0.0, 25.0 - celsius) / _DOUBLES_C)
        return self.settings.cells * (_VOLTS_OF_CELL - fall) - current * resistance
