# SPDX-License-Identifier: Apache-2.0
"""
One accepted survey has the same numbers everywhere: in every rig interface, every export, the report and the page.

The tolerance is the rounding of each format; units change at the edge only.
"""

import asyncio
import csv
import io
import math
import socket
import struct
import time
import xml.etree.ElementTree as ET
from types import SimpleNamespace

import pytest

from mwd_estimation.core.north import North
from mwd_estimation.core.status import Status
from mwd_estimation.survey.survey import AzimuthEstimate, Survey
from mwd_sensors.core import wire
from mwd_sensors.drivers.polled_line import Master, Poll, PolledFrame, PolledLineUnit, ReplyItem, reply
from mwd_surface.exports.csv_tables import definitive_csv, raw_csv
from mwd_surface.exports.export_las import las
from mwd_surface.exports.export_witsml import NAMESPACE, witsml
from mwd_surface.exports.report_content import content
from mwd_surface.exports.report_html import report_html
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.live.live_state import LiveState
from mwd_surface.page.state_json import StateJson
from mwd_surface.rig.modbus.map import COUNT, ModbusForm, float_of
from mwd_surface.rig.modbus.server import ModbusSettings
from mwd_surface.rig.opcua.access import OpcuaSettings
from mwd_surface.rig.opcua.address_space import NAMESPACE as OPCUA_NAMESPACE
from mwd_surface.rig.polled.unit import usable
from mwd_surface.rig.port import RigPort, RigSettings
from mwd_surface.rig.survey import accepted_surveys
from mwd_surface.rig.values import rig_values
from mwd_surface.rig.wits.connections import Wits0ServerSettings
from mwd_surface.rig.wits.format import Decoder
from mwd_surface.rig.wits.link import Wits0Settings
from mwd_surface.rig.wits.records import RecordWriter, Wits0Format
from mwd_surface.surveys.leg import Leg, TieOn
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.well import Well

pytestmark = pytest.mark.slow

S = 10**9
START = 1_778_767_020 * S
LAST = 4
DEG = math.pi / 180.0
# What is compared, in SI and rad, and the unit in which most outputs print it.
UNITS = {"md": 1.0, "inclination": DEG, "azimuth": DEG, "tvd": 1.0, "north": 1.0, "east": 1.0, "dogleg": DEG / 30.0}
UNITS |= {"g_total": 1.0, "b_total": 1e-9, "dip": DEG}
NAMES = tuple(UNITS)


def surveys(north):
    """A build of four stations with numbers that no rounding leaves alone."""
    well = Well(name="Well 1", north_reference=north, section_azimuth_deg=75.0, sensor_to_bit=12.5, error_model="")
    whole = SurveyList(well=well, legs=(Leg(tie_on=TieOn.given(0.0, 0.0, 0.0)),))
    for k in range(1, LAST + 1):
        azimuth = math.radians(358.123456 + 0.7891 * k) % math.tau
        survey = Survey(
            stamp_ns=START + k * 1800 * S + 123_456_789,
            uuid=f"00000000-0000-4000-8000-{k:012d}",
            sequence=k,
            inclination=math.radians(3.456789 * k),
            azimuth=azimuth,
            north=int(North.MAGNETIC),
            specific_force=(-9.7, 0.31, 1.4),
            magnetic_field=(3.1e-5, -1.2e-5, 3.65e-5),
            magnetic_field_covariance=(1e-16, 0.0, 0.0, 0.0, 1e-16, 0.0, 0.0, 0.0, 1e-16),
            covariance=(1e-6, 0.0, 0.0, 0.0, 4e-5, 0.0, 0.0, 0.0, 1e-6),
            temperature=63.5,
            azimuth_method="fused",
            azimuths=(AzimuthEstimate("raw", 1, azimuth + 0.01, 0.02),),
            g_total=9.8191234,
            b_total=5.0312345e-5,
            dip=math.radians(72.123456),
            g_reference=9.819,
            b_reference=5.03e-5,
            dip_reference=math.radians(72.1),
            declination=math.radians(1.4321),
            convergence=math.radians(-0.6543),
            status=int(Status.CORRECTED),
        )
        whole = whole.add(survey, 1000.0 + 29.87654 * k, 0.4)
    return whole


