# SPDX-License-Identifier: Apache-2.0
"""
Survey list of a file, of the folder of a well or run, or of a recording, with its slide sheet.

Files are only read, so a list that a running surface node keeps can be exported at the same time.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from mwd_estimation.core.north import North
from mwd_sensors.core import budgets
from mwd_sensors.core.input_files import read_file
from mwd_surface.bags.bag_files import is_cut_off
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.list_files.list_columns import Given
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.list_file import is_list, read_list
from mwd_surface.list_files.remark import sentences
from mwd_surface.list_files.station_list import StationList
from mwd_surface.surveys.imported_list import survey_list
from mwd_surface.surveys.message_conversion import list_of
from mwd_surface.surveys.recorded_settings import recorded_settings
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_store import NotWholeError, decoded
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.slide_sheet import NAME, DrilledStretch, read_stretches

LIST_TYPE, PATH_TYPE = "mwd_msgs/msg/SurveyList", "mwd_msgs/msg/Trajectory"
_NO_WELL = (
    "this recording does not carry the description of the well: names, datum and section azimuth are defaults unless"
    " given with --set"
)
FILES = ("surveys.json", "surveys.previous.json")


class NoSurveyListError(BagError):
    """Raised if a recording has no survey list, because no surface node recorded it."""


def surveys_of(path: Path, given: Given | None = None) -> tuple[SurveyList, tuple[str, ...]]:
    """
    Return a survey list, and notes for people on the origin of the list.

    Parameters
    ----------
    path : Path
        A surveys.json, an imported list of stations (CSV, LAS, WITSML), a folder with a surveys.json in it or below
        (the folder of a run), or a recording.
    given : Given, optional
        Options for reading a list of stations. None: the caller has no such options, and an error that asks for one
        refers to `mwd path`.

    Raises
    ------
    ValueError
        The file is not a complete survey list, or the folder has lists of several wells.
    NoSurveyListError
        The recording has no survey list.
    BagError
        The path does not exist, or the list of the recording cannot be read.
    """
    if path.is_file() and path.suffix == ".json":
        try:
            return _remarked(decoded(read_file(path, budgets.JSON)))
        except NotWholeError as error:
            raise ValueError(
                f"{path.name}: {error}; a JSON file is read only if it is a survey list of this program: export other"
                " lists as CSV, .xlsx, LAS or WITSML"
            ) from error
    if is_list(path):
        return _remarked(survey_list(_read(path, given)))
    folders = _folders(path) if path.is_dir() else []
    if len(folders) > 1:
        raise ValueError(f"{path} has survey lists of several wells: {', '.join(str(f) for f in folders)}; name one")
    if folders:
        return _stored(folders[0])
    with Bag(path) as bag:
        surveys = surveys_of_bag(bag)
        notes = () if recorded_settings(bag).surface is not None else (_NO_WELL,)
        if not bag.complete or is_cut_off(bag.path):
            # The last list that can be read may be older than the last list that was recorded.
            text = f"{path} is cut off or damaged; surveys and decisions in the lost part are not in the list"
            notes = (*notes, f"{text}; use the surveys folder of the run if it exists")
        return surveys, notes


def _read(path: Path, given: Given | None) -> StationList:
    """Return the stations of an imported list; without `given`, an error that asks for options names `mwd path`."""
    try:
        return read_list(path, given)
    except ListFileError as error:
        if given is not None or "--" not in str(error):
            raise
        raise ListFileError(
            f"{error}. Options that say how a list is read are those of `mwd path`: run mwd path {path} -o DIR with"
            " them, and give DIR here"
        ) from error


def stretches_of(path: Path) -> tuple[tuple[DrilledStretch, ...], tuple[str, ...]]:
    """
    Return the slide sheet that belongs to the list of `surveys_of`, and notes for people; empty for a recording.

    Raises
    ------
    OSError
        The file of the slide sheet cannot be read.
    """
    listed = path.is_file() and path.suffix == ".json"
    folders = [path.parent] if listed else _folders(path) if path.is_dir() else []
    stretches, bad = read_stretches(folders[0] / NAME) if folders else ((), 0)
    return stretches, (f"{bad} lines of {folders[0] / NAME} cannot be read",) if bad else ()


def surveys_of_bag(bag: Bag) -> SurveyList:
    """
    Return the last survey list of a recording, with its legs and plan.

    Raises
    ------
    NoSurveyListError
        The recording has no survey list.
    BagError
        The recording has lists of several wells, or no list that can be read.
    """
    if all(topic.type_name != LIST_TYPE for topic in bag.topics.values()):
        if unread := bag.unread(LIST_TYPE):
            raise BagError(f"{bag.path} has no survey list that can be read: {unread}")
        hint = f"`mwd process {bag.path} -o out` computes a survey list"
        raise NoSurveyListError(f"{bag.path} has no survey list: no surface unit recorded it", hint)
    topic = bag.find_topic(LIST_TYPE, "surveys")
    last = None
    for _, _, _, data in bag.messages([topic]):
        last = data
    if last is None:
        raise BagError(f"{bag.path} has no message in {topic}", "export from the surveys folder of the run")
    message = bag.decode(topic, last)
    well = recorded_settings(bag).well(Well(name=message.well or Well().name))
    north = _north(bag, topic.removesuffix("surveys") + "trajectory")
    if north is not None:
        well = dataclasses.replace(well, north_reference=north.name.lower())
    return list_of(message, well)


def _folders(path: Path) -> list[Path]:
    for pattern in ("", "surveys", "*/surveys", "*/*/surveys"):
        found = [path] if not pattern else sorted(path.glob(pattern))
        kept = [folder for folder in found if any((folder / name).is_file() for name in FILES)]
        if kept:
            return kept
    return []


def _stored(folder: Path) -> tuple[SurveyList, tuple[str, ...]]:
    why = []
    for name in FILES:
        if not (folder / name).is_file():
            continue
        try:
            surveys = decoded(read_file(folder / name, budgets.JSON))
        except ValueError as error:
            why.append(f"{folder / name} is not complete ({error})")
            continue
        if name != FILES[0]:
            why.append(f"surveys read from {name}: the last change may be missing")
        return _remarked(surveys, why)
    raise ValueError("; ".join(why))


def _remarked(surveys: SurveyList, notes: Sequence[str] = ()) -> tuple[SurveyList, tuple[str, ...]]:
    """Return the list, and the sentences of its remarks followed by the notes."""
    return surveys, (*sentences(surveys.remarks), *notes)


def _north(bag: Bag, topic: str) -> North | None:
    """Return the north of the recorded path; None if it is not recorded."""
    about = bag.topics.get(topic)
    found = North.UNKNOWN
    if about is not None and about.type_name == PATH_TYPE:
        last = None
        for _, _, _, data in bag.messages([topic]):
            last = data
        found = North.UNKNOWN if last is None else North(bag.decode(topic, last).north_reference)
    return None if found == North.UNKNOWN else found
