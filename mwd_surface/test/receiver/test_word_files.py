# SPDX-License-Identifier: Apache-2.0
"""The tables that `mwd decode` writes."""

import pytest
from csv_rows import rows_of
from example_words import received

from mwd_surface.receiver.words import BY_CONSISTENCY, ERASED, WordFiles, surveys_csv, words_csv

WORD = received("Inc", 31.5)


def test_a_survey_has_what_its_consistency_chose_marked_and_nothing_for_what_was_erased():
    chosen = received("Azm", 47.25, index=1, confidence=0.8, status=BY_CONSISTENCY)
    words = [WORD, chosen, received("DipA", 70.0, index=2, status=ERASED)]
    (row,) = rows_of(surveys_csv(words))
    assert float(row["Inc_deg"]) == pytest.approx(WORD.value, abs=1e-3)
    assert float(row["Azm_deg"]) == pytest.approx(chosen.value, abs=1e-3)
    assert row["DipA_deg"] == ""
    assert row["by_consistency"] == "Azm"


def test_words_are_on_disk_as_soon_as_they_are_final(tmp_path):
    later = received("Azm", 47.25, index=1)
    with WordFiles(tmp_path) as files:
        for k, words in enumerate(([WORD], [later]), 1):
            files.add(words)
            assert (tmp_path / "words.csv").read_text() == words_csv([WORD, later][:k])
            assert (tmp_path / "surveys.csv").read_text() == surveys_csv([WORD, later][:k])
    assert sorted(file.name for file in tmp_path.iterdir()) == ["surveys.csv", "words.csv"]
