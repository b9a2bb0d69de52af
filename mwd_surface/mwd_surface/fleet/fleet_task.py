# SPDX-License-Identifier: Apache-2.0
"""Task of a worker, in another process or on another machine: compute the rows of one recording for the data set."""

from __future__ import annotations

import dataclasses
import math
import os
import socket
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import yaml

from mwd_estimation.pipeline.output import Output
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.survey import Verdict
from mwd_sensors.core import settings as settings_of
from mwd_surface import __version__
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.fleet import fleet_dataset
from mwd_surface.fleet.attitude_statistics import AttitudeStatistics
from mwd_surface.fleet.fleet_dataset import DONE, FAILED
from mwd_surface.processing import bag_input, process
from mwd_surface.processing.bag_estimate import BagEstimate
from mwd_surface.processing.bag_input import InputSettings, wells
from mwd_surface.processing.run_summary import Summary
from mwd_surface.signals.table import SURVEY_TABLE
from mwd_surface.surveys.recorded_settings import Recorded, recorded_settings, with_a_model
from mwd_surface.surveys.survey_csv import list_cells


@dataclasses.dataclass(frozen=True)
class FleetWork:
    """Recording to process, with the settings for it."""

    bag: str  #: path of the recording
    folder: str  #: folder of the data set
    config: str  #: settings of the estimator as YAML, so that all workers use the same settings
    given: InputSettings  #: settings for reading the recording
    #: changes to the settings that the recording contains, as YAML; if it is empty, `config` is used for every
    #: recording
    changes: str = ""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """Outcome of a recording: its row of the table `bags`, and whether an earlier run had written the row."""

    bag: str
    key: str  #: key of the results; empty if the recording could not be read
    row: dict[str, Any]
    kept: bool = False


def config_text(estimator: EstimatorSettings) -> str:
    """Return all settings of the estimator as YAML."""
    return changes_text(settings_of.to_mapping(estimator))


def changes_text(changes: Mapping[str, Any]) -> str:
    """Return changed settings as YAML."""
    text: str = yaml.safe_dump(dict(changes), sort_keys=True)
    return text


def carry_out(work: FleetWork) -> Outcome:
    """
    Process a recording and write its rows, unless the rows exist.

    For a recording that cannot be processed, return an outcome with the reason. A full disk raises OSError.
    """
    began = time.monotonic()
    path, folder = Path(work.bag), Path(work.folder)
    try:
        key = fleet_dataset.key_of(path, f"{work.config}\0{work.given!r}\0{work.changes}", __version__)
    except OSError as error:
        return failed(work, "", f"cannot be read: {error.strerror or error}", began)
    earlier = fleet_dataset.finished(folder, key)
    if earlier is not None:
        return Outcome(work.bag, key, earlier, kept=True)
    try:
        tables = _tables(path, key, work, began)
    except (BagError, ValueError) as error:
        outcome = failed(work, key, str(error), began)
        tables = {"bags": [outcome.row]}
    fleet_dataset.write(folder, key, tables)
    return Outcome(work.bag, key, tables["bags"][0])


def failed(work: FleetWork, key: str, reason: str, began: float | None = None) -> Outcome:
    """Return the outcome of a recording that failed."""
    return Outcome(work.bag, key, _row(work, key, began) | {"outcome": FAILED, "reason": reason, "warnings": []})


def _row(work: FleetWork, key: str, began: float | None) -> dict[str, Any]:
    """Return the row of table `bags` with the columns that every recording has; the other columns are None."""
    return dict.fromkeys(fleet_dataset.SCHEMAS["bags"].names) | {
        "key": key,
        "bag": work.bag,
        "bytes": _bytes(Path(work.bag)),
        "version": __version__,
        "worker": f"{socket.gethostname()}:{os.getpid()}",
        "elapsed_s": time.monotonic() - began if began is not None else None,
    }


