# SPDX-License-Identifier: Apache-2.0
"""The survey list on disk survives kills, half writes and edits, and says what happened."""

import dataclasses
import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mwd_estimation.core.north import North
from mwd_estimation.survey.survey import Survey
from mwd_surface.surveys import survey_store
from mwd_surface.surveys.leg import TieOn
from mwd_surface.surveys.list_rules import ListRules
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_store import StoreError, SurveyStore
from mwd_surface.surveys.well import Well

WELL, RULES = Well(name="Åsgard Ω-1"), ListRules()
COVARIANCE = (1e-6, 0.0, 0.0, 0.0, 1e-4, 0.0, 0.0, 0.0, 1e-6)


def grown(whole, count=1):
    for _ in range(count):
        k = whole.next_sequence
        survey = Survey(
            k * 10**9, f"u{k}", k, math.radians(0.1 * (k % 300)), 1.0, int(North.TRUE), covariance=COVARIANCE
        )
        whole = whole.add(survey, 30.0 * k, 0.1)
    return whole


def saved_twice(folder):
    """Folder with three surveys in the current file and two in the one before."""
    two = grown(SurveyList(well=WELL), 2)
    three = grown(two)
    with SurveyStore(folder) as store:
        store.save(two)
        store.save(three)
    return two, three


def loaded(folder, well=WELL):
    with SurveyStore(folder) as store:
        return store.load(well, RULES)


def test_a_new_folder_holds_an_empty_list(tmp_path):
    got = loaded(tmp_path / "deep" / "well")
    assert got.surveys.records == ()
    assert got.messages == ()


def test_what_was_saved_comes_back_to_the_last_bit_and_the_one_before_is_kept(tmp_path):
    two, three = saved_twice(tmp_path)
    assert loaded(tmp_path).surveys == three
    assert survey_store.decoded((tmp_path / "surveys.previous.json").read_bytes()) == two


@pytest.mark.fault_case(69)
@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda data: data[: len(data) // 2], "incomplete or not JSON"),
        (lambda _data: b"", "incomplete or not JSON"),
        (lambda data: data.replace(b'"azimuth":1.0', b'"azimuth":1.5', 1), "edited or corrupted"),
        (lambda data: bytes([data[100] ^ 1]).join([data[:100], data[101:]]), ""),
        (lambda data: b"\xff\xfe" + data, "incomplete or not JSON"),
        (lambda _data: b"[1, 2]", "not a survey list"),
        (lambda _data: b"[" * 200_000, "nested 200000 levels deep"),
        (lambda data: data.replace(b'"version": 1', b'"version": 9', 1), "version 9, this program reads 1"),
    ],
)
def test_a_damaged_file_gives_way_to_the_one_before_and_both_are_kept(tmp_path, damage, says):
    two, _ = saved_twice(tmp_path)
    current = tmp_path / "surveys.json"
    broken = damage(current.read_bytes())
    current.write_bytes(broken)
    got = loaded(tmp_path)
    assert got.surveys == two
    assert says in got.messages[0]
    assert "kept as surveys.damaged-1.json" in got.messages[0]
    assert "read from surveys.previous.json" in got.messages[1]
    assert (tmp_path / "surveys.damaged-1.json").read_bytes() == broken
    assert (tmp_path / "surveys.previous.json").exists()


def test_two_damaged_files_are_both_kept_and_an_empty_list_says_so(tmp_path):
    saved_twice(tmp_path)
    for name in ("surveys.json", "surveys.previous.json"):
        (tmp_path / name).write_text("{")
    got = loaded(tmp_path)
    assert got.surveys.records == ()
    assert "no complete survey list is left" in got.messages[-1]
    assert {p.name for p in tmp_path.glob("*damaged*")} == {"surveys.damaged-1.json", "surveys.damaged-2.json"}


def test_a_missing_current_file_is_reported(tmp_path):
    two, _ = saved_twice(tmp_path)
    (tmp_path / "surveys.json").unlink()
    got = loaded(tmp_path)
    assert got.surveys == two
    assert "surveys.json was missing" in got.messages[0]


def test_saving_goes_on_after_a_fall_back(tmp_path):
    saved_twice(tmp_path)
    (tmp_path / "surveys.json").write_text("{")
    with SurveyStore(tmp_path) as store:
        again = grown(store.load(WELL, RULES).surveys)
        store.save(again)
    assert loaded(tmp_path).surveys == again


@pytest.mark.fault_case(69)
def test_every_single_truncation_is_noticed(tmp_path):
    saved_twice(tmp_path)
    data = (tmp_path / "surveys.json").read_bytes()
    # The last byte is the line's end, without which the content is still whole.
    for cut in range(0, len(data) - 1, 37):
        with pytest.raises(ValueError, match="incomplete or not JSON"):
            survey_store.decoded(data[:cut])


