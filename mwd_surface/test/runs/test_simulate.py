# SPDX-License-Identifier: Apache-2.0
"""A scenario recorded without middleware: the sonde's samples, in the sonde's topics."""

import numpy as np
import pytest

from mwd_sensors.core import wire
from mwd_sensors.simulator.scenario import parse
from mwd_sensors.simulator.sonde import Sonde
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.runs.simulate import record

SCENARIO = parse("{name: short, schedule: [{kind: still, seconds: 2.0}]}")


def test_the_bag_holds_every_sample_of_the_sonde(tmp_path):
    shares = []
    count, seconds = record(SCENARIO, tmp_path / "bag", "well_3", b"source", shares.append)
    block = next(Sonde(SCENARIO).blocks(10.0))
    assert seconds == Sonde(SCENARIO).duration
    assert shares[-1] == 1.0
    with Bag(tmp_path / "bag") as bag:
        assert bag.message_count == count == sum(len(samples) for samples in block.values())
        for name, layout in wire.SONDE_TOPICS.items():
            topic = f"/well_3/{name}"
            assert bag.topics[topic].type_name == layout.type_name
            read = np.concatenate([part[topic][1] for part in bag.blocks([topic])])
            assert (read == block[name]).all()
        assert bag.attachments()[0].data == b"source"


def test_a_bag_that_exists_is_not_overwritten(tmp_path):
    (tmp_path / "bag").mkdir()
    with pytest.raises(FileExistsError, match="exists already"):
        record(SCENARIO, tmp_path / "bag")
