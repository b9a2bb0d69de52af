# SPDX-License-Identifier: Apache-2.0
"""Each reader has a budget: small inputs that ask for much end in a sentence, within a memory limit and in time."""

from __future__ import annotations

import dataclasses
import os
import shutil
from pathlib import Path

import pytest

import bombs
import forked_command
from mwd_sensors.core import budgets
from mwd_sensors.core.input_files import read_file
from mwd_surface.nodes.settings import SurfaceSettings
from project import GOLDEN, ROOT

BAG = str(GOLDEN / "stations" / "bag")
#: Address space of a command, bytes: libraries and compiled code take half of it, a bomb more than the rest.
MEMORY = 3 * 10**9


BUDGETS = [value for value in vars(budgets).values() if isinstance(value, budgets.Budget)]


def mwd(*words: object) -> str:
    """Run a command under the limit; returns the one sentence with which it must end."""
    status, output = forked_command.run(*words, memory=MEMORY, timeout_s=120.0)
    assert status in (1, 2), output
    assert output
    assert "Traceback" not in output
    return output


def table() -> str:
    """All budgets as the Markdown table of SECURITY.md."""
    rows = ["| input | bytes | piece unpacked | records | columns | days | nesting |", "|---|---|---|---|---|---|---|"]
    for one in BUDGETS:
        cells = [
            "any" if one.size >= 2**62 else f"{one.size:_}".replace("_", " "),
            *(
                "" if value is None else f"{value:_}".replace("_", " ")
                for value in (one.unpacked, one.records, one.columns)
            ),
            "" if one.seconds is None else f"{one.seconds / 86_400.0:g}",
            "" if one.nesting is None else str(one.nesting),
        ]
        rows.append(f"| {one.reads} | {' | '.join(cells)} |")
    return "\n".join(rows)


def test_the_table_of_the_security_page_is_that_of_the_code():
    assert table() in (ROOT / "SECURITY.md").read_text(encoding="utf-8")


def servers(settings, name=""):
    """Every settings record of a server, with its name: those that can be allowed on the network."""
    for field in dataclasses.fields(settings):
        inner, path = getattr(settings, field.name), f"{name}.{field.name}".lstrip(".")
        if dataclasses.is_dataclass(inner):
            if hasattr(inner, "allow_network"):
                yield path, inner
            yield from servers(inner, path)


def test_every_server_has_a_limit_of_connections_in_the_table_of_the_security_page():
    page, found = (ROOT / "SECURITY.md").read_text(encoding="utf-8"), dict(servers(SurfaceSettings()))
    # The library of the Foxglove server has no limit.
    del found["foxglove"]
    assert "page" in found
    for name, settings in found.items():
        limit = "max_connections" if hasattr(settings, "max_connections") else "max_clients"
        of_one = f"{settings.max_per_peer} (`{name}.max_per_peer`) |" if hasattr(settings, "max_per_peer") else "|"
        assert f"| {name} | {getattr(settings, limit)} (`{name}.{limit}`) | {of_one}\n" in page


def test_every_budget_bounds_something():
    assert all(one.size < 2**62 or one.unpacked or one.records for one in BUDGETS)


@pytest.mark.slow(0.5)
@pytest.mark.fault_case(84)
@pytest.mark.parametrize("kind", bombs.YAML)
def test_yaml_bombs_end_in_a_sentence(kind, tmp_path):
    file = tmp_path / "bomb.yaml"
    bombs.YAML[kind](file)
    mwd("simulate", file, "-o", tmp_path / "out")
    # The same file as the metadata of a bag: the recording beside it is read without it, or refused.
    bag = tmp_path / "bag"
    bag.mkdir()
    shutil.copy(file, bag / "metadata.yaml")
    mwd("inspect", bag)


@pytest.mark.slow(0.5)
@pytest.mark.fault_case(66)
@pytest.mark.parametrize("kind", bombs.MCAP)
@pytest.mark.parametrize("command", ["inspect", "recover"])
def test_recordings_that_unpack_without_measure_end_in_a_sentence(kind, command, tmp_path):
    file = tmp_path / "bomb.mcap"
    bombs.MCAP[kind](file)
    assert file.stat().st_size < 10**6
    mwd(command, file)


@pytest.mark.slow(0.5)
@pytest.mark.parametrize(("make", "name"), [(bombs.packed_file, "a.mcap.zstd"), (bombs.endless_view, "a.db3")])
def test_packed_files_and_databases_that_compute_their_rows_end_in_a_sentence(make, name, tmp_path):
    make(tmp_path / name)
    mwd("inspect", tmp_path / name)


@pytest.mark.slow(0.5)
@pytest.mark.parametrize("command", ["inspect", "recover"])
@pytest.mark.parametrize("kind", bombs.ROS1)
def test_ros_1_chunks_that_unpack_without_measure_end_in_a_sentence(kind, command, tmp_path):
    bombs.ROS1[kind](tmp_path / "a.bag")
    said = mwd(command, tmp_path / "a.bag")
    assert "unpacked" in said or "unpacks" in said


@pytest.mark.slow(0.5)
def test_ros_1_chunks_that_alternate_in_time_are_unpacked_once_each(tmp_path):
    bombs.alternating_chunks(tmp_path / "a.bag")
    # The time limit of `mwd` is the test: a chunk for each message takes minutes.
    assert "has no topic" in mwd("inspect", tmp_path / "a.bag")


