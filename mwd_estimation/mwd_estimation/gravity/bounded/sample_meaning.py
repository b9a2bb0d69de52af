# SPDX-License-Identifier: Apache-2.0
"""
Detect from the innovations that samples are points (values at an instant) although the settings say integrated.

An integrated rate gives the rotation from one sample to the next, and the force belongs to the end of this interval.
Rates at an instant give the rotation by the trapezoid between two samples, and means belong to the middle of the
interval. With the wrong assumption the roll is off by the rate about the axis times half an interval: 4.7 deg at 155
r/min and 100 Hz. While the rate is constant this angle is part of the initial roll; when the rate changes, it appears
in the innovations. Integrated samples (the default of the settings) and points are two hypotheses. The errors that the
state has if the samples are points are propagated together with the covariance, so each innovation updates the odds of
the two (Willsky and Jones, 1976, see `jumps`). Means and values at an instant cannot be distinguished in this way.
If the settings are points or means, they are not checked: aliased vibration in points can look like a wrong setting.
"""

from __future__ import annotations

from mwd_estimation.gravity.bounded import measurement, mechanisation
from mwd_estimation.gravity.bounded.state import ERRORS, LEVER, POS, STEADY, TILT, BoundedRecord, forget_density
from mwd_sensors.core.compiled import compiled

SURE = 3.0  # samples count as points if the logarithm of the odds for points exceeds this
LEAST_DENSITY = 0.5  # lower limit of the density of the innovations, by which their weight in the odds is divided


def in_words(found: str) -> str:
    """
    Return a warning that the samples are not strapdown-integrated although the settings say so; "" if `found` is "".

    found: kind of the samples that the filter detected (`BoundedState.samples_are`).
    """
    if not found:
        return ""
    return (
        "the samples are values at an instant or means, not strapdown-integrated, as changes of the rotary speed show, "
        f"and are used as {found}; set tool.samples: {found} (or means, if the data sheet says so)"
    )


@compiled
def _integrated(s: BoundedRecord) -> bool:
    """Return whether the filter assumes integrated samples."""
    return bool(s.meaning.coning == 0.0 and not s.meaning.sampled)


@compiled
def propagate(s: BoundedRecord, rate: float) -> None:
    """
    Propagate the errors that the state has if the samples are points (`Meaning.effect`) over one update interval.

    rate: newest rate about the x axis, rad/s.
    """
    if not _integrated(s):
        return
    effect = s.meaning.effect
    roll = 0.5 * s.period * (s.tick_w[0] - rate)
    # The rate changes during the interval: add half of the roll error before the transition and half after it.
    for j in range(2):
        effect[TILT + j, 0] += 0.5 * roll * s.C[j, 0]
    mechanisation.carry_columns(effect, s.sums, 1, False)
    for j in range(2):
        effect[TILT + j, 0] += 0.5 * roll * s.C[j, 0]


@compiled
def compare(s: BoundedRecord) -> None:
    """Update the odds of point samples, and the errors that they would have caused, with the last innovations."""
    if not _integrated(s):
        return
    effect, last = s.meaning.effect, s.latest
    for axis in range(3):
        expected = last.measured[axis, TILT] * effect[TILT, 0] + last.measured[axis, TILT + 1] * effect[TILT + 1, 0]
        for j in range(3):
            expected += last.measured[axis, POS + j] * effect[POS + j, 0]
        if axis > 0:
            expected -= effect[LEVER + axis - 1, 0]
        for j in range(STEADY):
            effect[j, 0] -= last.gain[axis, j] * expected
        density = max(s.innovations.density[axis], LEAST_DENSITY)
        s.meaning.odds += expected * (last.innovation[axis] - 0.5 * expected) / (last.spread[axis] * density)


@compiled
def follow(s: BoundedRecord) -> None:
    """Process samples as points from here on if points are much more probable, and correct the state for the change."""
    meaning = s.meaning
    if meaning.odds < SURE or not _integrated(s):
        return
    for j in range(ERRORS):
        s.correction[j] = meaning.effect[j, 0] if j < STEADY else 0.0
    measurement.correct(s, STEADY)
    meaning.sampled = meaning.changed = True
    meaning.coning = 1.0
    # Discard the statistics of earlier innovations, which belong to integrated samples.
    s.epoch += 1
    forget_density(s)
