# SPDX-License-Identifier: Apache-2.0
"""Measuring unit of the sonde: gyros and accelerometers, from true inputs to output samples."""

from __future__ import annotations

import math

import numpy as np

from mwd_sensors.core import input_covariance, wire
from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.simulator import instrument
from mwd_sensors.simulator.instrument_grade import grade
from mwd_sensors.simulator.scenario import Unit


class MeasuringUnit:
    """
    Gyros and accelerometers of one unit with their randomly drawn errors.

    Parameters
    ----------
    unit : Unit
        Grade, lever arm and output of the unit.
    step, rate : int
        Rate of the kinematics and of the output, Hz.
    draw, run : Generator
        Random numbers of the tool's constant errors, and of noise and drift during the run.

    Attributes
    ----------
    margin : int
        Number of kinematic samples needed before and after each output.
    gyro_bias, accel_bias : ndarray, shape (3,)
        Slow bias at the last output, rad/s and m/s^2.
    """

    def __init__(self, unit: Unit, step: int, rate: int, draw: np.random.Generator, run: np.random.Generator) -> None:
        self.grade = grade(unit.grade, unit.changes)
        self.lever_t = np.array(unit.lever_mm) * 1e-3
        self.gyro = instrument.gyro_triad(self.grade.gyro, draw)
        self.accelerometer = instrument.accelerometer_triad(self.grade.accelerometer, draw)
        gyro, accelerometer = self.grade.gyro, self.grade.accelerometer
        self._gyro_weights = instrument.low_pass(gyro.bandwidth_hz, gyro.delay_ms * 1e-3, step)
        self._accel_weights = instrument.low_pass(accelerometer.bandwidth_hz, accelerometer.delay_ms * 1e-3, step)
        self.margin = max(len(self._gyro_weights), len(self._accel_weights)) // 2
        self._integrated = unit.output == "integrated"
        # A single sample has noise of the sensor's own bandwidth; noise that is integrated has the converter's full
        # bandwidth.
        full = float(self.grade.adc_hz)
        self._gyro_band = full if self._integrated else instrument.noise_band(gyro.bandwidth_hz, full)
        self._accel_band = full if self._integrated else instrument.noise_band(accelerometer.bandwidth_hz, full)
        self._stride = step // self.grade.adc_hz
        self._ratio = self.grade.adc_hz // rate
        self._rate = rate
        self._run = run
        self._gyro_state = instrument.initial(self.gyro, run)
        self._accel_state = instrument.initial(self.accelerometer, run)
        self.gyro_bias = instrument.slow_bias(self.gyro, self._gyro_state, 0.0)
        self.accel_bias = instrument.slow_bias(self.accelerometer, self._accel_state, 0.0)

    def samples(self, rate_it: Array, f_t: Array, margin: int, stamps: Stamps, warm: float, gravity: float) -> Samples:
        """
        Return the output of one step, dtype of `wire.IMU`.

        Parameters
        ----------
        rate_it, f_t : ndarray, shape (n, 3)
            True rate and specific force at the unit, at the kinematic rate and with margins, rad/s and m/s^2.
        margin : int
            Number of samples before the step.
        stamps : ndarray, shape (m,)
            Stamps of the outputs, ns.
        warm : float
            Temperature minus that of the calibration, degC.
        gravity : float
            Strength of gravity, m/s^2.
        """
        outputs = len(stamps)
        count = outputs * self._ratio
        first = margin + (self._stride // 2 if self._integrated else self._stride)
        rate, force = np.empty((count, 3)), np.empty((count, 3))
        instrument.filtered(rate_it, self._gyro_weights, first, self._stride, rate)
        instrument.filtered(f_t, self._accel_weights, first, self._stride, force)
        seconds = outputs / self._rate
        instrument.advance(self.gyro, self._gyro_state, seconds, self._run)
        instrument.advance(self.accelerometer, self._accel_state, seconds, self._run)
        self.gyro_bias = instrument.slow_bias(self.gyro, self._gyro_state, warm)
        self.accel_bias = instrument.slow_bias(self.accelerometer, self._accel_state, warm)
        errors = self.gyro.converter(self.gyro_bias, warm)
        rate_read = self._convert(self.gyro, errors, rate, force, gravity, self._gyro_band)
        errors = self.accelerometer.converter(self.accel_bias, warm)
        force_read = self._convert(self.accelerometer, errors, force, force, gravity, self._accel_band)
        if self._integrated:
            rate_out, force_out = np.empty((outputs, 3)), np.empty((outputs, 3))
            instrument.strapdown(rate_read, force_read, self._ratio, 1.0 / self.grade.adc_hz, rate_out, force_out)
            gyro_band = accel_band = float(self._rate)
        else:
            gyro_band, accel_band = self._gyro_band, self._accel_band
            rate_out, force_out = rate_read[self._ratio - 1 :: self._ratio], force_read[self._ratio - 1 :: self._ratio]
        samples = wire.IMU.empty(outputs)
        samples["stamp_ns"] = stamps
        # No orientation is measured (REP-145).
        samples["orientation_covariance"][:, 0] = -1.0
        samples["angular_velocity"], samples["linear_acceleration"] = rate_out, force_out
        samples["angular_velocity_covariance"][:, ::4] = self.gyro.noise**2 * gyro_band + self.gyro.step**2 / 12.0
        accel = self.accelerometer
        samples["linear_acceleration_covariance"][:, ::4] = accel.noise**2 * accel_band + accel.step**2 / 12.0
        if self.grade.flags_clipping:
            for vector, triad, read in (
                ("angular_velocity", self.gyro, rate_read),
                ("linear_acceleration", self.accelerometer, force_read),
            ):
                at_limit = (np.abs(read) >= triad.limit - triad.step).reshape(outputs, self._ratio, 3)
                input_covariance.mark_clipped(samples, vector, np.asarray(at_limit.any(axis=1)))
        return samples

    def _convert(
        self, triad: instrument.Triad, errors: instrument.Converter, x: Array, force: Array, gravity: float, band: float
    ) -> Array:
        noise = triad.noise * math.sqrt(band) * self._run.standard_normal(x.shape)
        out = np.empty_like(x)
        instrument.convert(errors, x, force, gravity, noise, out)
        return out
