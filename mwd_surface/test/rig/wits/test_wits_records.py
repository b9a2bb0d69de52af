# SPDX-License-Identifier: Apache-2.0
"""Records of WITS level 0: byte-exact packets, units at the edge, and what the peer's own decoder makes of them."""

import csv
import dataclasses
import math
from pathlib import Path

import pytest
from example_rig import NOW_NS, attitude, rig_state, values
from example_surveys import START, WELL, S, survey, surveys

from mwd_estimation.core.status import Status
from mwd_estimation.survey.survey import Verdict
from mwd_surface.rig.wits.format import Decoder, encode
from mwd_surface.rig.wits.records import RECORD_1, SENT, RecordWriter, Wits0Format, activity_code, rig_readings
from mwd_surface.signals.units import UNITS
from mwd_surface.surveys.survey_list import SurveyList
from project import REFERENCE_DATA

GOLDEN = Path(__file__).parent / "golden"
SYMBOLS = REFERENCE_DATA / "authorities/wits0_records_1_2_7_8_symbols.csv"
FORMS = {
    "metric_totals": Wits0Format(),
    "fps_raw6": Wits0Format(units="fps", spares="mwdstd-raw6", source="MWD-ROS2", well_id="W 1"),
    "metric_none_nulls": Wits0Format(spares="none", null_text="-9999", section=2),
}


def packets(form, table):
    writer = RecordWriter(form)
    groups = (
        writer.survey(table, table.survey),
        writer.toolface(table),
        writer.formation(table),
        writer.mechanical(table),
    )
    return b"".join(encode(items, form.source) for items in groups if items)


def numbers(data):
    return [{i.code: i.number for i in frame.items} for frame in Decoder().feed(data)]


@pytest.mark.parametrize("name", list(FORMS))
def test_packets_are_byte_for_byte_those_of_the_golden_file(name):
    assert packets(FORMS[name], values()) == (GOLDEN / f"{name}.wits0").read_bytes()


def test_the_numbers_of_a_survey_are_those_of_the_path_in_the_units_of_the_session():
    table = values()
    s = table.survey
    metric, fps = numbers(packets(FORMS["metric_totals"], table))[0], numbers(packets(FORMS["fps_raw6"], table))[0]
    assert metric[708] == pytest.approx(s.value("measured_depth"), abs=0.005)
    assert fps[708] == pytest.approx(s.value("measured_depth") / 0.3048, abs=0.005)
    assert metric[713] == fps[713] == pytest.approx(math.degrees(s.value("inclination")), abs=0.005)
    assert metric[715] == fps[715] == pytest.approx(math.degrees(s.value("azimuth")), abs=0.005)
    assert metric[720] == pytest.approx(math.degrees(s.value("dogleg_severity")) * 30.0, abs=0.005)
    assert fps[720] == pytest.approx(math.degrees(s.value("dogleg_severity")) * 30.48, abs=0.005)
    assert metric[722] == pytest.approx(s.value("g_total") / 9.80665, abs=5e-5)
    assert metric[723] == pytest.approx(s.value("b_total") * 1e9, abs=0.05)
    # Gravity as it points: the tool feels the opposite.
    assert fps[722] == pytest.approx(-s.result.specific_force[0] / 9.80665 * 1e3, abs=0.005)
    assert fps[725] == pytest.approx(s.result.magnetic_field[0] * 1e9, abs=0.05)


def test_time_in_a_packet_is_that_of_the_measurement():
    table = values()
    frame = numbers(packets(Wits0Format(), table))[0]
    assert (frame[705], frame[706]) == (260514.0, 195700.0)


