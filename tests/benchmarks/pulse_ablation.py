# SPDX-License-Identifier: Apache-2.0
"""
Ablation of the pulse receiver: its figures on the channel of `other_mud.py` without one ingredient after the other.

`pulse_ablation.py --width 0.3 --depth 4000 --seeds 9800 9856` writes the rows of the table in
docs/methods/pulse_receiver.md.
"""

from __future__ import annotations

import argparse
import contextlib
import math
from collections.abc import Iterator
from typing import Any
from unittest import mock

import numpy as np
import other_mud

from mwd_sensors.core.arrays import Array
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver import grid, pump_lines
from mwd_surface.receiver.pulse import passes, pulse_receiver, segment, survey_memory, synchronisation, tracker
from mwd_surface.receiver.pulse import transmission as sent
from mwd_surface.receiver.words import BELIEVED

SURVEY = (
    "Inc:12:P Azm:12:P DipA:12:P Temp:8:P Grav:12:P MagF:12:P BatV:8:P RINC:12:P RAZM:12:P Gama:8:P aTFA:8:P mTFA:12:P"
    " LRMS:12:P ARMS:12:P"
)
# Word error of a receiver that knows the channel, for which the valve is set: pulse width, s, and depth, m.
LIMITS = {(0.8, 5000): 0.013, (0.5, 4000): 0.023, (0.5, 5000): 0.153, (0.3, 3000): 0.009, (0.3, 4000): 0.125}
LOST = math.log(4096.0)  # negative log likelihood of a word that was not received

_pumps, _sync = pump_lines.pump_noise, synchronisation._found


def _alone(*arguments: Any) -> Any:
    found = _sync(*arguments)
    return found and synchronisation.dataclasses.replace(found, other=None)


def _chosen(noise: Array, known: Array, memory: float = pump_lines.SEARCH_SAMPLES, angles: Array | None = None) -> Any:
    cranks = [pump_lines.crank(angle) for angle in (() if angles is None else angles)]
    return pump_lines.lines(noise, known, memory, cranks), cranks


# Each ingredient with what replaces it: owner, name, replacement.
INGREDIENTS: dict[str, tuple[tuple[Any, str, Any], ...]] = {
    "several hypotheses": ((tracker, "_MOST", 1),),
    "second decoding of a whole pass": ((sent.ReceivedTransmission, "_decode_again", lambda *_: None),),
    "third round of a decoding": ((segment, "_ROUNDS", 2),),
    "unsure places: response": ((segment, "spread", lambda pairs, u: np.zeros((*pairs.shape[:-1], len(u), len(u)))),),
    "unsure places: noise": ((segment, "_unsure", lambda *_: np.zeros(segment.ORDER + 2)),),
    "weights of disturbed samples": ((segment, "precision", lambda _, known: known.copy()),),
    "temperature of disturbances": ((passes, "_TEMPERATURES", (1.0, 1.0)),),
    "share of missing pulses learnt": ((sent, "_MOST_MISSING", segment.MISSING),),
    "second pulse in a window": ((segment, "_EXTRA", 1e-12),),
    "absolute fit": ((segment, "_fits", lambda stretch, *_: np.full((len(stretch.packets), 3), np.nan)),),
    "size of the sync": ((segment, "_sync_size", lambda *_: (1.0, math.inf)),),
    "clock followed": ((sent.ToolClock, "followed", lambda clock, *_: clock),),
    "two priors of the clock": ((sent, "_CLOCKS", sent._CLOCKS[:1] * 2),),
    "pump lines without strokes": ((pump_lines, "_MOST_LINES", 0),),
    "strokes": tuple((x, "pump_noise", lambda *a, **_: _pumps(*a[:3])) for x in (segment, synchronisation)),
    "smoothing of strokes": ((grid, "_without_jitter", lambda times, _: times),),
    "choice with or without strokes": tuple((x, "pump_noise", _chosen) for x in (segment, synchronisation)),
    "next best sync": ((synchronisation, "_found", _alone),),
    "sizes of the pulses of a sync": ((synchronisation, "_alike", lambda *_: True),),
    "transient of starting pumps": ((synchronisation, "_settled", lambda _: 0),),
    "noise model without the sync": ((synchronisation, "_ROUNDS", 0),),
    "threshold where a sync is expected": ((synchronisation, "EXPECTED_THRESHOLD", synchronisation.THRESHOLD),),
    "earlier surveys": ((survey_memory.SurveyMemory, "settle", lambda _, words: words),),
}


@contextlib.contextmanager
def without(name: str) -> Iterator[None]:
    """Leave out an ingredient; an empty name leaves out none."""
    with contextlib.ExitStack() as stack:
        for owner, attribute, replacement in INGREDIENTS.get(name, ()):
            stack.enter_context(mock.patch.object(owner, attribute, replacement))
        yield


def figures(mud: other_mud.OtherMud, tool: ToolConfiguration, frames: list[other_mud.Frame]) -> Array:
    """Return for each word of each frame: wrong, negative log likelihood, believed, believed and wrong."""
    rows = []
    for frame in frames:
        words = pulse_receiver.decode(tool, frame.time_s, frame.pressure_pa, frame.strokes).words
        for name, code, at in frame.words:
            near = [one for one in words if one.name == name and abs(one.start_s - at - mud.depth_m / mud.speed) < 1.2]
            if not near:
                rows.append((True, LOST, False, False))
                continue
            word, known = near[0], dict(near[0].alternatives) | {near[0].raw: near[0].confidence}
            wrong, believed = word.raw != code, word.status == BELIEVED
            rest = max(1.0 - sum(known.values()), 1e-4) / 100.0
            rows.append((wrong, -math.log(max(known.get(code, rest), 1e-4)), believed, believed and wrong))
    return np.array(rows, dtype=float).reshape(len(frames), -1, 4)


def main() -> None:
    """Print a row for the whole receiver and for each ingredient that is left out."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--width", type=float, default=0.3, help="pulse width, s")
    parser.add_argument("--depth", type=float, default=4000.0, help="depth, m")
    parser.add_argument("--seeds", type=int, nargs=2, default=(9800, 9856), help="first seed, and seed after the last")
    options = parser.parse_args()
    mud = other_mud.OtherMud(depth_m=options.depth)
    tool = ToolConfiguration(pulse_width_s=options.width, transmit_delay_s=30.0, survey_sequences=(SURVEY,))
    valve = other_mud.valve_pa(mud, tool, LIMITS[options.width, round(options.depth)])
    frames = [other_mud.frame(mud, tool, valve, seed, missed=0.05) for seed in range(*options.seeds)]
    whole = figures(mud, tool, frames)
    for name in ("", *INGREDIENTS):
        with without(name):
            found = figures(mud, tool, frames) if name else whole
        # Both runs have the same frames, so the scatter is that of the difference of each frame.
        change = (found - whole).mean(axis=1)
        sigma = change.std(axis=0) / math.sqrt(len(frames))
        cells = [f"{found[..., k].mean():.3f} ({change[:, k].mean():+.3f} +- {sigma[k]:.3f})" for k in (0, 1)]
        believed = f"{found[..., 3].sum():.0f} of {found[..., 2].sum():.0f}"
        print(f"| {name or 'whole receiver'} | {' | '.join(cells)} | {believed} |", flush=True)


if __name__ == "__main__":
    main()