@pytest.mark.slow(0.5)
@pytest.mark.parametrize("kind", bombs.RUNS)
def test_results_of_runs_that_unpack_without_measure_end_in_a_sentence(kind, tmp_path):
    bombs.RUNS[kind](tmp_path / "run")
    assert "attitude" in mwd("compare", tmp_path / "run", tmp_path / "run")


# Name: command, with {} for the file, that reads JSON, an observatory record, captured bytes or a table.
READERS = {
    "survey list": ("{}.json", ("export", "{}.json", "-f", "csv")),
    "observatory": ("{}.min", ("process", BAG, "-o", "out", "--set", "place.observatory_file={}.min")),
    "serial line": ("{}.bin", ("decode", "{}.bin", "--tool", "tool.yaml", "-o", "out")),
    "calibration": ("{}.yaml", ("process", BAG, "-o", "out", "--calibration", "{}.yaml")),
    "table of depths": ("{}.csv", ("process", BAG, "-o", "out", "--depths", "{}.csv")),
}


@pytest.mark.slow(0.5)
@pytest.mark.parametrize("kind", bombs.FILES)
@pytest.mark.parametrize("reader", READERS)
def test_files_that_are_endless_or_nested_without_end_end_in_a_sentence(reader, kind, tmp_path):
    name, words = READERS[reader]
    (tmp_path / "tool.yaml").write_text("pulse_width_s: 0.8\n")
    bombs.FILES[kind](tmp_path / name.format("x"))
    inside = {"out", "tool.yaml"}
    mwd(*(tmp_path / word if word in inside else word.format(tmp_path / "x") for word in words))


@pytest.mark.slow(0.5)
@pytest.mark.parametrize("kind", bombs.FILES)
def test_secrets_and_certificates_that_are_endless_end_in_a_sentence(kind, tmp_path):
    bombs.FILES[kind](tmp_path / "secret")
    for one in (budgets.SECRET, dataclasses.replace(budgets.CERTIFICATE, size=100_000)):
        with pytest.raises(OSError, match="larger than"):
            read_file(tmp_path / "secret", one)


@pytest.mark.slow(0.5)
def test_packed_messages_that_hold_gigabytes_end_in_a_sentence(tmp_path):
    bombs.packed_messages(tmp_path / "packed")
    mwd("process", tmp_path / "packed" / "bag", "-o", tmp_path / "out")


@pytest.mark.slow(0.5)
@pytest.mark.parametrize("kind", bombs.SHEETS)
def test_spreadsheets_that_unpack_without_measure_end_in_a_sentence(kind, tmp_path):
    bombs.SHEETS[kind](tmp_path / "a.xlsx")
    mwd("path", tmp_path / "a.xlsx", "-o", tmp_path / "out")


@pytest.mark.slow(0.5)
@pytest.mark.parametrize("kind", bombs.WAV)
def test_wav_files_that_claim_or_last_too_much_end_in_a_sentence(kind, tmp_path):
    bombs.WAV[kind](tmp_path / "a.wav")
    (tmp_path / "tool.yaml").write_text("pulse_width_s: 0.8\n")
    mwd("decode", tmp_path / "a.wav", "--tool", tmp_path / "tool.yaml", "-o", tmp_path / "out")


@pytest.mark.slow(0.5)
def test_a_pressure_file_of_rows_far_apart_is_refused(tmp_path):
    bombs.far_rows(tmp_path / "far.csv")
    (tmp_path / "tool.yaml").write_text("pulse_width_s: 0.8\n")
    words = mwd("decode", tmp_path / "far.csv", "--tool", tmp_path / "tool.yaml", "-o", tmp_path / "out")
    assert "cut the file" in words


@pytest.mark.slow(0.5)
@pytest.mark.fault_case(83)
@pytest.mark.parametrize("name", bombs.LISTS)
def test_lists_that_take_minutes_to_parse_end_in_a_sentence(name, tmp_path):
    bombs.LISTS[name](tmp_path / name)
    mwd("path", tmp_path / name, "-o", tmp_path / "out")


COMMANDS: dict[str, tuple[str, ...]] = {
    "simulate": ("simulate", "{}.yaml", "-o", "out"),
    "inspect": ("inspect", "{}.mcap"),
    "process": ("process", "{}.mcap", "-o", "out"),
    "recover": ("recover", "{}.mcap"),
    "path": ("path", "{}.csv", "-o", "out"),
    "survey": ("survey", "{}.csv", "-o", "out"),
    "export": ("export", "{}.json", "-f", "csv"),
    "decode": ("decode", "{}.csv", "--tool", "tool.yaml", "-o", "out"),
    "decode a WAV": ("decode", "{}.wav", "--tool", "tool.yaml", "-o", "out"),
    "inspect ROS 1": ("inspect", "{}.bag"),
    "inspect db3": ("inspect", "{}.db3"),
    "plot": ("plot", "{}.mcap", "-o", "out"),
}


@pytest.mark.slow(0.3)
@pytest.mark.parametrize("place", bombs.PLACES)
@pytest.mark.parametrize("name", COMMANDS)
def test_no_command_waits_for_a_pipe_a_device_or_a_folder(name, place, tmp_path):
    words = [str(tmp_path / word.format("x")) if "." in word or word == "out" else word for word in COMMANDS[name]]
    (tmp_path / "tool.yaml").write_text("pulse_width_s: 0.8\n")
    bombs.PLACES[place](Path(words[1]))
    assert os.path.lexists(words[1])
    mwd(*words)
