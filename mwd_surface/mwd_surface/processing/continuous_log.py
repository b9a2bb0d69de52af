# SPDX-License-Identifier: Apache-2.0
"""Continuous inclination and azimuth over depth: the attitude of a processed run paired with the depths of the rig."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.status import Status, words
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Array, Stamps
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.processing import run_folder
from mwd_surface.trajectory.dense_trajectory import Continuous

# Largest distance of the bit from its greatest depth so far, m, at which the bit counts as on bottom.
_ON_BOTTOM = 0.3
# Time to ignore after the start and before the end of each movement of the string, s: the acceleration of the string
# along the hole tilts the measured inclination.
_SETTLES = 10.0
# Longest gap in the rig's data that is bridged, s.
_LONGEST_GAP = 60.0


def continuous_log(folder: Path, bag: Bag, sensor_to_bit: float) -> Continuous:
    """
    Return measured depth, inclination and azimuth of the samples taken while new hole was drilled.

    Samples for which the estimator did not know the direction of gravity yet are left out: their angles are arbitrary.

    Parameters
    ----------
    folder : Path
        Results of `mwd process`.
    bag : Bag
        The processed recording, with the state of the rig.
    sensor_to_bit : float
        Distance from sensor to bit, m.

    Raises
    ------
    BagError
        The recording has fewer than two valid depths of the rig.
    OSError, ValueError
        See `run_folder.attitude`.
    """
    stamps, bit = _bit_depths(bag)
    parts: list[tuple[Array, Array, Array]] = []
    for block in run_folder.attitude(folder):
        depth = drilled_depth(stamps, bit, block["stamp_ns"])
        used = np.isfinite(depth) & _directed(block["status"])
        angles = np.radians(block["inclination_deg"][used]), np.radians(block["azimuth_deg"][used])
        parts.append((depth[used] - sensor_to_bit, *angles))
    md, inclination, azimuth = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Continuous(md, inclination, azimuth)


def _directed(status: NDArray[Any]) -> NDArray[np.bool_]:
    """Return whether the estimator knew the direction of gravity, from the words of each sample, shape (n,)."""
    word = words(Status.INITIALISING)
    return np.array([word not in one.split("|") for one in status], dtype=bool)


def drilled_depth(stamps_ns: Stamps, bit_depth: Array, at_ns: Stamps) -> Array:
    """
    Return the bit depth at times at which new hole is drilled steadily.

    Parameters
    ----------
    stamps_ns, bit_depth : ndarray, shape (n,), n >= 2
        Reports of the rig in order of time; ns and m.
    at_ns : ndarray, shape (m,)
        Times.

    Returns
    -------
    ndarray, shape (m,)
        Bit depth, m; nan off bottom, at rest, in a gap of the rig's data and in the first and last seconds of a
        movement.
    """
    after = np.clip(np.searchsorted(stamps_ns, at_ns), 1, len(stamps_ns) - 1)
    depth = np.interp(at_ns, stamps_ns, bit_depth)
    deepest = np.maximum.accumulate(bit_depth)
    advances = np.diff(bit_depth) > 0.0
    # Stamps at which the movement containing each interval began and ended.
    began = np.where(advances & ~np.concatenate([[False], advances[:-1]]), stamps_ns[:-1], stamps_ns[0])
    began = np.maximum.accumulate(began)
    ended = np.where(advances & ~np.concatenate([advances[1:], [False]]), stamps_ns[1:], stamps_ns[-1])
    ended = np.minimum.accumulate(ended[::-1])[::-1]
    used = advances[after - 1] & (at_ns >= stamps_ns[0]) & (at_ns <= stamps_ns[-1])
    used &= (stamps_ns[after] - stamps_ns[after - 1]) * 1e-9 <= _LONGEST_GAP
    used &= depth >= deepest[after - 1] - _ON_BOTTOM
    used &= np.minimum(at_ns - began[after - 1], ended[after - 1] - at_ns) * 1e-9 >= _SETTLES
    return np.where(used, depth, np.nan)


def _bit_depths(bag: Bag) -> tuple[Stamps, Array]:
    """
    Return stamps, ns, and bit depths, m, of the rig's messages with a valid depth, in order of time.

    Raises BagError if there are fewer than two such messages.
    """
    topic = bag.find_topic(wire.RIG_STATE.type_name, "rig/state")
    rows = [block[topic][1] for block in bag.blocks([topic]) if topic in block]
    if rows:
        rig = np.concatenate(rows)
        known = rig["valid"] & wire.RIG_VALID["bit_depth"] != 0
        rig = rig[known & np.isfinite(rig["bit_depth"]) & (rig["bit_depth"] >= 0.0)]
        rig = rig[np.argsort(rig["stamp_ns"], kind="stable")]
        if len(rig) > 1:
            return np.asarray(rig["stamp_ns"]), np.asarray(rig["bit_depth"])
    raise BagError(f"{bag.path} has no depths of the rig", "give the continuous data as a table with --continuous")