def _tables(path: Path, key: str, work: FleetWork, began: float) -> dict[str, list[dict[str, Any]]]:
    tables: dict[str, list[dict[str, Any]]] = {"surveys": [], "attitude": []}
    found: list[Summary] = []
    with Bag(path) as bag:
        recorded = recorded_settings(bag) if work.changes else Recorded()
        estimator, remark = with_a_model(_settings(recorded, work), bag.start_ns)
        for topics in wells(bag, work.given):
            given = dataclasses.replace(work.given, imu_topic=topics.imu)
            summary, statistics = _estimated(bag, estimator, given, recorded)
            if (changed := process.reversed_settings(estimator, summary)) is not None:
                summary, statistics = _estimated(bag, changed, given, recorded)
                summary.warnings.insert(0, process.REVERSED)
            where = {"key": key, "bag": work.bag, "well": summary.topics.imu.removesuffix(bag_input.IMU).strip("/")}
            tables["attitude"] += [{**where, **row} for row in statistics.rows()]
            tables["surveys"] += [{**where, **_survey_row(line)} for line in list_cells(summary.listed)]
            found.append(summary)
        found[0].warnings += [remark] if remark else []
    tables["bags"] = [_bag_row(work, key, found, estimator, began)]
    return tables


def _estimated(
    bag: Bag, estimator: EstimatorSettings, given: InputSettings, recorded: Recorded
) -> tuple[Summary, AttitudeStatistics]:
    statistics = AttitudeStatistics()

    def take(output: Output) -> None:
        statistics.add(output.attitude, output.gravity)

    return BagEstimate(bag, estimator, given, recorded=recorded).run(take), statistics


def _settings(recorded: Recorded, work: FleetWork) -> EstimatorSettings:
    """Return the settings in the recording with `work.changes`, or `work.config` if the recording has no settings."""
    if recorded.estimator is None:
        return settings_of.from_mapping(EstimatorSettings, yaml.safe_load(work.config))
    return settings_of.changed(recorded.estimator, yaml.safe_load(work.changes))


def _survey_row(cells: Mapping[str, str]) -> dict[str, Any]:
    """Return the cells of a survey as numbers, booleans and texts, by column; an unknown number is None."""
    read: dict[str, Callable[[str], Any]] = {"Double": float, "Int64": int, "Boolean": "yes".__eq__, "String": str}
    return {
        listed.key: read[signal.type](text) if (text := cells[listed.key]) or signal.type == "String" else None
        for signal, listed in SURVEY_TABLE
    }


def _bag_row(
    work: FleetWork, key: str, found: list[Summary], estimator: EstimatorSettings, began: float
) -> dict[str, Any]:
    verdicts = [Verdict(record.survey.verdict).word for one in found for record in one.listed.records]
    lowest = [one.lowest for one in found if not math.isnan(one.lowest)]
    highest = [one.highest for one in found if not math.isnan(one.highest)]
    return _row(work, key, began) | {
        "outcome": DONE,
        "reason": "",
        "wells": len(found),
        "samples": sum(one.rows for one in found),
        "seconds": sum(one.seconds for one in found),
        "start_ns": min(one.start_ns for one in found),
        "end_ns": max(one.end_ns for one in found),
        "samples_rejected": sum(one.rejected for one in found),
        "gaps": sum(one.gaps for one in found),
        "samples_without_gravity": sum(one.without_gravity for one in found),
        "samples_without_azimuth": sum(one.without_azimuth for one in found),
        "inclination_lowest_deg": math.degrees(min(lowest)) if lowest else None,
        "inclination_highest_deg": math.degrees(max(highest)) if highest else None,
        "surveys": len(verdicts),
        **{
            f"surveys_{word}": verdicts.count(verdict)
            for word, verdict in (("accepted", "accept"), ("doubtful", "doubtful"), ("rejected", "reject"))
        },
        "method": estimator.gravity.method,
        "reference": "; ".join(dict.fromkeys(one.reference for one in found)),
        "north": "; ".join(dict.fromkeys(one.north for one in found)),
        "warnings": [warning for one in found for warning in one.warnings],
    }


def _bytes(path: Path) -> int:
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())
