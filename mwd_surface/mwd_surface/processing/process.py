# SPDX-License-Identifier: Apache-2.0
"""
`mwd process`: compute attitude and surveys from a recording, and write them with the settings in force to a folder.

Results appear completely or not at all.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mwd_estimation.core.sensor_fault import FaultCode
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.calibration.compensation import Compensation
from mwd_sensors.core import settings
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.processing.bag_estimate import BagEstimate
from mwd_surface.processing.bag_input import InputSettings
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
    bag : Bag
    folder : Path
        Created if it does not exist; other files in it are not changed.
    estimator, given : settings
        Settings of the estimator and of the input.
    progress : callable
        Called with the completed share, 0 to 1.
    compensation : Compensation, optional
        Calibration of the AHRS, applied to its samples first.
    wanted : OutputSettings, optional recorded : Recorded, optional
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

    def processed(estimator: EstimatorSettings) -> Summary:
        with drafts(folder) as draft:
            with destination(draft, bag, wanted, given) as (sink, merger):
                run = BagEstimate(
                    bag,
                    estimator,
                    given,
                    compensation=compensation,
                    smooth=wanted.smooth,
                    merger=merger,
                    recorded=recorded,
                )
                summary = run.run(sink, progress)
            texts = {
                "surveys.csv": survey_csv.text(survey_csv.list_cells(summary.listed)),
                "surveys.json": encoded(summary.listed).decode(),
                "faults.csv": fault_text(summary.faults),
                CONFIG: config_text(estimator, given, wanted, summary.topics),
                INPUT: input_text(bag.path, given, calibrated=compensation is not None),
            }
            for name, text in texts.items():
                (draft / name).write_text(text, encoding="utf-8")
            # List the attitude first, because it is the main result.
            attitude = [file.name for file in draft.iterdir() if file.name not in texts]
            summary.files = [*attitude, *texts]
        return summary

    summary = processed(estimator)
    if (changed := reversed_settings(estimator, summary)) is not None:
        summary = processed(changed)
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
