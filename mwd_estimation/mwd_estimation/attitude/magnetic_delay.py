# SPDX-License-Identifier: Apache-2.0
"""
Delay of the magnetometer's stamps relative to the IMU, estimated from changes of the rotary speed.

Gravity and field across the tool rotate together: seen from the tool, the angle between them depends only on the
attitude of the hole. If the field is stamped late by L, the field belongs to an earlier toolface, and the angle is
wrong by the rotary speed times L. A Kalman filter with two states, angle and delay, processes the mean angle of each
half second. At one speed, angle and delay cannot be separated; with two speeds they can. Errors of the field that
rotate with the tool average out over turns.

The speed is taken from the gyro, because the toolface also changes while a filter settles or an accelerometer fails. If
the gyro has no value, the rate of change of the toolface is used.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Array, Stamps

SPAN_NS = 5_000_000_000  #: duration of the span of samples that is evaluated at once, ns
_BIN_NS = 500_000_000
# Length of the end of a span that waits for the next span, ns, because its magnetic samples may not have arrived yet.
_OPEN_NS = _BIN_NS
# Longest step between gravity samples, ns, over which the toolface is interpolated.
_GAP_NS = 100_000_000
# Smallest cross-axis gravity, as a share of gravity, and smallest cross-axis field, T, with a usable direction.
_LEAST_GRAVITY, _LEAST_FIELD = 0.1, 5e-6
# Smallest resultant length of the angles of a bin, 0 to 1, with a meaningful mean; and smallest number of samples.
_LEAST_RESULTANT, _FEW = 0.7, 5
# 1 sigma of the angle of a bin, rad (the bias of a magnetometer does not average out over an incomplete turn); of the
# change of the angle from bin to bin, rad; and of the delay before any measurement, s.
_ANGLE, _WALK, _PRIOR_S = math.radians(2.0), math.radians(0.3), 0.2
# Correlation of two successive changes of the angle by steel: a string that passes steel takes some seconds, in which
# the angle changes the same way (`test_steel_that_the_string_leaves_as_it_starts_to_rotate_is_not_taken_for_a_delay`).
_SAME_WAY = 0.8
# Rotary speed below which the string counts as at rest, rad/s; and 1 sigma of the angle of a bin at rest, rad. At rest
# the bias of a magnetometer gives the same error in all bins: 20 bins (ten seconds) count as one with a sigma of 5 deg.
_RESTS, _REST_ANGLE = 0.5, math.radians(5.0) * math.sqrt(20.0)
# Rotation of the string, rad, over which an unchanged reading shows that the magnetometer is stuck.
_HANGS = 0.5
# Smallest delay that is corrected, s, and smallest number of its sigmas: at 120 r/min, 5 ms turn the field by 3.6 deg.
_LEAST_S, _SIGMAS = 0.005, 4.0
# A long delay is corrected as soon as its relative error is below this share; the remaining delay is corrected later.
_SHARE = 0.05
# Number of iterations over a span. Each iteration uses the mean speed over the delay of the previous one, because the
# speed may change within the delay.
_PASSES = 3
#: Longest plausible delay, s; a longer one is not corrected, because two different clocks are a more likely cause.
LONGEST_S = 0.5


def in_words(late_ns: int) -> str:
    """Return a sentence about the delay, ns, that was corrected; empty if the delay is 0."""
    way = "late" if late_ns > 0 else "early"
    found = (
        f"the magnetometer is stamped {abs(late_ns) * 1e-6:.0f} ms {way}, as the rotation of the string shows; "
        "the delay is corrected"
    )
    return found if late_ns else ""


class MagneticDelay:
    """Estimator of the delay from gravity and field in tool axes; it does not depend on how the streams are cut."""

    def __init__(self) -> None:
        self.begin_anew()
        self._mag: list[tuple[Stamps, Array]] = []
        self._bin = np.iinfo(np.int64).min
        self._last_b, self._hangs = np.full(2, np.nan), False

    def begin_anew(self) -> None:
        """Discard estimate and waiting gravity, for example after wrong rates; keep the waiting magnetic samples."""
        self._angle, self._begun = 0.0, False
        self._field, self._moved = np.full(2, np.nan), 0.0
        self._P = np.diag([math.pi**2, _PRIOR_S**2])
        self.delay_s = 0.0  #: delay that remains in the corrected stamps, s
        self._imu: list[tuple[Stamps, Array]] = []

    @property
    def sigma_s(self) -> float:
        """1 sigma of the delay, s."""
        return math.sqrt(self._P[1, 1])

    def take(self, stamps: Stamps, g_t: Array, rate_x: Array) -> None:
        """
        Accept unit vectors down in tool axes, shape (n, 3), and rates about x, rad/s, shape (n,); NaN if unknown.

        stamps: ns, shape (n,); they must increase, also from one call to the next.
        """
        if len(stamps):
            self._imu.append((stamps, np.column_stack([g_t[:, 1:], rate_x])))

    def take_mag(self, stamps: Stamps, b_t: Array) -> None:
        """Accept stamps, ns, shape (n,), and samples of the field in tool axes, T, shape (n, 3)."""
        self._mag.append((stamps, np.roll(b_t, -1, axis=1)))

    def shift(self, late_ns: int) -> None:
        """Subtract late_ns from the stamps of waiting magnetic samples; the caller must correct later samples."""
        self._mag = [(stamps - late_ns, b) for stamps, b in self._mag]
        self.delay_s -= 1e-9 * late_ns

    def judge(self, end_ns: int) -> int:
        """
        Evaluate all samples up to half a second before a stamp; end_ns: stamp.

        Returns the delay to correct, ns; 0 if it is too small, too uncertain or implausible.
        """
        if self._imu and self._mag:
            self._follow(end_ns - _OPEN_NS)
        # Drop samples that are not followed by a magnetic sample.
        self._imu = self._imu if self._mag else []
        late_s, sigma_s = abs(self.delay_s), self.sigma_s
        sure = sigma_s < max(_LEAST_S, _SHARE * late_s) and late_s > max(_LEAST_S, _SIGMAS * sigma_s)
        return round(self.delay_s * 1e9) if sure and late_s < LONGEST_S else 0

    def _follow(self, until_ns: int) -> None:
        """Update angle and delay with all bins that end before a stamp, ns."""
        # Columns of g: gravity across the tool (2), rate about x. Columns of b: field across the tool (2) and along it.
        stamps, g = (np.concatenate(parts) for parts in zip(*self._imu, strict=True))
        at, b = (np.concatenate(parts) for parts in zip(*self._mag, strict=True))
        last = until_ns // _BIN_NS
        known = np.isfinite(g[:, :2]).all(axis=1) & (np.hypot(g[:, 0], g[:, 1]) > _LEAST_GRAVITY)
        new = (at // _BIN_NS > self._bin) & (at // _BIN_NS < last)
        if known.sum() > 1 and new.any():
            turned, when = np.unwrap(np.arctan2(g[known, 0], g[known, 1])), stamps[known]
            speed = np.where(np.isnan(g[known, 2]), np.gradient(turned, 1e-9 * (when - when[0])), g[known, 2])
            spun = np.cumsum(speed * np.diff(when, prepend=when[0]) * 1e-9)
            seen = np.isfinite(b).all(axis=1) & (np.hypot(b[:, 0], b[:, 1]) > _LEAST_FIELD) & _beside(when, at)
            seen &= new
            seen[new] &= self._measured(b[new, :2], np.interp(at[new], when, spun))
            down = np.interp(at[seen], when, turned)
            rate = np.interp(at[seen], when, speed)
            now = np.interp(at[seen], when, spun)
            field = np.column_stack([np.hypot(b[seen, 0], b[seen, 1]), b[seen, 2]])
            begun, covariance = (self._angle, self._begun, self.delay_s, self._field, self._moved), self._P
            for _ in range(_PASSES):
                self._angle, self._begun, self.delay_s, self._field, self._moved = begun
                self._P = covariance.copy()
                self._take_bins(at[seen] // _BIN_NS, np.arctan2(b[seen, 0], b[seen, 1]) - down, rate, field)
                if abs(self.delay_s) < _LEAST_S:
                    break
                earlier = at[seen] - round(self.delay_s * 1e9)
                # Use the mean speed over the delay; keep the present speed if the rotation over the delay is not known
                # (before the first sample or across a gap).
                over = (now - np.interp(earlier, when, spun)) / self.delay_s
                rate = np.where(_beside(when, earlier), over, rate)
        self._bin = last - 1
        keep = stamps // _BIN_NS >= last - 2
        self._imu = [(stamps[keep], g[keep])]
        keep = at // _BIN_NS >= last
        self._mag = [(at[keep], b[keep])]

    def _measured(self, b: Array, spun: Array) -> NDArray[np.bool_]:
        """
        Return a mask of the magnetic samples that are not stuck, shape (n,).

        Samples are stuck if they are equal while the string turns, also over the border between two calls. b: field
        across the tool, T, shape (n, 2); spun: angle of the string, rad, shape (n,).
        """
        same = np.array([*(b[:1] == self._last_b).all(axis=1), *(b[1:] == b[:-1]).all(axis=1)])
        begin = np.maximum.accumulate(np.where(same, 0, np.arange(len(b))))
        hangs = (np.abs(spun - spun[begin]) > _HANGS) | (same[begin] & self._hangs)
        self._last_b, self._hangs = b[-1], bool(hangs[-1])
        return ~hangs

    def _take_bins(self, bins: Stamps, angle: Array, rate: Array, field: Array) -> None:
        for part in np.split(np.arange(len(bins)), np.flatnonzero(np.diff(bins)) + 1):
            if len(part) < _FEW:
                continue
            mean = complex(np.exp(1j * angle[part]).mean())
            if abs(mean) > _LEAST_RESULTANT:
                self._walk_with(field[part].mean(axis=0))
                self._update(float(np.angle(mean)), float(rate[part].mean()))

    def _walk_with(self, field: Array) -> None:
        """
        Increase the variance of the angle by the change of the field since the last bin.

        field, shape (2,): strength of the field across the axis and component along the axis, T.

        A magnetic disturbance near the hole turns the cross-axis field by an angle, rad, of about the relative change
        of the field. The changes are correlated from bin to bin, so their variance grows faster than that of a random
        walk.
        """
        changed = float(np.hypot(*(field - self._field))) / float(field[0])
        self._field = field
        if self._begun and math.isfinite(changed):
            earlier = _SAME_WAY * self._moved
            self._P[0, 0] += changed * (changed + 2.0 * earlier)
            self._moved = earlier + changed

    def _update(self, angle: float, rate: float) -> None:
        """
        Update angle and delay with one bin; if the innovation is above 3 sigmas, restart the angle first.

        angle: mean measured angle of the bin, rad, which is expected to be the state of the angle minus rate times
        delay; rate: mean rotary speed of the bin, rad/s.
        """
        P = self._P
        P[0, 0] = min(P[0, 0] + _WALK**2, math.pi**2) if self._begun else math.pi**2
        h, noise = np.array([1.0, -rate]), (_ANGLE if abs(rate) > _RESTS else _REST_ANGLE) ** 2
        innovation = math.remainder(angle - self._angle + rate * self.delay_s, 2.0 * math.pi)
        gain = P @ h
        variance = float(h @ gain) + noise
        if self._begun and innovation**2 > 9.0 * variance:
            # The attitude or the interference has changed: restart the estimate of the angle, and keep the delay.
            P[0, 0], P[0, 1], P[1, 0] = math.pi**2, 0.0, 0.0
            gain = P @ h
            variance = float(h @ gain) + noise
        self._begun = True
        self._angle += gain[0] / variance * innovation
        self.delay_s += gain[1] / variance * innovation
        P -= np.outer(gain, gain) / variance


def _beside(stamps: Stamps, at: Stamps) -> NDArray[np.bool_]:
    """Return a mask of the times `at`, ns, that lie between two stamps which are less than `_GAP_NS` apart."""
    right = np.searchsorted(stamps, at).clip(1, len(stamps) - 1)
    return np.asarray((stamps[right] - stamps[right - 1] < _GAP_NS) & (at >= stamps[0]) & (at <= stamps[-1]))