def truth(whole):
    """The numbers of the last station from the list itself."""
    path, record = whole.definitive(), whole.find(LAST)
    k = path.sequence.index(LAST)
    n, e, d = path.positions[k]
    s = record.survey
    numbers = (
        path.md[k],
        s.inclination,
        path.azimuth[k],
        d,
        n,
        e,
        path.dogleg_severity[k],
        s.g_total,
        s.b_total,
        s.dip,
    )
    return dict(zip(NAMES, map(float, numbers), strict=True))


@pytest.fixture(scope="module", params=["magnetic", "true", "grid"])
def given(request):
    """The survey as every output gives it: name of the output to (numbers, half of the last digit) in SI."""
    whole = surveys(request.param)
    table = survey_table(whole, START + 10_000 * S)
    live = LiveState()
    live.show(100.0, well=whole.well, surveys=whole)
    live.show(100.0, path=whole.definitive())
    attitude = wire.ATTITUDE.empty(1)
    attitude["stamp_ns"] = START + 9_999 * S
    live.on_attitude(attitude, 100.0)
    state = live.at(100.0)
    snapshot = StateJson().snapshot(state)
    values = rig_values(state, accepted_surveys(whole), now_ns=START + 10_000 * S)
    outputs = {
        "CSV": definitive(definitive_csv(table)),
        "raw CSV": raw(raw_csv(whole)),
        "LAS": log(las(table)),
        "WITSML": trajectory(witsml(table)),
        "report": paper(content(table)),
        "page": page(snapshot),
        "polled": asked(values),
    }
    fps = Wits0Settings(form=Wits0Format(units="fps"))
    for units, talk in (("metric", Wits0Settings()), ("fps", fps)):
        settings = RigSettings(
            wits0=talk,
            wits0_server=Wits0ServerSettings(enabled=True, port=0),
            modbus=ModbusSettings(enabled=units == "metric", port=0),
            opcua=OpcuaSettings(enabled=units == "metric", port=0),
        )
        port = RigPort(settings, "Well 1")
        try:
            assert port.start() == {}
            port.publish(values)
            where = {s.name: s.address for s in port.status()}
            outputs[f"WITS {units}"] = recorder(where["wits0_server"], units)
            if units == "metric":
                outputs["Modbus"] = registers(where["modbus"])
                outputs["OPC UA"] = asyncio.run(variables(where["opcua"]))
        finally:
            port.stop()
    return SimpleNamespace(whole=whole, table=table, truth=truth(whole), outputs=outputs)


def digits(text, unit, decimals):
    """A printed number in SI, and half of its last digit."""
    assert len(text.partition(".")[2]) == decimals, text
    return float(text) * unit, 0.5 * 10.0**-decimals * unit


def printed(row, columns, units=UNITS):
    """Numbers of a row of texts. columns: title and decimals of each number by its name."""
    return {name: digits(row[title], units[name], decimals) for name, (title, decimals) in columns.items()}


def row_of(text, wanted):
    rows = list(csv.DictReader(io.StringIO("".join(x for x in text.splitlines(True) if not x.startswith("#")))))
    return next(row for row in rows if row["sequence"] == str(wanted))


def definitive(text):
    titles = ("md_m", "inclination_deg", "azimuth_deg", "tvd_m", "north_m", "east_m", "dls_deg_per_30m")
    columns = zip(titles, (3, 4, 4, 3, 3, 3, 4), strict=True)
    return printed(row_of(text, LAST), dict(zip(NAMES, columns, strict=False)))


def raw(text):
    columns = {"md": ("md_m", 3), "inclination": ("inclination_deg", 4), "dip": ("dip_deg", 4)}
    return printed(row_of(text, LAST), columns | {"g_total": ("g_total_mps2", 6), "b_total": ("b_total_nt", 1)})


