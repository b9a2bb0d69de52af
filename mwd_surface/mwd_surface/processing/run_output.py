# SPDX-License-Identifier: Apache-2.0
"""
Output files of a run: attitude in the requested format, surveys, faults of sensors; complete, or not at all.

The format mcap is a copy of the recording with the estimates added to the original messages, for players and viewers.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.fault_messages import describe
from mwd_estimation.core.sensor_fault import SensorFault
from mwd_estimation.pipeline.output import Output
from mwd_estimation.survey.decided_survey import DecidedSurvey
from mwd_estimation.survey.survey import Survey
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.settings import setting
from mwd_surface.bags.bag_reader import Bag, MessagePart
from mwd_surface.bags.merged_bag import MergedBag, merged_bag
from mwd_surface.processing import attitude_csv
from mwd_surface.processing.bag_input import InputSettings, find_topics
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


# Topics of the estimator, relative to the namespace of the IMU.
_TOPICS = {
    "attitude": wire.ATTITUDE,
    "gravity": wire.GRAVITY,
    "interference": wire.INTERFERENCE,
    "dynamics": wire.DYNAMICS,
}
_SURVEY, _SURVEY_TYPE = "survey", Survey.MESSAGE
_IMU = "imu/data_raw"


def end_rows(output: Output) -> NDArray[np.int64]:
    """Return, for each survey, the index of the first attitude row at or after its end, or of the last row."""
    newest = np.maximum.accumulate(output.attitude["stamp_ns"])
    return np.searchsorted(newest, [survey.end_ns for survey in output.surveys]).clip(max=len(newest) - 1)


class Thinner:
    """
    Selector of the first row of streams in each interval of equal length, independent of the block boundaries.

    rate_hz : largest number of rows per second; 0 keeps every row.
    """

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = round(1e9 / rate_hz) if rate_hz > 0.0 else 0
        self._last = -1

    def __call__(self, stamp_ns: NDArray[np.int64]) -> slice | NDArray[np.bool_]:
        """Return which rows of a block to keep, by their stamps, shape (n,), ns: the first of each period, or all."""
        if self._period_ns <= 0 or not len(stamp_ns):
            return slice(None)
        intervals = stamp_ns // self._period_ns
        picked: NDArray[np.bool_] = np.diff(intervals, prepend=self._last) != 0
        self._last = int(intervals[-1])
        return picked


class Merger:
    """
    Writer of a copy of a recording with the estimates, while the estimator runs.

    Parameters
    ----------
    merged : MergedBag
        Writer of the copy.
    imu_topic : str
        Topic of the IMU; the estimates get the namespace of this topic and the log times of its messages.
    thinner : Thinner
        Thinner of attitude and gravity.
    """

    def __init__(self, merged: MergedBag, imu_topic: str, thinner: Thinner) -> None:
        self.remarks: list[str] = []  #: sentences on topics that have another name than usual
        self.frame = wire.SONDE_FRAME  #: frame of the estimates; set it before the first call of `take`
        self._thinner = thinner
        self._merged = merged
        namespace = imu_topic.removesuffix(_IMU) if imu_topic.endswith(_IMU) else imu_topic.rpartition("/")[0] + "/"
        self._channels = {}
        self._last_ns = 0
        self._definitions = self._merged.definitions
        types = {relative: layout.type_name for relative, layout in _TOPICS.items()} | {_SURVEY: _SURVEY_TYPE}
        for relative, type_name in types.items():
            self._channels[relative], name = self._merged.topic(namespace + relative, type_name)
            if name != namespace + relative:
                self.remarks.append(f"the recording has {namespace}{relative} already; the new one is {name}")

    def take(
        self,
        output: Output | None,
        log_ns: NDArray[np.int64] | None,
        originals: list[MessagePart],
        until_ns: int | None,
    ) -> None:
        """
        Write the next results and messages.

        output, log_ns : results of IMU samples, and the log time of each sample. originals : messages of the recording.
        until_ns : no message logged up to this time will follow.
        """
        for one in originals:
            self._merged.add_originals(one)
            self._last_ns = max(self._last_ns, int(one.log_ns[-1])) if len(one.log_ns) else self._last_ns
        if output is not None and log_ns is not None and len(log_ns):
            stamps = output.attitude["stamp_ns"]
            picked = self._thinner(stamps)
            self._add("attitude", output.attitude[picked], log_ns[picked])
            self._add("gravity", output.gravity[picked], log_ns[picked])
            # Give these samples the log time of the IMU sample with the same stamp, or of the next IMU sample.
            newest = np.maximum.accumulate(stamps)
            for relative, samples in (("interference", output.interference), ("dynamics", output.dynamics)):
                at = np.minimum(np.searchsorted(newest, samples["stamp_ns"]), len(newest) - 1)
                self._add(relative, samples, np.maximum.accumulate(log_ns[at]))
            # Give each survey the log time of the first sample at or after its end, or of the last sample.
            for survey, at in zip(output.surveys, end_rows(output), strict=True):
                self._write_survey(survey, int(log_ns[at]))
        elif output is not None:
            # These surveys come after the last sample: give them the log time of the last message.
            for survey in output.surveys:
                self._write_survey(survey, self._last_ns)
        if until_ns is not None:
            self._merged.flush(until_ns)

    def _add(self, relative: str, samples: Samples, log_ns: NDArray[np.int64]) -> None:
        if len(samples):
            self._merged.add_rows(self._channels[relative], _TOPICS[relative].encode(samples, self.frame), log_ns)

    def _write_survey(self, survey: DecidedSurvey, log_ns: int) -> None:
        data = np.frombuffer(self._serialised(survey), dtype=np.uint8)
        self._merged.add_rows(self._channels[_SURVEY], data[None, :], np.array([log_ns]))

    def _serialised(self, survey: DecidedSurvey) -> bytes:
        message = survey.record(self.frame).to_message(self._definitions.make)
        return bytes(self._definitions.typestore.serialize_cdr(message, _SURVEY_TYPE))
