# SPDX-License-Identifier: Apache-2.0
"""Estimates for a recording with sensor data only, for commands that show or export estimates."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mwd_surface.bags.bag_reader import Bag
    from mwd_surface.processing.bag_input import InputSettings
    from mwd_surface.processing.run_config import ProcessedInput


@contextlib.contextmanager
def estimated(bag: Bag, given: InputSettings, read: ProcessedInput | None = None) -> Iterator[Bag]:
    """
    Process a recording into a temporary copy that contains the estimates.

    given: settings for reading the recording. read: input settings of existing results, used instead of `given` if
    `given` has only default values.

    Raises
    ------
    BagError, ValueError
        The recording cannot be processed, as in `process.process`.
    """
    import tempfile

    from mwd_estimation.settings.estimator import EstimatorSettings
    from mwd_surface.bags.bag_reader import Bag as Opened
    from mwd_surface.commands import terminal
    from mwd_surface.processing import process
    from mwd_surface.processing.bag_input import InputSettings
    from mwd_surface.processing.run_output import MERGED, OutputSettings
    from mwd_surface.surveys.recorded_settings import recorded_settings, with_a_model

    recorded = recorded_settings(bag)
    begin = read.estimator if read is not None else recorded.estimator or EstimatorSettings()
    estimator, remark = with_a_model(begin, bag.start_ns)
    for former in read.remarks if read is not None else ():
        terminal.warn(former)
    if read is not None and read.calibrated:
        terminal.warn("shown without the calibration of these results; `mwd process --format mcap` includes it")
    if read is not None and given == InputSettings():
        given = read.given
    with tempfile.TemporaryDirectory(prefix="mwd_estimated_") as scratch, terminal.progress("processing") as progress:
        folder = Path(scratch) / "out"
        wanted = OutputSettings(format="mcap")
        summary = process.process(bag, folder, estimator, given, progress, None, wanted, recorded)
        for warning in [remark, *summary.warnings] if remark else summary.warnings:
            terminal.warn(warning)
        with Opened(folder / MERGED) as merged:
            yield merged
