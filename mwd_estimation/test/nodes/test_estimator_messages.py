# SPDX-License-Identifier: Apache-2.0
"""Which estimates are published: all of a common unit, of a fast one as many as a listener can follow."""

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS is not installed for this Python")

from mwd_estimation.core.innovations import Innovation, of_power
from mwd_estimation.nodes.estimator import innovation_message, published_rows

START = 1_772_344_800_000_000_000


def places(stamps, cuts):
    found, last = [], -(10**9)
    for part in np.split(np.arange(len(stamps)), cuts):
        rows = published_rows(stamps[part], last)
        found += part[rows].tolist()
        if len(rows):
            last = int(stamps[part][rows[-1]])
    return found


def test_every_estimate_up_to_a_kilohertz_and_one_in_four_at_five():
    jitter = np.random.default_rng(2).integers(-90_000, 90_000, size=500)
    assert places(START + np.arange(500) * 1_000_000 + jitter // 2, []) == list(range(500))
    assert places(START + np.arange(500) * 10_000_000, [1, 2, 250]) == list(range(500))
    assert places(START + np.arange(500) * 200_000, []) == list(range(0, 500, 4))


def test_blocks_of_any_length_publish_the_same_and_time_may_go_back():
    stamps = START + np.concatenate([np.arange(300), np.arange(300)]) * 200_000
    for cuts in ([1, 2, 3, 5, 8, 13, 300], [299], [301, 302, 599], list(range(1, 600))):
        assert places(stamps, cuts) == places(stamps, [])
    assert 300 in places(stamps, [])


def test_innovations_keep_their_meaning_in_the_message():
    found = [Innovation("magnetic_field", 6.0, 4.0, 10, 2, 1), of_power("gravity_toolface", 4.0), of_power("x", 0.0)]
    message = innovation_message(found, START + 5, "sonde_link")
    field, gravity, none = message.sources
    assert (field.source, field.test_ratio, field.used, field.rejected, field.disturbed) == (
        "magnetic_field",
        2.25,
        10,
        2,
        1,
    )
    assert (gravity.innovation, gravity.gate, gravity.test_ratio) == (2.0, 0.0, 4.0)
    assert np.isnan([none.innovation, none.test_ratio]).all()
    assert (message.header.stamp.nanosec, message.header.frame_id) == (5, "sonde_link")
