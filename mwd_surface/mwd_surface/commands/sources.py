# SPDX-License-Identifier: Apache-2.0
"""
Recording, estimates or survey list for a path that a user gives: a recording, a list, or a folder of a run or results.

If a recording has only sensor data, estimates and survey list are computed from these data.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from mwd_surface.commands import terminal

if TYPE_CHECKING:
    from mwd_surface.bags.bag_reader import Bag
    from mwd_surface.list_files.list_columns import Given
    from mwd_surface.processing.bag_input import InputSettings
    from mwd_surface.processing.run_config import ProcessedInput
    from mwd_surface.surveys.survey_list import SurveyList


def recording_at(path: Path) -> Path:
    """Return the path of the recording from which a folder of results was computed; return any other path unchanged."""
    from mwd_surface.bags.bag_files import files_of, recording_of
    from mwd_surface.processing.run_config import processed_input

    if not path.is_dir() or files_of(recording_of(path)):
        return path
    read = processed_input(path)
    return path if read is None else read.recording


def survey_list_at(path: Path, given: Given | None = None) -> tuple[SurveyList, tuple[str, ...]]:
    """
    Return the survey list at a path and notes on its origin, as `surveys_of` does.

    If a recording has no list, a list is computed from the samples of the recording, and is not saved.

    Raises
    ------
    ValueError
        The file is not a complete survey list, or the folder has lists of several wells.
    BagError
        The path does not exist, or the recording has neither a survey list nor samples of an IMU.
    """
    import tempfile

    from mwd_surface.bags.bag_reader import Bag
    from mwd_surface.surveys.survey_source import NoSurveyListError, surveys_of

    try:
        return surveys_of(path, given)
    except NoSurveyListError:
        terminal.remark(f"{path} has no survey list: computing one from the samples, as `mwd process {path}` does")
    with Bag(path) as bag, tempfile.TemporaryDirectory(prefix="mwd_surveys_") as folder:
        _process(bag, Path(folder))
        return surveys_of(Path(folder))


@contextlib.contextmanager
def estimated(bag: Bag, given: InputSettings, read: ProcessedInput | None = None) -> Iterator[Bag]:
    """
    Yield a temporary copy of a recording that also contains the estimates.

    given: settings for reading the recording. read: existing results. Their estimator settings are used, and their
    input settings if `given` has only default values.

    Raises
    ------
    BagError, ValueError
        The recording cannot be processed, as in `process.process`.
    """
    import tempfile

    from mwd_surface.bags.bag_reader import Bag as Opened
    from mwd_surface.processing.run_output import MERGED

    with tempfile.TemporaryDirectory(prefix="mwd_estimated_") as folder:
        _process(bag, Path(folder), "mcap", given, read)
        with Opened(Path(folder) / MERGED) as merged:
            yield merged


def _process(
    bag: Bag,
    folder: Path,
    output_format: str = "csv",
    given: InputSettings | None = None,
    read: ProcessedInput | None = None,
) -> None:
    """Process a recording into a folder with the settings in the recording, or with those of existing results."""
    from mwd_estimation.settings.estimator import EstimatorSettings
    from mwd_surface.processing import process
    from mwd_surface.processing.bag_input import InputSettings
    from mwd_surface.processing.run_output import OutputSettings
    from mwd_surface.surveys.recorded_settings import recorded_settings, with_a_model

    recorded = recorded_settings(bag)
    begin = read.estimator if read is not None else recorded.estimator or EstimatorSettings()
    estimator, remark = with_a_model(begin, bag.start_ns)
    if read is not None:
        terminal.warn(*read.remarks)
        if read.calibrated:
            terminal.warn("shown without the calibration of these results; `mwd process --format mcap` includes it")
        if given == InputSettings():
            given = read.given
    with terminal.progress("processing") as progress:
        wanted = OutputSettings(format=output_format)
        summary = process.process(bag, folder, estimator, given, progress, None, wanted, recorded)
    terminal.warn(*filter(None, (remark, *summary.warnings)))
