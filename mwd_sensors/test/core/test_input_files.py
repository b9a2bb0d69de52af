# SPDX-License-Identifier: Apache-2.0
"""Files that would be read without end, and YAML that would fill the memory."""

import dataclasses
import os

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.core import budgets
from mwd_sensors.core.budgets import BudgetError
from mwd_sensors.core.input_files import check_lines, load_yaml, read_file, read_text, read_yaml
from mwd_sensors.core.settings import SettingsError
from mwd_sensors.simulator.scenario import parse

BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{new}: &{new} [{', '.join(['*' + old] * 9)}]\n" for old, new in zip("abcdefgh", "bcdefghi", strict=True)
)


def test_a_device_a_pipe_and_a_folder_are_refused_at_once(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path in (pipe, tmp_path, "/dev/zero"):
        with pytest.raises(OSError, match=r"not a regular file|directory"):
            read_file(path, budgets.YAML)


def test_a_file_beyond_its_limit_is_refused_and_one_at_it_is_read(tmp_path):
    file = tmp_path / "list"
    file.write_bytes(b"x" * 100)
    assert read_file(file, dataclasses.replace(budgets.YAML, size=100)) == b"x" * 100
    with pytest.raises(OSError, match="larger than"):
        read_file(file, dataclasses.replace(budgets.YAML, size=99))


def test_a_byte_order_mark_is_no_text(tmp_path):
    file = tmp_path / "list"
    file.write_bytes(b"\xef\xbb\xbfmd")
    assert read_text(file, budgets.YAML) == "md"


@pytest.mark.fault_case(84)
@pytest.mark.parametrize(
    ("text", "why"),
    [
        (BOMB, "at most 200000"),
        ("&a [*a]", "contains it"),
        ("[" * 20_000, "levels deep"),
        ("{a: " * 20_000, "levels deep"),
        ("!!python/object/apply:os.system [id]", "constructor"),
        ("a: 1\nb: {c: 1, d: [2], 'c': 3}", "line 2: a key occurs twice"),
    ],
)
def test_yaml_that_attacks_its_reader_is_refused_in_a_sentence(text, why):
    with pytest.raises(yaml.YAMLError, match=why):
        load_yaml(text)
    with pytest.raises(SettingsError, match="not readable as YAML"):
        parse(text)


def test_a_text_in_another_encoding_is_named_by_its_file(tmp_path):
    file = tmp_path / "plan.yaml"
    file.write_bytes("name: t".encode("utf-16"))
    with pytest.raises(SettingsError, match=r"plan\.yaml is not UTF-8 text"):
        read_yaml(file)


def test_one_key_may_stand_in_several_tables_and_beside_one_that_is_merged():
    text = "base: &b {x: 1, y: 1}\nother: {<<: *b, y: 2}\nlist: [{x: 1}, {x: 2}]\nx: {x: x}"
    assert load_yaml(text)["other"] == {"x": 1, "y": 2}


@given(st.lists(st.sampled_from("a,\n\r\v\f\x1c\x1d\x1e\x85\u2028\u2029\t "), max_size=60).map("".join))
def test_lines_are_counted_as_the_readers_split_them(text):
    count = len(f"{text}.".splitlines())
    budget = dataclasses.replace(budgets.LIST, records=count)
    check_lines(f"{text}.", budget)
    if count > 1:
        with pytest.raises(BudgetError, match="records"):
            check_lines(f"{text}.", dataclasses.replace(budget, records=count - 1))
