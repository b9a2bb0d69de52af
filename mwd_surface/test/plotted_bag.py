# SPDX-License-Identifier: Apache-2.0
"""A short recording with everything that is drawn: a simulated run, its estimate, interference and a dozen surveys."""

import dataclasses

import example_surveys as example
import numpy as np

from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import settings, wire
from mwd_sensors.simulator import scenario
from mwd_sensors.simulator.sonde import Sonde
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.surveys import message_conversion
from mwd_surface.surveys.survey_source import LIST_TYPE, PATH_TYPE

RUN = """
name: plotted
date: 2026-03-01T06:00:00
place: {latitude_deg: 38.3, longitude_deg: 109.6, height_m: 1150.0}
well: {stations: [[0.0, 30.0, 359.0], [100.0, 40.0, 2.0]], bit_m: 50.0}
schedule:
  - {kind: still, seconds: 14.0, pumps: false}
  - {kind: drill, seconds: 12.0, rpm: 90.0, rop_m_h: 360.0}
  - {kind: still, seconds: 8.0}
vibration:
  random: [{band_hz: [8.0, 300.0], acceleration_mps2: [3.0, 6.0, 6.0]}]
interference: {axial_nt: 800.0}
"""
RECORD = "mwd_msgs/msg/SurveyRecord"


def blank(store, name):
    """A message of that type, all fields empty, made without middleware."""
    values = {}
    for field, (kind, inner) in store.fielddefs[name][1]:
        if kind.name == "BASE":
            values[field] = "" if inner[0] == "string" else 0
        elif kind.name == "NAME":
            values[field] = blank(store, inner)
        elif kind.name == "ARRAY":
            values[field] = np.zeros(inner[1], dtype=inner[0][1][0])
        else:
            values[field] = []
    return store.types[name](**values)


def survey_rows(definitions):
    """Serialised records of the example surveys."""
    for record in example.surveys().records:
        yield bytes(definitions.typestore.serialize_cdr(record.to_message(definitions.make), RECORD))


def record(path, topics=tuple(wire.SONDE_TOPICS), estimate=True, surveys=True, namespace="/w1/", text=RUN):
    """Write the bag; returns its sonde."""
    sonde = Sonde(scenario.parse(text))
    place = {"field": "model", "lat_deg": 38.3, "lon_deg": 109.6, "height_m": 1150.0, "date": "2026-03-01"}
    changes = {f"place.{key}": value for key, value in place.items()} | {"survey.north": "true"}
    pipeline = Pipeline(settings.changed(EstimatorSettings(), changes))
    outputs = {"attitude": wire.ATTITUDE, "gravity": wire.GRAVITY, "interference": wire.INTERFERENCE}
    with BagWriter(path) as bag:
        layouts = {name: wire.SONDE_TOPICS[name] for name in topics} | (outputs if estimate else {})
        channels = {name: bag.topic(namespace + name, layout.type_name) for name, layout in layouts.items()}
        for block in sonde.blocks(1.0):
            found = dict(block)
            if estimate:
                pipeline.push_mag(block["imu/mag"])
                out = pipeline.push_imu(block["imu/data_raw"])
                found |= {"attitude": out.attitude, "gravity": out.gravity, "interference": out.interference}
            for name, channel in channels.items():
                if len(found[name]):
                    rows = layouts[name].encode(found[name], wire.SONDE_FRAME)
                    bag.write_rows(channel, rows, found[name]["stamp_ns"])
        if surveys:
            channel = bag.topic(namespace + "survey/accepted", RECORD)
            for k, row in enumerate(survey_rows(bag.definitions)):
                bag.write(channel, row, sonde.epoch_ns + k * wire.NANOSECONDS, sonde.epoch_ns + k * wire.NANOSECONDS)
    return sonde


def arrays(message):
    """The typestore takes arrays, a node takes lists."""
    for field in dataclasses.fields(message):
        value = getattr(message, field.name)
        if isinstance(value, list) and "ndarray" in str(field.type):
            setattr(message, field.name, np.array(value, dtype=float))
        for part in value if isinstance(value, list) else [value]:
            if dataclasses.is_dataclass(part):
                arrays(part)
    return message


def recorded(path, lists, trajectory=True, tables=()):
    """A bag of survey lists and their paths, as the surface node publishes them; tables: its metadata."""
    with BagWriter(path) as bag:
        for name, table in dict(tables).items():
            bag.add_metadata(name, table)
        definitions = bag.definitions
        channels = [bag.topic("/w1/surveys", LIST_TYPE), bag.topic("/w1/trajectory", PATH_TYPE)]
        for k, surveys in enumerate(lists):
            table = message_conversion.list_message(surveys, "wellhead", definitions.make)
            way = message_conversion.trajectory_message(
                surveys.definitive(), surveys.changed_ns, "wellhead", definitions.make
            )
            for channel, kind, message in zip(channels, (LIST_TYPE, PATH_TYPE), (table, way), strict=True):
                if kind == LIST_TYPE or trajectory:
                    data = bytes(definitions.typestore.serialize_cdr(message, kind))
                    bag.write(channel, data, example.START + k, example.START + k)
    return path
