# SPDX-License-Identifier: Apache-2.0
"""The state of the rig interfaces as a file: what is written is read, and `mwd rig status` says what there is."""

import dataclasses
import json
import time

import pytest
from typer.testing import CliRunner

from mwd_surface.cli import app
from mwd_surface.rig.interface import InterfaceStatus, PeerStatus
from mwd_surface.rig.status import (
    FILE_NAME,
    RigStatus,
    RigStatusError,
    dated,
    read_status,
    status_files,
    status_lines,
    write_status,
)

PEER = PeerStatus("10.0.0.7:4711", since=40.0, sent=25, rate=0.5, received=3, dropped=1, last="0717123.46")
TABLE = (
    InterfaceStatus(
        "wits0_server",
        "listening",
        "127.0.0.1:8686",
        peers=(PEER,),
        sent=25,
        received=3,
        dropped=1,
        counts=(("junk", 2),),
        last=(("survey", "12"),),
    ),
    InterfaceStatus("modbus", "down", reason="127.0.0.1 port 502 may not be opened by this user"),
)


def test_the_state_reads_as_lines_for_people():
    assert status_lines(TABLE, 100.0) == [
        "wits0_server: listening at 127.0.0.1:8686; out 25, in 3, dropped 1, refused 0, junk 2; last survey 12",
        "  10.0.0.7:4711: 60 s, out 25 (0.50/s), in 3, dropped 1, last 0717123.46",
        "modbus: down; out 0, in 0, dropped 0, refused 0; 127.0.0.1 port 502 may not be opened by this user",
    ]
    assert status_lines((), 0.0) == ["no rig interface is switched on"]


def test_what_is_written_is_read(tmp_path):
    status = RigStatus("well_1", 1000.0, 7, dated(TABLE, 900.0))
    write_status(tmp_path / FILE_NAME, status)
    again = read_status(tmp_path / FILE_NAME)
    assert again == status
    assert again.interfaces[0].peers[0].since == 940.0
    assert [path.name for path in tmp_path.iterdir()] == [FILE_NAME]
    assert again.alive(1004.0)
    assert not again.alive(1006.0)


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", "[" * 200_000, '{"version": 99}', '{"version": 1, "interfaces": [{}]}', "\udcff"]
)
def test_a_file_that_is_no_status_is_named(tmp_path, text):
    (tmp_path / FILE_NAME).write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(RigStatusError, match=FILE_NAME):
        read_status(tmp_path / FILE_NAME)


def test_files_are_found_in_the_folder_of_a_well_of_a_run_and_of_many_runs(tmp_path):
    for place in ("", "well_1", "run_1/well_1", "run_2/well_2", "far/too/deep"):
        (tmp_path / place).mkdir(parents=True, exist_ok=True)
        (tmp_path / place / FILE_NAME).touch()
    found = [str(path.parent.relative_to(tmp_path)) for path in status_files([tmp_path])]
    assert found == [".", "run_1/well_1", "run_2/well_2", "well_1"]


def invoke(*words):
    return CliRunner().invoke(app, ["rig", "status", *map(str, words)])


def test_the_command_shows_what_runs_and_says_what_does_not(tmp_path):
    now = time.time()
    for name, written in (("well_1", now), ("well_2", now - 60.0)):
        (tmp_path / name).mkdir()
        write_status(tmp_path / name / FILE_NAME, RigStatus(name, written, 1, dated(TABLE, written - 100.0)))
    reported = invoke(tmp_path)
    assert reported.exit_code == 0
    assert "wits0_server: listening at 127.0.0.1:8686" in reported.output
    assert "10.0.0.7:4711: 60 s, out 25 (0.50/s)" in reported.output
    assert "well_2" in reported.output
    assert "killed" in reported.output
    (one,) = json.loads(invoke(tmp_path / "well_1", "--json").output)
    assert one["well"] == "well_1"
    assert one["interfaces"][0]["peers"][0]["rate"] == 0.5
    assert one["interfaces"][1] == json.loads(json.dumps(dataclasses.asdict(TABLE[1])))


def test_where_nothing_runs_it_says_what_to_do(tmp_path):
    reported = invoke(tmp_path)
    assert reported.exit_code == 1
    assert "mwd run" in reported.output
    assert json.loads(invoke(tmp_path, "--json").output) == []
