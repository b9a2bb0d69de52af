# SPDX-License-Identifier: Apache-2.0
"""
Meaning of a sample, found from the innovations: strapdown-integrated over its interval, or not.

An integrated rate turns the tool from one sample to the next, and the force belongs to the end of this interval. Rates
at an instant turn the tool by the trapezoid between two samples, and means belong to the middle of the interval. With
the wrong one of the two the roll is off by the rate about the axis times half an interval: 4.7 deg at 155 r/min and 100
Hz. While the rate is constant, the start of the filter has taken this angle into the roll; when it changes, the
innovations show it. The statement of the settings and its opposite are two hypotheses. The effect of the opposite on
all errors is carried beside the covariance, so that each innovation adds to the odds of the two (Willsky and Jones,
1976, see `bias_step`). Means and values at an instant cannot be told apart in this way.
"""

from __future__ import annotations

from mwd_estimation.gravity.bounded import measurement, mechanisation
from mwd_estimation.gravity.bounded.state import ERRORS, STEADY, TILT, Record, Update, forget_density
from mwd_sensors.core.compiled import compiled

SURE = 3.0  # the meaning changes if the logarithm of the odds of the other one exceeds this
LEAST_DENSITY = 0.5  # least density of the innovations by which they are weighted


def in_words(found: str) -> str:
    """Return a sentence about `State.samples_are`; empty if the data do not contradict the settings."""
    if not found:
        return ""
    shown, advice = (
        ("strapdown-integrated", "integrated")
        if found == "integrated"
        else ("values at an instant or means, not strapdown-integrated", "points (or means, if its data sheet says so)")
    )
    return f"the samples are {shown}, as changes of the rotary speed show, and are used so; set tool.samples: {advice}"


@compiled
def propagate(s: Record, rate: float) -> None:
    """Propagate the effect of the other meaning over the sums since the last update; rate: latest x rate, rad/s."""
    effect, other = s.meaning.effect, 1.0 if s.meaning.coning == 0.0 and not s.meaning.sampled else -1.0
    roll = other * 0.5 * s.period * (s.tick_w[0] - rate)
    # The rate changes within the interval: half of the roll counts for all of it.
    for j in range(2):
        effect[TILT + j, 0] += 0.5 * roll * s.C[j, 0]
    mechanisation.carry_columns(effect, s.sums, 1, False)
    for j in range(2):
        effect[TILT + j, 0] += 0.5 * roll * s.C[j, 0]


@compiled
def compare(s: Record, axis: int, entry: Update) -> None:
    """Add the last innovation, along a tool axis, to the odds, and apply its correction to the effect."""
    effect, expected = s.meaning.effect, 0.0
    for j in range(STEADY):
        expected += entry.measured[axis, j] * effect[j, 0]
    for j in range(STEADY):
        effect[j, 0] -= entry.gain[axis, j] * expected
    density = max(s.innovations.density[axis], LEAST_DENSITY)
    s.meaning.odds += expected * (s.innovation - 0.5 * expected) / (s.spread * density)


@compiled
def follow(s: Record) -> None:
    """Change the meaning of the samples if the other one is more probable, and correct the state by its effect."""
    meaning = s.meaning
    if meaning.odds < SURE:
        return
    for j in range(ERRORS):
        s.correction[j] = meaning.effect[j, 0] if j < STEADY else 0.0
    if meaning.coning > 0.0 and not meaning.sampled:
        # The forces were turned by half an interval, and not the attitude.
        for j in range(2):
            s.correction[TILT + j] -= 0.5 * s.period * s.last_w[0] * s.C[j, 0]
    measurement.correct(s, STEADY)
    meaning.sampled = meaning.coning == 0.0 and not meaning.sampled
    meaning.coning = 1.0 if meaning.sampled else 0.0
    meaning.odds = -meaning.odds
    meaning.changed = not meaning.changed
    # Earlier innovations belong to the other meaning.
    s.epoch += 1
    forget_density(s)
