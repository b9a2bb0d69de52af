# SPDX-License-Identifier: Apache-2.0
"""The same list from its file, the folder of a run and a recording; what is ambiguous is refused with a reason."""

import dataclasses

import example_surveys as example
import plotted_bag
import pytest
from plotted_bag import recorded

from mwd_surface.bags.bag_reader import BagError
from mwd_surface.exports.csv_tables import definitive_csv
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.surveys.leg import Origin, TieOn
from mwd_surface.surveys.recorded_settings import ESTIMATOR, SURFACE
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_source import stretches_of, surveys_of
from mwd_surface.surveys.survey_store import SurveyStore, encoded
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.plan import plan_of
from mwd_surface.trajectory.slide_sheet import NAME, append_stretch


def without_well(surveys):
    """What a recording can give back: all but the description of the well, and the tool for surveys to come."""
    well = Well(surveys.well.name, north_reference=surveys.well.north_reference)
    return dataclasses.replace(surveys.configured(well, surveys.rules), tool="")


def test_a_file_a_folder_and_the_folder_of_a_run_give_the_same_list(tmp_path):
    surveys = example.surveys()
    with SurveyStore(tmp_path / "run" / "w1" / "surveys") as store:
        store.save(surveys)
        # Also while the node that keeps the list is running.
        for path in ("run", "run/w1", "run/w1/surveys", "run/w1/surveys/surveys.json"):
            assert surveys_of(tmp_path / path) == (surveys, ())


def test_a_recording_gives_the_last_list_with_its_tie_on_and_its_north(tmp_path):
    whole = example.surveys()
    tied = whole.tied_on(TieOn(100.0, 0.02, 1.0, 1.0, 2.0, 99.0, Origin.RECORDED))
    got, notes = surveys_of(recorded(tmp_path / "bag", [whole, tied]))
    assert got == without_well(tied)
    assert "description of the well" in notes[0]


def test_a_list_of_a_recording_that_was_cut_off_is_said_to_lack_what_was_lost(tmp_path):
    """Exports of an interrupted recording were written as definitive, without its last surveys and without a word."""
    surveys = example.surveys()
    folder = recorded(tmp_path / "bag", [surveys])
    assert not any("cut off" in note for note in surveys_of(folder)[1])
    (file,) = folder.glob("*.mcap")
    file.write_bytes(file.read_bytes()[:-100])
    got, notes = surveys_of(folder)
    assert got == without_well(surveys)
    assert any("cut off or damaged" in note for note in notes)


def test_a_recording_without_a_path_begins_at_the_wellhead(tmp_path):
    well = dataclasses.replace(example.WELL, north_reference="true")
    surveys = example.surveys(well)
    got, _ = surveys_of(recorded(tmp_path / "bag", [surveys], trajectory=False))
    assert got == without_well(surveys)


def test_a_recording_with_the_settings_of_the_surface_gives_the_well_and_its_place(tmp_path):
    surveys = example.surveys()
    told = {"well.name": "Alpha", "well.rig": "Rig 7", "well.sensor_to_bit": "14.0"}
    place = {"place.field": "model", "place.lat_deg": "58.44", "place.lon_deg": "1.88"}
    tables = {SURFACE: told, ESTIMATOR: place}
    got, notes = surveys_of(recorded(tmp_path / "bag", [surveys], tables=tables))
    assert notes == ()
    assert (got.well.name, got.well.rig, got.well.sensor_to_bit) == ("Alpha", "Rig 7", 14.0)
    assert got.well.north_reference == surveys.well.north_reference
    # The surface was told no place: that of the estimator counts.
    assert (got.well.latitude_deg, got.well.longitude_deg) == (58.44, 1.88)
    assert "58.440000 deg, 1.880000 deg" in definitive_csv(survey_table(got, 0))
    tables[SURFACE] = told | {"well.latitude_deg": "58.5", "well.longitude_deg": "1.9"}
    got, _ = surveys_of(recorded(tmp_path / "own", [surveys], tables=tables))
    assert (got.well.latitude_deg, got.well.longitude_deg) == (58.5, 1.9)


def test_a_recorded_sidetrack_keeps_its_kick_off_and_the_plan(tmp_path):
    planned = plan_of([0.0, 300.0, 700.0], [0.0, 0.0, 0.7], [1.3, 1.3, 1.4], north="grid", name="Ω-1 plan")
    surveys = example.surveys(dataclasses.replace(example.WELL, section_azimuth_deg=None)).along(planned)
    surveys = surveys.sidetracked("st1", 400.0).add(example.survey(20, 15.0, 80.0), 450.0, 0.4)
    got, _ = surveys_of(recorded(tmp_path / "bag", [surveys]))
    assert (got.legs, got.leg, got.plan) == (surveys.legs, "st1", planned)
    assert got.definitive().section_azimuth == surveys.definitive().section_azimuth == planned.section_azimuth
    assert [r.vertical_section for r in got.records] == [r.vertical_section for r in surveys.records]


def test_a_damaged_file_gives_way_to_the_one_before_and_says_so(tmp_path):
    surveys = example.surveys()
    (tmp_path / "surveys.json").write_bytes(encoded(surveys)[:-40])
    with pytest.raises(ValueError, match=r"surveys\.json is not complete"):
        surveys_of(tmp_path)
    (tmp_path / "surveys.previous.json").write_bytes(encoded(surveys))
    got, notes = surveys_of(tmp_path)
    assert got == surveys
    assert len(notes) == 2
    assert "the last change may be missing" in notes[1]


def test_two_wells_in_one_folder_must_be_named(tmp_path):
    for well in ("w1", "w2"):
        (tmp_path / well / "surveys").mkdir(parents=True)
        (tmp_path / well / "surveys" / "surveys.json").write_bytes(encoded(SurveyList()))
    with pytest.raises(ValueError, match="several wells"):
        surveys_of(tmp_path)


@pytest.mark.slow
def test_a_bag_without_surveys_and_an_empty_folder_are_distinguished(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(BagError, match="holds no recording"):
        surveys_of(tmp_path / "empty")
    plotted_bag.record(tmp_path / "bag", topics=("rig/state",), estimate=False, surveys=False)
    with pytest.raises(BagError, match=r"no survey list: .*mwd process .*bag -o out"):
        surveys_of(tmp_path / "bag")


def test_the_slide_sheet_lies_beside_the_list_and_a_recording_has_none(tmp_path):
    folder = tmp_path / "run" / "well_1" / "surveys"
    with SurveyStore(folder) as store:
        store.save(example.surveys())
    assert stretches_of(tmp_path / "run") == ((), ())
    for stretch in example.stretches():
        append_stretch(folder / NAME, stretch)
    for path in (tmp_path / "run", folder, folder / "surveys.json"):
        assert stretches_of(path) == (example.stretches(), ())
    bag = recorded(tmp_path / "bag", [example.surveys()])
    assert stretches_of(bag) == stretches_of(next(bag.glob("*.mcap"))) == ((), ())
    with (folder / NAME).open("a") as file:
        file.write("junk\n")
    assert stretches_of(tmp_path / "run") == (example.stretches(), (f"1 lines of {folder / NAME} cannot be read",))
