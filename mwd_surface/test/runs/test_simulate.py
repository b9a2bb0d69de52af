# SPDX-License-Identifier: Apache-2.0
"""A scenario recorded without middleware: the sonde's samples, in the sonde's topics."""

import numpy as np
import pytest

from mwd_sensors.core import wire
from mwd_sensors.simulator.scenario import parse
from mwd_sensors.simulator.sonde import Sonde
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.runs.simulate import record
from mwd_surface.surveys.recorded_settings import recorded_settings

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


def test_the_bag_names_place_day_and_well_as_a_recording_of_the_surface_does(tmp_path):
    told = parse(
        "{name: told, date: 2025-05-06T07:00:00, place: {latitude_deg: 59.9, longitude_deg: 10.7, height_m: 90.0},"
        " well: {sensor_to_bit_m: 14.0}, schedule: [{kind: still, seconds: 1.0}]}"
    )
    record(told, tmp_path / "bag", "well_3")
    with Bag(tmp_path / "bag") as bag:
        got = recorded_settings(bag)
    place = got.estimator.place
    assert (place.field, place.lat_deg, place.lon_deg, place.height_m, place.date) == (
        *("model", 59.9, 10.7, 90.0),
        "2025-05-06",
    )
    well = got.surface.well
    assert (well.name, well.latitude_deg, well.longitude_deg, well.sensor_to_bit) == ("well_3", 59.9, 10.7, 14.0)
    assert got.remarks == ()


def test_a_scenario_that_sets_its_field_is_recorded_with_that_field(tmp_path):
    record(
        parse("{name: f, field_override: [50000.0, 70.0, -2.0], schedule: [{kind: still, seconds: 1.0}]}"),
        tmp_path / "bag",
    )
    with Bag(tmp_path / "bag") as bag:
        place = recorded_settings(bag).estimator.place
    assert (place.field, place.total_nt, place.dip_deg, place.declination_deg) == ("fixed", 50000.0, 70.0, -2.0)


def test_a_bag_that_exists_is_not_overwritten(tmp_path):
    (tmp_path / "bag").mkdir()
    with pytest.raises(FileExistsError, match="exists already"):
        record(SCENARIO, tmp_path / "bag")