def asked(values):
    """Numbers that a host reads on a polled line, in a frame with as many digits as usual ones have."""
    names = {"md": "depth", "inclination": "inclination", "azimuth": "azimuth", "tvd": "vertical_depth"}
    names |= {"b_total": "field", "dip": "dip"}
    steps = {"md": (0.01, ""), "tvd": (0.01, ""), "b_total": (1.0, "nT")}
    items = tuple(
        ReplyItem(f"survey_{word}", "int32", step, unit=unit)
        for (step, unit), word in ((steps.get(name, (0.01, "deg")), word) for name, word in names.items())
    )
    frame = PolledFrame(polls=(Poll(4, "", items),))
    host = Master(frame)
    poll = PolledLineUnit(frame).feed(host.due(0.0))
    (got,) = host.feed(reply(frame, poll, usable(values)), 0.0)
    return {name: (got.values[item.quantity], 0.5 * item.line[1]) for name, item in zip(names, items, strict=True)}


def log(text):
    import lasio

    read = lasio.read(text)
    k = int(min(range(len(read.index)), key=lambda i: abs(read.index[i] - (1000.0 + 29.87654 * LAST))))
    return {
        name: (float(read.curves[number].data[k]) * UNITS[name], 0.5 * 10.0**-decimals * UNITS[name])
        for number, (name, decimals) in enumerate(zip(NAMES, (3, 4, 4, 3), strict=False))
    }


def trajectory(text):
    ns = {"w": NAMESPACE}
    uid = f"00000000-0000-4000-8000-{LAST:012d}"
    station = ET.fromstring(text.encode()).find(f".//w:trajectoryStation[@uid='{uid}']", ns)  # noqa: S314
    units = {"m": 1.0, "dega": DEG, "dega/30m": DEG / 30.0, "nT": 1e-9, "m/s2": 1.0}
    names = ["md", "incl", "azi", "tvd", "dispNs", "dispEw", "dls"]
    names += [f"valid/w:{name}Calc" for name in ("gravTotalField", "magTotalField", "magDipAngle")]
    found = (station.find(f"w:{name}", ns) for name in names)
    texts = ((one.text, units[one.get("uom")], len(one.text.partition(".")[2])) for one in found)
    return {name: digits(*text) for name, text in zip(NAMES, texts, strict=True)}


def sheet_of(reported, beginning):
    return next(sheet for sheet in reported.sheets if sheet.heading.startswith(beginning))


def paper(reported):
    row = {}
    for name in ("Totals as read", "Definitive survey"):
        sheet = sheet_of(reported, name)
        row |= dict(zip(sheet.titles, next(r for r in sheet.rows if r[0] == str(LAST)), strict=True))
    titles = ("MD", "Inc", "Azi", "TVD", "N/S", "E/W", "DLS", "G read", "B read", "Dip read")
    columns = zip(titles, (*[2] * 7, 4, 0, 2), strict=True)
    return printed(row, dict(zip(NAMES, columns, strict=True)))


def page(snapshot):
    row = next(r for r in snapshot["sections"]["surveys"]["rows"] if r["sequence"] == LAST)
    keys = {name: name for name in NAMES}
    keys |= {"md": "measured_depth", "tvd": "vertical_depth", "dogleg": "dogleg_severity"}
    return {name: (row[key], abs(row[key]) * 1e-9) for name, key in keys.items()}


def recorder(address, units):
    host, number = address.rsplit(":", 1)
    decoder, frames = Decoder(), []
    with socket.create_connection((host, int(number)), 10.0) as connection:
        while not any(f.number(713) is not None for f in frames):
            frames += decoder.feed(connection.recv(4096))
    frame = next(f for f in frames if f.number(713) is not None)
    imperial = dict.fromkeys(("md", "tvd", "north", "east"), 0.3048) | {"dogleg": DEG / 30.48}
    scale = UNITS | {"g_total": 9.80665} | (imperial if units == "fps" else {})
    columns = zip((708, 713, 715, 709, 718, 719, 720, 722, 723, 724), (*[2] * 7, 4, 1, 2), strict=True)
    return printed({item.code: item.text for item in frame.items}, dict(zip(NAMES, columns, strict=True)), scale)


