# SPDX-License-Identifier: Apache-2.0
"""Output files of a run: attitude in the requested format, surveys, faults of sensors; complete, or not at all."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from mwd_estimation.core.fault_messages import describe
from mwd_estimation.core.sensor_fault import SensorFault
from mwd_estimation.pipeline.output import Output
from mwd_sensors.core.settings import setting
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.merged_bag import merged_bag
from mwd_surface.processing import attitude_csv
from mwd_surface.processing.bag_input import InputSettings, find_topics
from mwd_surface.processing.merger import Merger, Thinner
from mwd_surface.signals import cells

FORMATS = ("csv", "parquet", "mcap")
MERGED = "merged"
_SURVEYS = ("surveys.csv", "surveys.json")
CONFIG, INPUT = "config.yaml", "input.yaml"
_RESULTS = ("attitude.csv", "attitude.parquet", MERGED, *_SURVEYS, "faults.csv", CONFIG, INPUT)
FAULT_COLUMNS = ("since_ns", "cleared_ns", "severity", "sensor", "axis", "kind", "confidence", "message", "remedy")


@dataclasses.dataclass(frozen=True)
class OutputSettings:
    """Choice of the output."""

    format: str = setting("csv", "Format of the attitude file.", choices=FORMATS)
    rate_hz: float = setting(
        0.0, "Largest number of rows per second; 0: one row for every IMU message.", unit="Hz", low=0.0
    )
    smooth: bool = setting(False, "Smooth gravity with later samples. Works with the method bounded only.")


def results_in(folder: Path) -> list[Path]:
    """Return the files in a folder, and the folder `MERGED`, that are results of `mwd process`."""
    return [folder / name for name in _RESULTS if (folder / name).is_symlink() or (folder / name).exists()]


@contextlib.contextmanager
def drafts(folder: Path) -> Iterator[Path]:
    """
    Yield a temporary folder next to `folder` for results.

    The results are moved to `folder` if the `with` block ends normally, and deleted otherwise.

    Earlier results in `folder` are deleted in every format, so that the folder never mixes the results of two calls of
    `mwd process`; other files stay.

    Raises
    ------
    OSError
        `folder` is a file, or it cannot be created or written.
    """
    if folder.exists() and not folder.is_dir():
        raise NotADirectoryError(20, "it is a file, not a folder", str(folder))
    folder.parent.mkdir(parents=True, exist_ok=True)
    draft = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=".unfinished", dir=folder.parent))
    try:
        yield draft
        if folder.exists():
            for old in results_in(folder):
                if old.is_dir() and not old.is_symlink():
                    shutil.rmtree(old)
                else:
                    old.unlink()
            for file in sorted(draft.iterdir()):
                file.replace(folder / file.name)
        else:
            draft.chmod(0o777 & ~_umask())
            draft.rename(folder)
    finally:
        shutil.rmtree(draft, ignore_errors=True)


@contextlib.contextmanager
def destination(
    folder: Path, bag: Bag, wanted: OutputSettings, given: InputSettings
) -> Iterator[tuple[Callable[[Output], None], Merger | None]]:
    """Yield the function that writes the attitude of each block, and the merger for the format mcap, else None."""
    thinner = Thinner(wanted.rate_hz)
    if wanted.format == "mcap":
        with merged_bag(folder / MERGED, bag) as merged:
            yield lambda _output: None, Merger(merged, find_topics(bag, given).imu, thinner)
        return
    if wanted.format == "parquet":
        # Import only if needed: loading this module takes longer than processing a short recording.
        from mwd_surface.processing import attitude_parquet

        with contextlib.closing(attitude_parquet.ParquetWriter(folder / "attitude.parquet")) as writer:

            def write_table(output: Output) -> None:
                picked = thinner(output.attitude["stamp_ns"])
                writer.write(output.attitude[picked], output.gravity[picked])

            yield write_table, None
        return
    with (folder / "attitude.csv").open("wb") as file:
        file.write(attitude_csv.HEADER.encode() + b"\n")
        lines = attitude_csv.CsvLines()

        def write_lines(output: Output) -> None:
            picked = thinner(output.attitude["stamp_ns"])
            file.write(lines(output.attitude[picked], output.gravity[picked]))

        yield write_lines, None


def fault_text(faults: list[SensorFault]) -> str:
    """Return faults.csv: one line each time a fault was found, narrowed down or cleared, in order of these events."""
    return cells.table(
        FAULT_COLUMNS,
        (
            dataclasses.asdict(text)
            | {"since_ns": fault.since_ns, "cleared_ns": fault.cleared_ns or ""}
            | {"confidence": cells.fixed(text.confidence, 2)}
            for fault, text in ((fault, describe(fault)) for fault in faults)
        ),
    )


def _umask() -> int:
    now = os.umask(0)
    os.umask(now)
    return now
