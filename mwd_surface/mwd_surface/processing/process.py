# SPDX-License-Identifier: Apache-2.0
"""
`mwd process`: compute attitude and surveys from a recording, and write them with the settings in force to a folder.

Results appear completely or not at all.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mwd_estimation.core.sensor_fault import FaultCode
from mwd_estimation.pipeline.output import Output
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.calibration.compensation import Compensation
from mwd_sensors.core import settings
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.processing.bag_estimate import BagEstimate
from mwd_surface.processing.bag_input import InputSettings, refuse_damaged, worth_saying
from mwd_surface.processing.merger import Merger
from mwd_surface.processing.run_config import config_text, input_text
from mwd_surface.processing.run_output import (
    CONFIG,
    INPUT,
    OutputSettings,
    destination,
    drafts,
    fault_text,
)
from mwd_surface.processing.run_summary import Summary
from mwd_surface.surveys import survey_csv
from mwd_surface.surveys.recorded_settings import Recorded
from mwd_surface.surveys.survey_store import encoded

REVERSED = (
    "the accelerometer reads gravity instead of specific force: its signs are reversed for these results, as "
    "--accelerometer down does"
)
_AFTER = ("surveys.csv", "surveys.json", "faults.csv", CONFIG, INPUT)  # order of the files listed below the attitude


def process(
    bag: Bag,
    folder: Path,
    estimator: EstimatorSettings,
    given: InputSettings | None = None,
    progress: Callable[[float], None] = lambda _share: None,
    compensation: Compensation | None = None,
    wanted: OutputSettings | None = None,
    recorded: Recorded | None = None,
) -> Summary:
    """
    Write the results of a recording to a folder and return the summary.

    The files are the attitude (by default attitude.csv), surveys.csv, surveys.json, faults.csv, config.yaml and
    input.yaml. surveys.json is the survey list in the form of the surface node, so that `mwd export` and `mwd report`
    can read it. If the results show that the signs of the accelerometer are reversed, the recording is processed again
    with reversed signs (`reversed_settings`).

    Parameters
    ----------
    folder : Path
        Created if it does not exist; other files in it are not changed.
    estimator, given : settings
        Settings of the estimator and of the input.
    progress : callable
        Called with the completed share, 0 to 1.
    compensation : Compensation, optional
        Calibration of the AHRS, applied to its samples first.
    recorded : Recorded, optional
        Settings in the recording, with which its live survey list was made.

    Raises
    ------
    BagError
        The bag is cut off or damaged (unless `given.partial`), or has no IMU sample.
    ValueError
        The settings require a field that no model covers or smooth another method than bounded, or the samples cannot
        be used, for example because the IMU is not in SI.
    OSError
        The folder cannot be written.
    """
    given, wanted = given or InputSettings(), wanted or OutputSettings()
    summary = _processed(bag, folder, estimator, given, progress, compensation, wanted, recorded)
    if (changed := reversed_settings(estimator, summary)) is not None:
        summary = _processed(bag, folder, changed, given, progress, compensation, wanted, recorded)
        summary.warnings.insert(0, REVERSED)
    return summary


def reversed_settings(estimator: EstimatorSettings, summary: Summary) -> EstimatorSettings | None:
    """
    Return settings with the accelerometer reversed if a fault at the end shows wrong signs; otherwise None.

    The result is also None if the settings already reverse the accelerometer, or are those of the live list.
    """
    last = {fault.check: fault for fault in summary.faults}
    standing = [fault for fault in last.values() if not fault.cleared_ns]
    reversals = (FaultCode.SIGN, FaultCode.POINTS_UP)
    shown = any(fault.code in reversals and fault.sensors == (1,) for fault in standing)
    # With the settings of the live list, surveys that the live estimator rejected are rejected again.
    if not shown or estimator.tool.mount.accelerometer != "up" or summary.as_live:
        return None
    return settings.changed(estimator, {"tool.mount.accelerometer": "down"})


def _processed(
    bag: Bag,
    folder: Path,
    estimator: EstimatorSettings,
    given: InputSettings,
    progress: Callable[[float], None],
    compensation: Compensation | None,
    wanted: OutputSettings,
    recorded: Recorded | None,
) -> Summary:
    """Process a bag with these settings, write the results to `folder`, and return their summary."""
    with drafts(folder) as draft:
        with destination(draft, bag, wanted, given) as (sink, merger):
            run = _run_of(bag, estimator, given, compensation, wanted.smooth, merger, recorded)
            summary = _finished(run, bag, given, sink, progress)
        (draft / "surveys.csv").write_text(survey_csv.text(survey_csv.list_cells(summary.listed)), encoding="utf-8")
        (draft / "surveys.json").write_bytes(encoded(summary.listed))
        (draft / "faults.csv").write_text(fault_text(summary.faults), encoding="utf-8")
        config = config_text(estimator, given, wanted, summary.topics)
        (draft / CONFIG).write_text(config, encoding="utf-8")
        read = input_text(bag.path, given, calibrated=compensation is not None)
        (draft / INPUT).write_text(read, encoding="utf-8")
        summary.files = [file.name for file in draft.iterdir()]
        # List the attitude first, because it is the main result.
        summary.files.sort(key=lambda name: _AFTER.index(name) if name in _AFTER else -1)
    return summary


def estimate(
    bag: Bag,
    estimator: EstimatorSettings,
    given: InputSettings,
    sink: Callable[[Output], None],
    recorded: Recorded | None = None,
) -> Summary:
    """
    Run the estimator over a bag and return the summary.

    sink : called with the output of each block, in order, in a separate thread.
    recorded : settings in the recording, with which its live survey list was made.

    Raises
    ------
    BagError, ValueError
        See `process`; an exception of the sink ends the run.
    """
    return _finished(_run_of(bag, estimator, given, recorded=recorded), bag, given, sink, lambda _share: None)


def _run_of(
    bag: Bag,
    estimator: EstimatorSettings,
    given: InputSettings,
    compensation: Compensation | None = None,
    smooth: bool = False,
    merger: Merger | None = None,
    recorded: Recorded | None = None,
) -> BagEstimate:
    if smooth and estimator.gravity.method != "bounded":
        raise ValueError(f"smooth: only the method bounded can be smoothed, not {estimator.gravity.method}")
    return BagEstimate(
        bag, estimator, given, compensation=compensation, smooth=smooth, merger=merger, recorded=recorded
    )


def _finished(
    run: BagEstimate,
    bag: Bag,
    given: InputSettings,
    sink: Callable[[Output], None],
    progress: Callable[[float], None],
) -> Summary:
    refuse_damaged(bag, given)
    summary = run.run(sink, progress)
    # Some damage is found only while reading.
    refuse_damaged(bag, given)
    if summary.rows == 0:
        if given.start_s > (long := (bag.end_ns - bag.start_ns) * 1e-9) > 0.0:
            raise BagError(f"{bag.path} ends after {long:.1f} s, before --start {given.start_s:g}")
        raise BagError(f"{bag.path} has no IMU sample in {run.topics.imu}", "look at the recording with `mwd bag info`")
    summary.warnings += worth_saying(bag)
    return summary
