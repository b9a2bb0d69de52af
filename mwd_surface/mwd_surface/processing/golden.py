# SPDX-License-Identifier: Apache-2.0
"""
Golden recordings: a short bag with its expected results, and the allowed differences of new results from these.

A golden folder holds the input, `bag/`, `config.yaml` (settings of the estimator that differ from the default) and
`limits.yaml` (name -> limit and its reason, see `compare.LIMITS`), and the results, `surveys.csv` and `attitude.csv`
(one row per second, to keep it small).
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_surface.bags.bag_files import recording_of
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.processing import compare, process, run_config, run_folder
from mwd_surface.surveys.recorded_settings import recorded_settings

_KEPT_EVERY_NS = 1_000_000_000  # interval of the attitude rows that are kept, ns


def is_golden(folder: Path) -> bool:
    """Return whether the folder holds a golden recording: a bag and the limits of its results."""
    return (folder / "bag").is_dir() and (folder / "limits.yaml").is_file()


def is_recording(path: Path) -> bool:
    """Return whether the path is a recording or a folder that holds one; False for results of `mwd process`."""
    path = recording_of(path)
    if path.is_file():
        return path.suffix in (".mcap", ".db3")
    return (path / "metadata.yaml").is_file() or any(path.glob("*.mcap"))


def limits_of(folder: Path) -> dict[str, float]:
    """
    Return the limits that belong to an expected run; empty if the folder has no limits.yaml.

    Raises
    ------
    ValueError
        limits.yaml is not valid.
    """
    file = folder / "limits.yaml"
    return compare.read_limits(file) if file.is_file() else {}


@contextmanager
def processed(path: Path, like: Path) -> Iterator[Path]:
    """
    Yield a folder of results: `path`, or, if `path` is a recording, a temporary folder with the recording's results.

    The recording is processed with the settings of the results `like`.

    Raises
    ------
    BagError, ValueError, OSError
        The recording cannot be processed.
    """
    if not is_recording(path):
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="mwd_compare_") as folder:
        run = Path(folder) / "run"
        _process(path, like, run)
        yield run


def accept(golden: Path) -> None:
    """
    Replace the expected results of a golden recording by the results of this version.

    Raises
    ------
    ValueError
        `golden` lacks its bag or its limits.
    BagError, OSError
        The bag cannot be processed, or the results cannot be written.
    """
    if not is_golden(golden):
        raise ValueError(f"{golden} is not a golden recording: it needs bag/ and limits.yaml")
    limits_of(golden)
    with tempfile.TemporaryDirectory(prefix="mwd_golden_") as folder:
        run = Path(folder) / "run"
        _process(golden / "bag", golden, run)
        _keep_some(run / "attitude.csv", golden / "attitude.csv")
        shutil.copyfile(run / "surveys.csv", golden / "surveys.csv")


def _process(path: Path, like: Path, run: Path) -> None:
    config = like / "config.yaml"
    estimator = run_config.estimator_config(config) if config.is_file() else EstimatorSettings()
    with Bag(path) as bag:
        process.process(bag, run, estimator, recorded=recorded_settings(bag))
    if not run_folder.is_run(run):
        raise ValueError(f"{path}: processing gave no results to compare")


def _keep_some(source: Path, target: Path) -> None:
    """Copy the header and the first row of every second as text, so that no number is rounded twice."""
    last = -1
    with source.open(encoding="utf-8") as rows, target.open("w", encoding="utf-8") as kept:
        kept.write(next(rows))
        for row in rows:
            second = int(row.split(",", 1)[0]) // _KEPT_EVERY_NS
            if second != last:
                kept.write(row)
                last = second
