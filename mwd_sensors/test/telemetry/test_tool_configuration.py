# SPDX-License-Identifier: Apache-2.0
"""Tool configurations: read, written, refused; times on air against those of a public configuration."""

import itertools

import pytest
import yaml

from mwd_sensors.telemetry import log_channels
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration, encode, from_mapping, read, text

PUBLIC = {
    "pulse_width_s": 0.8,
    "survey_sequences": {"SSq1": "Inc:12:P Azm:12:P DipA:12:P Temp:8:P Grav:12:P MagF:12:P BatV:8:P"},
    "toolface_sequences": ["aTFA:6:P"],
}


def test_times_on_air_are_those_of_the_public_configuration():
    """133 s at 0.8 s and 83 s at 0.5 s for the survey, 11.2 and 7.0 s for a toolface of 6 bits with parity."""
    for width, survey, toolface in ((0.8, 133.0, 11.2), (0.5, 83.0, 7.0)):
        tool = from_mapping({**PUBLIC, "pulse_width_s": width})
        assert tool.length_tu(tool.surveys[0]) * tool.tu_s == pytest.approx(survey, abs=0.5)
        assert tool.length_tu(tool.toolfaces[0]) * tool.tu_s == pytest.approx(toolface, abs=0.01)


def test_what_is_written_is_read_back(tmp_path):
    tool = from_mapping({"header_bits": 3, "words": {"Gama": {"bits": 8, "low": 0, "high": 255, "unit": "cps"}}})
    (tmp_path / "tool.yaml").write_text(text(tool))
    assert read(tmp_path / "tool.yaml") == tool
    assert yaml.safe_load(text(ToolConfiguration()))["sync"]["length_tu"] == 40


def test_a_pass_begins_with_sync_and_header_where_it_should():
    tool = from_mapping({**PUBLIC, "header_bits": 2})
    sent = encode(tool, tool.toolfaces[0], (63,), number=0)
    assert sent.edges[:5] == (0, 5, 14, 21, 32)
    assert sent.edges[5] == 40 + 3
    assert sent.length == 40 + 8 + 28
    # 63 has six ones, so the even parity bit is 0: 111, 11, 10.
    assert encode(tool, tool.toolfaces[0], (63,)).edges == (0, 12, 21)


def test_odd_parity_turns_the_bit():
    even, odd = from_mapping(PUBLIC), from_mapping({**PUBLIC, "parity": "odd"})
    assert [tool.parity_bit(code) for tool in (even, odd) for code in (0, 1)] == [0, 1, 1, 0]


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"pulse_with_s": 0.5}, "did you mean pulse_width_s"),
        ({"sync": {"edges_tu": [0, 1, 15]}}, "width of a pulse"),
        ({"sync": {"edges_tu": [0, 5, 50]}}, "ends before"),
        ({"survey_sequences": ["Inc:12:P Azz"]}, r"survey_sequences\[0\].*Azz"),
        ({"header_bits": 2, "survey_sequences": ["Inc"] * 5}, "cannot number 5"),
        ({"header_bits": 1}, "1 bit"),
        ({"words": {"Inc": {"low": 5, "high": 1}}}, "words.Inc.*high"),
        (
            {"words": {"Inc": {"high": 180, "unit": "degrees"}}},
            "words.Inc.unit: 'degrees' of Inc is not one of rad, deg",
        ),
        ({"words": {"MagF": {"high": 70, "unit": "deg"}}}, "words.MagF.*T, mT, uT, nT, G, mG"),
    ],
)
def test_a_mistake_is_refused_with_its_key(change, complaint):
    with pytest.raises(ValueError, match=complaint):
        from_mapping(change)


def test_a_broken_file_is_named(tmp_path):
    (tmp_path / "tool.yaml").write_text("code: [")
    with pytest.raises(ValueError, match=r"tool\.yaml: not YAML"):
        read(tmp_path / "tool.yaml")


def test_the_usual_sync_does_not_resemble_its_own_copy():
    """If all distances differ by a pulse width (2 TU) or more, a shifted copy shares at most one of five pulses."""
    edges = ToolConfiguration().sync.edges_tu
    apart = sorted(b - a for k, a in enumerate(edges) for b in edges[k + 1 :])
    assert all(b - a >= 2 for a, b in itertools.pairwise(apart))


@pytest.mark.parametrize("given", [{}, [], None])
@pytest.mark.parametrize("code", ["mary", "psk", "serial"])
def test_a_tool_may_send_surveys_only_and_its_file_reads_back(given, code):
    surveys = ["Inc:12 Azm:12"]
    tool = from_mapping({"code": code, "survey_sequences": surveys, "toolface_sequences": given})
    assert tool.toolfaces == ()
    assert tool.sequence("toolface", 0) == ()
    assert from_mapping(yaml.safe_load(text(tool))) == tool
    with pytest.raises(ValueError, match="survey_sequences: at least one"):
        from_mapping({"survey_sequences": given})


def test_a_log_channel_is_declared_in_the_configuration_alone():
    """A channel of any source with its word; a wrong word, unit or number of sectors is refused by name."""
    sectors = ("GU", "GR", "GD", "GL")
    words = {name: {"bits": 8, "high": 510.0, "unit": "gAPI"} for name in sectors}
    channels = {
        "gamma": {"sectors": 4, "word": "Gama", "sector_words": list(sectors), "tool_factor": 1.5},
        "shake": {"source": "stick_slip", "word": "SSI"},
    }
    words["SSI"] = {"bits": 6, "high": 2.0}
    tool = from_mapping({"channels": channels, "words": words})
    assert from_mapping(yaml.safe_load(text(tool))) == tool
    assert [item[0::2] for item in log_channels.carried(tool.logged).values()] == [
        ("gamma", None),
        *(("gamma", k) for k in range(4)),
        ("shake", None),
    ]
    assert tool.logged["gamma"].factor("cps") == 1.5
    assert tool.logged["gamma"].factor("gAPI") == 1.0
    for wrong, named in (
        ({"g": {"word": "Nope"}}, "channels.g: no word Nope"),
        ({"g": {"word": "RINC"}}, "channels.g: word RINC"),
        ({"g": {"word": "Gama"}, "h": {"word": "Gama"}}, "channels.h: the word Gama"),
        ({"g": {"sectors": 2}}, "sectors: must be 0, or 4"),
        ({"g": {"sectors": 4, "sector_words": ["Gama"]}}, "1 words for 4 sectors"),
        ({"g": {"source": "radon"}}, "channels.g.source"),
        ({"a,b": {}}, "up to 32 letters"),
    ):
        with pytest.raises(ValueError, match=named):
            from_mapping({"channels": wrong})


def test_a_kit_that_names_another_quantity_like_a_usual_channel_keeps_its_word():
    tool = from_mapping({"words": {"Gama": {"bits": 8, "high": 9.0, "unit": "V"}}})
    assert tool.logged["gamma"].word == ""
    assert tool.logged["inclination"].word == "RINC"


@pytest.mark.parametrize("content", ["", "# nothing but a comment\n", "[]\n"])
def test_a_file_without_settings_is_not_the_default_tool(tmp_path, content):
    path = tmp_path / "tool.yaml"
    path.write_text(content)
    with pytest.raises(ValueError, match=r"tool\.yaml"):
        read(path)