def test_two_processes_cannot_keep_lists_in_one_folder(tmp_path):
    with SurveyStore(tmp_path), pytest.raises(StoreError, match=r"another process \(\d+\) keeps its survey list"):
        SurveyStore(tmp_path)
    SurveyStore(tmp_path).close()


def test_a_place_that_is_no_folder_is_refused_in_words(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="cannot write the survey list"):
        SurveyStore(tmp_path / "file" / "below")


def test_a_disk_that_refuses_leaves_the_files_as_they_were(tmp_path, monkeypatch):
    _, three = saved_twice(tmp_path)
    before = {p.name: p.read_bytes() for p in tmp_path.glob("surveys*.json")}

    def full(_handle):
        raise OSError(28, "No space left on device")

    with SurveyStore(tmp_path) as store:
        monkeypatch.setattr(os, "fsync", full)
        with pytest.raises(StoreError, match=r"not saved .* No space left on device"):
            store.save(grown(three))
    assert {n: (tmp_path / n).read_bytes() for n in before} == before


@pytest.mark.parametrize("late", ["rename", "sync"])
def test_after_a_late_error_the_list_is_the_old_one_or_the_new_one(tmp_path, monkeypatch, late):
    _, three = saved_twice(tmp_path)
    four = grown(three)

    def refused(*_arguments):
        raise OSError(5, "Input/output error")

    renamed = Path.replace

    def rename(path, target):
        return refused() if path.name == "surveys.writing.json" else renamed(path, target)

    with SurveyStore(tmp_path) as store:
        with monkeypatch.context() as disk:
            if late == "rename":
                disk.setattr(Path, "replace", rename)
            else:
                disk.setattr(survey_store, "sync_folder", refused)
            with pytest.raises(StoreError, match="not saved"):
                store.save(four)
        kept = store.load(four.well, four.rules)
        assert kept.surveys.records == (three if late == "rename" else four).records
        assert not kept.messages


def test_another_well_or_an_impossible_north_is_reported(tmp_path):
    tied = grown(SurveyList(well=WELL)).tied_on(TieOn(10.0, 0.01, 0.2, 1.0, 1.0, 10.0))
    with SurveyStore(tmp_path) as store:
        store.save(tied)
    got = loaded(tmp_path, dataclasses.replace(WELL, name="other", north_reference="grid"))
    assert "belongs to well 'Åsgard Ω-1', but the configuration names 'other'" in got.messages[0]
    assert "true north stays in force" in got.messages[1]
    assert got.surveys.well == dataclasses.replace(WELL, name="other")


WRITER = """
import sys
sys.path[:0] = {path!r}
from mwd_surface.surveys.survey_store import SurveyStore
from mwd_surface.surveys.list_rules import ListRules
from mwd_surface.surveys.well import Well
sys.path.insert(0, {here!r})
from test_survey_store import RULES, WELL, grown
with SurveyStore({folder!r}) as store:
    whole = store.load(WELL, RULES).surveys
    while True:
        whole = grown(whole)
        store.save(whole)
        print(len(whole.records), flush=True)
"""


@pytest.mark.slow
@pytest.mark.fault_case(58)
def test_kill_9_in_the_middle_of_writing_loses_no_reported_survey(tmp_path):
    """Each round ends a writer without warning at another moment; what it had reported saved must be there."""
    here = os.path.dirname(__file__)  # noqa: PTH120
    code = WRITER.format(path=[p for p in sys.path if p], here=here, folder=str(tmp_path))
    for k in range(4):
        with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as writer:
            reported = int(writer.stdout.readline())
            deadline = time.monotonic() + 0.003 * (k + 1)
            while time.monotonic() < deadline:
                reported = int(writer.stdout.readline())
            writer.send_signal(signal.SIGKILL)
            rest = writer.stdout.read().split()
            reported = int(rest[-1]) if rest else reported
        got = loaded(tmp_path)
        assert got.messages == ()
        assert len(got.surveys.records) in (reported, reported + 1)


def test_the_file_is_text_that_people_can_read(tmp_path):
    saved_twice(tmp_path)
    text = (tmp_path / "surveys.json").read_text(encoding="utf-8")
    assert "Åsgard Ω-1" in text
    assert len(text.splitlines()) == 5
    assert json.loads(text)["list"]["records"][0]["survey"]["uuid"] == "u1"


def test_a_list_that_cannot_be_written_leaves_the_files_as_they_were(tmp_path):
    with SurveyStore(tmp_path) as store:
        whole = grown(SurveyList(well=WELL), 2)
        store.save(whole)
        before = store.current.read_bytes()
        bad = whole.with_records([dataclasses.replace(one, comment="\ud800") for one in whole.records])
        with pytest.raises(ValueError, match="surrogates"):
            store.save(bad)
        assert store.current.read_bytes() == before
