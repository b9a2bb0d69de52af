# SPDX-License-Identifier: Apache-2.0
"""The tables that `mwd decode` writes."""

import csv
import dataclasses
import io

from mwd_surface.receiver.word_files import WordFiles, surveys_csv, words_csv
from mwd_surface.receiver.words import BELIEVED, BY_CONSISTENCY, ERASED, ReceivedWord

WORD = ReceivedWord(0.0, 8.0, 4, 0, "survey", "Inc", "deg", 7, 31.5, 0.999, 0.04, BELIEVED, ())


def test_a_survey_has_what_its_consistency_chose_marked_and_nothing_for_what_was_erased():
    words = [
        WORD,
        dataclasses.replace(WORD, index=1, name="Azm", value=47.25, confidence=0.8, status=BY_CONSISTENCY),
        dataclasses.replace(WORD, index=2, name="DipA", status=ERASED),
    ]
    (row,) = csv.DictReader(io.StringIO(surveys_csv(words)))
    assert (row["Inc_deg"], row["Azm_deg"], row["DipA_deg"]) == ("31.5", "47.25", "")
    assert row["by_consistency"] == "Azm"


def test_words_are_on_disk_as_soon_as_they_are_final(tmp_path):
    later = dataclasses.replace(WORD, index=1, name="Azm", value=47.25)
    with WordFiles(tmp_path) as files:
        for k, words in enumerate(([WORD], [later]), 1):
            files.add(words)
            assert (tmp_path / "words.csv").read_text() == words_csv([WORD, later][:k])
            assert (tmp_path / "surveys.csv").read_text() == surveys_csv([WORD, later][:k])
    assert sorted(file.name for file in tmp_path.iterdir()) == ["surveys.csv", "words.csv"]
