# SPDX-License-Identifier: Apache-2.0
"""Bit depth by the travelling block: against the simulated rig, and what is not known is not said."""

import numpy as np
import pytest

from mwd_sensors.core import wire
from mwd_sensors.simulator.scenario import read
from mwd_sensors.simulator.sonde import Sonde
from mwd_surface.live.input_monitor import BlockTrack
from project import ROOT

S = 1_000_000_000
BIT, BLOCK, SLIPS = 1, 4, 1024
NOT_BIT = np.uint32(2**32 - 1 - BIT)


def readings(blocks, *, slips=(), step_s=1.0, depth=None):
    """Rig data with block and slips, and a bit depth in the first row where one is given."""
    samples = wire.RIG_STATE.empty(len(blocks))
    samples["stamp_ns"] = S + np.round(np.arange(len(blocks)) * step_s * S).astype(np.int64)
    samples["block_position"], samples["valid"] = blocks, BLOCK | SLIPS
    samples["in_slips"] = [k in slips for k in range(len(blocks))]
    if depth is not None:
        samples["bit_depth"][0] = depth
        samples["valid"][0] |= BIT
    return samples


@pytest.mark.slow
def test_connections_of_the_simulated_rig_are_followed_by_the_block_alone():
    stand = [{"kind": "drill", "seconds": 60.0, "rop_m_h": 540.0}, {"kind": "connection", "seconds": 60.0}]
    changes = {"schedule": stand, "cycles": 2, "vibration": {}}
    scenario = read(ROOT / "mwd_sensors" / "scenarios" / "connections.yaml", changes)
    truth = np.concatenate([block["rig/state"] for block in Sonde(scenario, epoch_ns=S).blocks(1.0)])
    stands = int(np.sum(np.diff(truth["in_slips"].astype(int)) == 1))
    assert stands >= 2
    blind = truth.copy()
    blind["valid"][1:] &= NOT_BIT
    blind["bit_depth"][1:] = -1.0
    carried = BlockTrack().carry(blind)
    assert np.all(carried["valid"] & BIT)
    assert np.ptp(truth["bit_depth"]) > 10.0
    # What the string moves within the reading in which the slips are set or pulled: twice a stand.
    step = np.max(np.abs(np.diff(truth["bit_depth"])))
    assert np.max(np.abs(carried["bit_depth"] - truth["bit_depth"])) <= 2.0 * stands * step + 1e-6


def test_out_of_the_slips_the_bit_follows_the_block_and_in_them_it_stands():
    samples = readings([10.0, 9.0, 8.0, 20.0, 19.0], slips=(3,), depth=1000.0, step_s=4.5)
    samples["bit_depth"][1:] = np.nan
    assert list(BlockTrack().carry(samples)["bit_depth"]) == [1000.0, 1001.0, 1002.0, 1002.0, 1002.0]


def test_a_depth_by_hand_begins_at_the_next_reading():
    track = BlockTrack()
    track.carry(readings([10.0, 9.0], depth=1000.0))
    track.start(1200.0)
    assert list(track.carry(readings([7.0, 6.5]))["bit_depth"]) == [1200.0, 1200.5]


@pytest.mark.parametrize("wrong", ["gap", "leap", "no block", "backward"])
def test_what_happened_to_the_block_unseen_ends_the_track(wrong):
    samples = readings([10.0, 9.9, 9.8, 9.7], depth=1000.0)
    if wrong == "gap":
        samples["stamp_ns"][2:] += 6 * S
    elif wrong == "leap":
        samples["block_position"][2:] += 20.0
    elif wrong == "no block":
        samples["valid"][2] = SLIPS
    else:
        samples["stamp_ns"][2] = samples["stamp_ns"][0]
    track = BlockTrack()
    carried = track.carry(samples)
    assert [bool(row["valid"] & BIT) for row in carried] == [True, True, False, False]
    assert track.depth is None


def test_a_source_without_slips_or_with_depths_is_left_as_it_is():
    samples = readings([10.0, 9.0], depth=1000.0)
    samples["valid"] &= np.uint32(BIT | BLOCK)
    assert BlockTrack().carry(samples) is samples
    samples["valid"] |= BIT
    assert BlockTrack().carry(samples) is samples