def registers(address):
    host, number = address.rsplit(":", 1)
    end = time.monotonic() + 60.0
    block = ()
    with socket.create_connection((host, int(number)), 10.0) as connection:
        while time.monotonic() < end and (not block or block[3] != LAST):
            connection.sendall(struct.pack(">HHHBBHH", 1, 0, 6, 1, 4, 0, COUNT))
            answer = b""
            while len(answer) < 9 + 2 * COUNT:
                answer += connection.recv(512)
            block = struct.unpack(f">{COUNT}H", answer[9:])
    assert block[3] == LAST
    names = ("inclination", "azimuth", "md", "g_total", "b_total", "dip")
    scale, found = UNITS | {"g_total": 9.80665}, {}
    for at, name in zip(range(10, 22, 2), names, strict=True):
        number = float_of(block[at : at + 2], ModbusForm()) * scale[name]
        # A float of 32 bits has 24 of significance.
        found[name] = (number, abs(number) * 2.0**-24)
    return found


async def variables(address):
    import asyncua

    names = ["SurveyMeasuredDepth", "Inclination", "Azimuth", "SurveyTrueVerticalDepth", "SurveyNorth", "SurveyEast"]
    names += ["DogLegSeverity", "TotalGravity", "TotalMagneticField", "MagneticDip"]
    async with asyncua.Client(address) as client:
        index = await client.get_namespace_index(OPCUA_NAMESPACE)
        well = await client.nodes.objects.get_child([f"{index}:Well 1"])
        number = await well.get_child(f"{index}:SurveySequence")
        while not (await number.read_data_value(False)).StatusCode.is_good():
            await asyncio.sleep(0.005)
        values = [await (await well.get_child(f"{index}:{name}")).read_value() for name in names]
        return {name: (value, 0.0) for name, value in zip(NAMES, values, strict=True)}


def test_every_output_gives_the_numbers_of_the_list_within_its_own_rounding(given):
    assert len(given.outputs) == 11
    for output, numbers in given.outputs.items():
        for name, (value, half) in numbers.items():
            expected = given.truth[name]
            assert abs(value - expected) <= half * (1.0 + 1e-6) + 1e-12, (output, name, value, expected)


def test_no_output_leaves_out_depth_and_direction(given):
    for output, numbers in given.outputs.items():
        assert {"md", "inclination"} <= set(numbers), output
    full = ("WITSML", "report", "page", "WITS metric", "WITS fps", "OPC UA")
    assert all(set(given.outputs[output]) == set(NAMES) for output in full)


def test_the_html_of_the_report_prints_the_texts_of_its_content(given):
    html = report_html(given.table)
    sheet = sheet_of(content(given.table), "Definitive survey")
    row = next(r for r in sheet.rows if r[0] == str(LAST))
    for text in row[:8]:
        assert text in html


def test_the_ros_message_carries_the_numbers_of_the_list(given):
    pytest.importorskip("rclpy", reason="ROS is not installed")
    from mwd_sensors.ros.messages import make

    message = given.whole.find(LAST).to_message(make)
    fields = ("measured_depth", None, None, "vertical_depth", "north", "east", "dogleg_severity")
    for name, field in zip(NAMES, fields, strict=False):
        if field is not None:
            assert getattr(message, field) == given.truth[name]


def test_units_are_turned_at_the_edge_only():
    whole = surveys("true")
    live = LiveState()
    live.show(1.0, surveys=whole)
    table = rig_values(live.at(1.0), accepted_surveys(whole), now_ns=START)
    before = dict(table.values)
    RecordWriter(Wits0Format(units="fps")).survey(table, table.survey)
    assert table.values == before
    assert table.survey.value("measured_depth") == whole.find(LAST).measured_depth
