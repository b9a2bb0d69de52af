# SPDX-License-Identifier: Apache-2.0
"""Parameter files say what the settings are, every line explained; the reference has users' parameters first."""

import dataclasses
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

import yaml

from mwd_sensors.core.settings import from_mapping, setting, to_mapping

ROOT = Path(__file__).resolve().parent.parent
# A program without the suffix .py, which is not a module that can be imported by name.
_LOADER = SourceFileLoader("ci_config", str(ROOT / ".ci/config"))
config = module_from_spec(spec_from_loader("ci_config", _LOADER))
_LOADER.exec_module(config)


@dataclasses.dataclass(frozen=True)
class Inner:
    gain: float = setting(30.0, "how strongly", unit="1/s", low=0.0, high=100.0)
    word: str = setting("yes", "a word that YAML would take for true: " + "on and on " * 20)


@dataclasses.dataclass(frozen=True)
class Outer:
    count: int = setting(3, "how many", low=1)
    name: str = setting("", "may be empty")
    inner: Inner = setting(Inner)
    place: tuple[float, ...] = setting((1.0, 2.5), "where", unit="m")
    nobody: list[str] = setting([], "nobody yet")


def parameters(text, node="sonde"):
    return yaml.safe_load(text)["/**"][node]["ros__parameters"]


def test_the_file_gives_back_the_settings_it_was_made_of():
    settings = Outer(5, "Ann: the 'best'", Inner(0.5), (7.0,), ["a", "b"])
    read = parameters(config.parameter_file("sonde", settings))
    assert read.pop("autostart") is True
    assert read.pop("frame_prefix") == "auto"
    assert from_mapping(Outer, read) == settings
    assert list(read) == list(to_mapping(settings))


def test_every_setting_has_its_meaning_unit_and_bounds_above_it():
    lines = config.parameter_file("sonde", Outer()).splitlines()
    at = next(k for k, line in enumerate(lines) if line.strip() == "gain: 30.0")
    assert lines[at - 1].strip() == "# how strongly [1/s] (0 to 100)"
    # A group is indented below its name.
    assert len(lines[at]) - len(lines[at].lstrip()) == 8
    for k, line in enumerate(lines[6:], start=6):
        if ":" in line and not line.lstrip().startswith("#") and line.strip() != "inner:":
            assert lines[k - 1].lstrip().startswith("# "), line


def test_a_number_with_a_point_keeps_it_and_a_text_stays_a_text():
    text = config.parameter_file("sonde", Outer())
    # ROS refuses 30 where a parameter is declared as 30.0, and true where it is a text.
    assert "gain: 30.0\n" in text
    assert "count: 3\n" in text
    assert parameters(text)["inner"]["word"] == "yes"
    assert parameters(text)["name"] == ""


def test_an_empty_list_is_one_empty_text_because_a_parameter_file_has_none():
    assert parameters(config.parameter_file("sonde", Outer()))["nobody"] == [""]


def test_lines_keep_within_their_length():
    assert max(map(len, config.parameter_file("sonde", Outer()).splitlines())) <= 120


def test_the_file_holds_for_a_node_in_any_namespace():
    assert list(yaml.safe_load(config.parameter_file("estimator", Inner()))) == ["/**"]
    assert "gain" in parameters(config.parameter_file("estimator", Inner()), "estimator")


def test_the_shipped_file_is_of_this_form():
    path = ROOT / "mwd_sensors" / "config" / "sonde.yaml"
    assert parameters(path.read_text(encoding="utf-8"))["scenario"] == "default"


@dataclasses.dataclass(frozen=True)
class InnerOfTable:
    gain: float = setting(0.5, "Gain | of it.", unit="1/s", low=0.0, high=2.0, expert=True)


@dataclasses.dataclass(frozen=True)
class Table:
    inner: InnerOfTable = setting(InnerOfTable, "Inner")
    mode: str = setting("a", "What to do.", choices=("a", "b"))
    axes: tuple[float, float] = setting((1.0, 2.0), "Both axes.", low=0.1)
    on: bool = setting(True, "Do it.")


def test_users_parameters_come_first_and_say_type_default_unit_and_range():
    plain, expert = config.parameter_tables(Table()).split("### For experts")
    assert "| `mode` | string | a |  | a, b | What to do. |" in plain
    assert "| `axes` | double[] | 1, 2 |  | at least 0.1 | Both axes. |" in plain
    assert "| `on` | bool | true |" in plain
    assert "| `inner.gain` | double | 0.5 | 1/s | 0 to 2 | Gain \\| of it. |" in expert
    assert "For experts" not in config.parameter_tables(InnerOfTable())