def test_what_is_not_to_be_used_is_left_out_or_null_and_never_nan():
    old = values(later=200.0)
    left_out = packets(FORMS["metric_totals"], old)
    assert [min(f) // 100 for f in numbers(left_out)] == [7]
    nulls = Decoder().feed(packets(FORMS["metric_none_nulls"], old))
    assert [f.items[-1].null for f in nulls[1:]] == [True] * 3
    assert b"nan" not in (left_out + packets(FORMS["metric_none_nulls"], old)).lower()


def test_no_toolface_goes_out_while_the_string_turns_unless_asked_for():
    table = values(sample=attitude(Status.ROTATING))
    assert table.rotating
    assert RecordWriter(Wits0Format()).toolface(table) == []
    assert RecordWriter(Wits0Format(toolface_while_rotating=True)).toolface(table)


def test_a_magnetic_toolface_has_its_own_item():
    steep = attitude(Status.NEAR_VERTICAL, inclination=0.01, magnetic_toolface=math.radians(359.999))
    items = dict(RecordWriter(Wits0Format()).toolface(values(sample=steep)))
    assert items[716] == "0.00"
    assert 717 not in items


def test_sequence_numbers_grow_also_over_a_restart():
    table = values()
    before = RecordWriter(Wits0Format())
    numbers_before = [int(dict(before.formation(table))[804]) for _ in range(3)]
    later = dataclasses.replace(table, made_ns=NOW_NS + 10 * S)
    after = int(dict(RecordWriter(Wits0Format()).formation(later))[804])
    assert numbers_before == sorted(set(numbers_before))
    assert after > numbers_before[-1]
    assert after < 2**31


@pytest.mark.fault_case(73)
@pytest.mark.parametrize("text", ["W\r\n0110 5", "a!!", "Åsgard"])
def test_a_name_that_would_break_a_frame_is_refused_as_a_setting(text):
    with pytest.raises(ValueError, match="well_id"):
        Wits0Format(well_id=text)


def test_a_well_name_that_is_not_ascii_or_would_break_a_frame_is_made_harmless():
    name = "Ω!!\r\n0110 5&&x"
    table = dataclasses.replace(values(), well=name)
    (frame,) = Decoder().feed(encode(RecordWriter(Wits0Format()).formation(table)))
    assert frame.items[0].text == "?!??0110 5&x"
    assert frame.number(110) is None


@pytest.mark.parametrize(
    ("rig", "code"),
    [
        ({"in_slips": True, "flow_rate": 0.0}, 3),
        ({"bit_depth": 655.4}, 2),
        ({}, 7),
        ({"flow_rate": 0.0}, None),
    ],
)
def test_the_activity_follows_from_what_the_rig_says(rig, code):
    assert activity_code(values(rig=rig_state(**rig))) == code


def test_a_survey_without_magnetometer_has_no_made_up_items():
    bare = survey(
        1,
        30.0,
        75.0,
        north=2,
        azimuth_method="gyro",
        b_total=math.nan,
        dip=math.nan,
        azimuths=(),
        temperature=math.nan,
        magnetic_field=(math.nan,) * 3,
    )
    table = values(SurveyList().add(bare, 300.0, 0.0))
    items = dict(RecordWriter(Wits0Format()).survey(table, table.survey))
    assert not {714, 723, 724, 726} & set(items)
    assert items[712] == "GYRO"


@pytest.mark.parametrize("judged", [False, True])
def test_the_azimuth_that_a_path_carries_through_a_vertical_station_is_not_sent_as_measured(judged):
    upright = survey(2, 0.4, 75.0, azimuth=math.nan, verdict_azimuth=int(Verdict.NOT_DETERMINED))
    whole = SurveyList(well=WELL).add(survey(1, 30.0, 75.0), 300.0, 0.0).add(upright, 330.0, 0.0)
    whole = whole.accept(2, "Bo", "upright", START + 90_000 * S) if judged else whole
    table = values(whole)
    assert table.survey.result.sequence == 2
    assert math.isfinite(table.survey.path.azimuth[table.survey.station])
    form = Wits0Format(null_text="-9999")
    items = dict(RecordWriter(form).survey(table, table.survey))
    assert items[715] == "-9999"
    assert items[713] == "0.40"
    assert not table.values["survey_azimuth"].condition.usable
    assert not table.values["projected_azimuth"].condition.usable
    assert table.values["projected_inclination"].condition.usable


def test_codes_names_and_units_are_those_of_the_specification():
    with SYMBOLS.open(newline="") as file:
        rows = {int(row["code"]): row for row in csv.DictReader(file)}
    for code, (item, _) in SENT.items():
        if code // 100 in (7, 8) and item.name:
            assert (rows[code]["name"], rows[code]["data_type"]) == (item.name, "F")
    units = {"M": 1.0, "M/HR": 1 / 3600, "KDN": 1e4, "KNM": 1e3, "RPM": math.pi / 30, "KPA": 1e3, "L/M": 1e-3 / 60}
    for code, signal in RECORD_1.items():
        assert UNITS[signal.unit].metric.si(1.0) == pytest.approx(units[rows[code]["metric_unit"]])


@pytest.mark.parametrize(
    ("units", "text", "si"),
    [
        ("metric", "01082214.3", {"bit_depth": 2214.3}),
        ("fps", "01081000", {"bit_depth": 304.8}),
        ("metric", "0114120.5", {"hookload": 1.205e6}),
        ("fps", "0114100", {"hookload": 444822.16152605}),
        ("metric", "0120120", {"rotary_speed": 4 * math.pi}),
        ("metric", "012115000", {"pressure": 1.5e7}),
        ("fps", "01212000", {"pressure": 13789514.586336}),
        ("metric", "01302400", {"flow_rate": 0.04}),
        ("fps", "0130600", {"flow_rate": 0.037854117840}),
        ("fps", "011860", {"torque": 81349.0768966}),
        ("metric", "0108-9999", {}),
        ("metric", "0208100", {}),
    ],
)
def test_rig_data_of_record_1_come_in_as_si(units, text, si):
    (frame,) = Decoder().feed(f"&&\r\n{text}\r\n!!\r\n".encode())
    assert rig_readings(frame, units) == pytest.approx(si)


def test_an_independent_decoder_reads_the_same_values():
    import witskit.decoder.wits_decoder as witskit

    table = values(surveys())
    for frame in packets(Wits0Format(), table).split(b"!!\r\n")[:-1]:
        decoded = witskit.decode_frame(frame.decode() + "!!\r\n", use_metric_units=True, strict_mode=False)
        theirs = {d.symbol_code: d.parsed_value for d in decoded.data_points}
        (ours,) = Decoder().feed(frame + b"!!\r\n")
        both = [i for i in ours.items if f"{i.code:04d}" in theirs and i.number is not None]
        assert len(both) >= 5
        for item in both:
            assert float(theirs[f"{item.code:04d}"]) == pytest.approx(item.number)
