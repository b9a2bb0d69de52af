# SPDX-License-Identifier: Apache-2.0
"""Settings: what is wrong is named with its place, unit, bound and near miss; what is refused changes nothing."""

import dataclasses

import pytest

from mwd_sensors.core.settings import SettingsError, changed, flat, from_mapping, rule_of, setting, to_mapping


@dataclasses.dataclass(frozen=True)
class Filter:
    gain: float = setting(0.5, "proportional gain", unit="1/s", low=0.0, high=10.0)
    mode: str = setting("slow", "how fast", choices=("slow", "fast"))


@dataclasses.dataclass(frozen=True)
class Node:
    rate: int = setting(100, "output", unit="Hz", low=1, high=2000)
    filter: Filter = setting(Filter, "the filter")
    place: tuple[float, float] = setting((0.0, 0.0), "where", low=-90.0, high=90.0)
    names: list[str] = setting(["a"], "who")
    limit: float | None = setting(None, "optional", low=0.0)
    parts: tuple[Filter, ...] = setting((), "many")

    def __post_init__(self):
        if self.rate == 13:
            raise ValueError("13 brings bad luck")


@dataclasses.dataclass(frozen=True)
class Needed:
    depth_m: float = setting(doc="must be given")


def test_defaults_round_trip_through_plain_tables():
    assert from_mapping(Node, to_mapping(Node())) == Node()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"rat": 5}, "rat: no such setting; did you mean rate"),
        ({"filter": {"gian": 1.0}}, "filter.gian: no such setting; did you mean gain"),
        ({"zzz": 1}, "known: rate, filter"),
        ({"rate": 0}, "rate: 0 Hz is below the lowest allowed, 1 Hz"),
        ({"filter": {"gain": 11.0}}, "filter.gain: 11 1/s is above the highest allowed, 10 1/s"),
        ({"filter": {"gain": float("nan")}}, "must be finite"),
        ({"filter": {"gain": "1"}}, "decimal point"),
        ({"filter": {"mode": "fats"}}, "did you mean fast"),
        ({"rate": 5.0}, "a whole number"),
        ({"rate": True}, "a whole number"),
        ({"place": [1.0]}, "expected 2 values, got 1"),
        ({"place": [1.0, 91.0]}, r"place\[1\]: 91 is above"),
        ({"place": "north"}, "expected a list"),
        ({"names": [1]}, r"names\[0\]: expected text"),
        ({"limit": -1.0}, "limit: -1 is below"),
        ({"parts": [{"gain": -1.0}]}, r"parts\[0\].gain"),
        ({"filter": 3}, "filter: expected a table"),
        ({"rate": 13}, "bad luck"),
    ],
)
def test_what_is_wrong_is_named(given, message):
    with pytest.raises(SettingsError, match=message):
        from_mapping(Node, given)


def test_a_setting_without_default_must_be_given():
    with pytest.raises(SettingsError, match=r"depth_m: must be given.*\[m\]"):
        from_mapping(Needed, {})
    assert from_mapping(Needed, {"depth_m": 3}).depth_m == 3.0


def test_whole_numbers_do_for_real_ones_and_none_for_optional_ones():
    node = from_mapping(Node, {"filter": {"gain": 2}, "limit": None})
    assert node.filter.gain == 2.0
    assert isinstance(node.filter.gain, float)


def test_leaves_have_dotted_names_and_their_rules():
    leaves = flat(Node())
    assert list(leaves)[:3] == ["rate", "filter.gain", "filter.mode"]
    value, rule = leaves["filter.gain"]
    assert value == 0.5
    assert rule.text() == "proportional gain [1/s] (0 to 10)"
    assert "one of slow, fast" in leaves["filter.mode"][1].text()


@pytest.mark.fault_case(85)
def test_changes_are_all_or_nothing():
    node = Node()
    assert changed(node, {"filter.gain": 1.0, "rate": 50}) == Node(rate=50, filter=Filter(gain=1.0))
    with pytest.raises(SettingsError, match=r"filter\.gain"):
        changed(node, {"rate": 50, "filter.gain": 99.0})
    with pytest.raises(SettingsError, match=r"filter\.gane: no such setting; did you mean filter\.gain"):
        changed(node, {"filter.gane": 1.0})
    assert node == Node()


def test_instances_do_not_share_their_lists():
    first = Node()
    first.names.append("b")
    assert Node().names == ["a"]


def test_bounds_are_printed_to_the_last_digit():
    @dataclasses.dataclass(frozen=True)
    class Seeds:
        seed: int = setting(1, "seed", low=-1, high=2_147_483_647)
        share: float = setting(0.5, "share", low=0.0, high=2.5)

    assert rule_of(dataclasses.fields(Seeds)[0]).text() == "seed (-1 to 2147483647)"
    with pytest.raises(SettingsError, match="seed: 2147483648 is above the highest allowed, 2147483647;"):
        from_mapping(Seeds, {"seed": 2_147_483_648})
    with pytest.raises(SettingsError, match=r"share: 2.75 is above the highest allowed, 2.5;"):
        from_mapping(Seeds, {"share": 2.75})


@dataclasses.dataclass(frozen=True)
class Worded:
    north: str = setting("best", "north", choices=("best", "true", "off"))
    name: str = setting("", "any text")


def test_a_word_that_yaml_takes_for_a_truth_value_is_the_choice_it_spells():
    assert from_mapping(Worded, {"north": True}).north == "true"
    assert from_mapping(Worded, {"north": False}).north == "off"
    with pytest.raises(SettingsError, match="name: expected text, got True"):
        from_mapping(Worded, {"name": True})
