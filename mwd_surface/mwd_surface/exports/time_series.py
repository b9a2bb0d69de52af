# SPDX-License-Identifier: Apache-2.0
"""
Recording as a table with one row per second: depth, rig data and attitude with sigmas, in display units.

The row of a whole second has the last known value of each quantity with a stamp in the preceding second. Unknown values
are empty; a second without any value has no row. Memory is constant for any length of the recording.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.logs.recorded_log import topic_of
from mwd_surface.processing.bag_input import InputSettings, named_topic
from mwd_surface.processing.input_stream import SampleStream
from mwd_surface.signals import table
from mwd_surface.signals.cells import fixed, utc
from mwd_surface.signals.table import SERIES
from mwd_surface.signals.units import UnitScale

ATTITUDE, LINK_ATTITUDE, RIG = "attitude", "link/attitude", "rig/state"
NORTHS = ("", "magnetic", "true", "grid")

# Time for which a row waits for samples of other topics and for late samples, s.
_OPEN_S = 30
_BATCH = 3600  # number of rows that are written to a Parquet file at a time
_S = 10**9  # number of ns in a second


class SeriesQuantity(NamedTuple):
    """One column: its name, source field, display unit, decimals, and the value at which it wraps (360 for angles)."""

    key: str
    field: str
    unit: UnitScale
    decimals: int
    wrap: float = 0.0


def _quantities(source: str) -> tuple[SeriesQuantity, ...]:
    return tuple(
        SeriesQuantity(column.key, one.field, one.people, column.decimals, one.wrap)
        for one, column in SERIES
        if one.source == source
    )


# A value of the rig is known if its bit in RigState.valid is set, an angle of the attitude if its sigma is finite.
_RIG_QUANTITIES, _ANGLES = _quantities(table.RIG), _quantities(table.ESTIMATOR)
_SIGMAS = tuple(q._replace(key=f"sigma_{q.key}", field=f"sigma_{q.field}", wrap=0.0) for q in _ANGLES)
QUANTITIES = (*_RIG_QUANTITIES, *_ANGLES, *_SIGMAS)
COLUMNS = ("timestamp_utc_iso", *(q.key for q in QUANTITIES), "azimuth_north")


@dataclasses.dataclass(frozen=True)
class SeriesRow:
    """Row of a whole second: time, s since the epoch, known values by column, and the north of the azimuth."""

    second: int
    values: dict[str, float]
    north: str

    @property
    def time(self) -> str:
        """Time of the row as UTC text."""
        return utc(self.second * _S)


@dataclasses.dataclass
class Written:
    """Result of writing a recording: rows written, samples too late for their row, topics, and remarks."""

    rows: int = 0
    late: int = 0
    topics: tuple[str, ...] = ()
    remarks: list[str] = dataclasses.field(default_factory=list)


def has_attitude(bag: Bag, well: str = "") -> bool:
    """Return whether a recording has the attitude of a well; well: namespace of the well, if there are several."""
    return _attitude_topic(bag, well) is not None


def has_imu(bag: Bag, given: InputSettings) -> bool:
    """Return whether a recording has an IMU from which the attitude can be computed."""
    return bool(given.imu_topic) or any(t.gives == wire.IMU.type_name and t.count for t in bag.topics.values())


def rows(
    bag: Bag,
    written: Written,
    well: str = "",
    given: InputSettings | None = None,
    progress: Callable[[float], None] = lambda _share: None,
) -> Iterator[SeriesRow]:
    """
    Yield the rows of a recording, in order of time.

    Parameters
    ----------
    written : Written
        Counts that are filled during the iteration.
    well : str
        Namespace, needed if the recording has several wells.
    given : InputSettings, optional
        Settings for reading the recording.
    progress : callable
        Called with the completed share, 0 to 1.

    Raises
    ------
    BagError
        There is neither attitude nor rig data, or there are several wells and `well` is empty.
    """
    names = {ATTITUDE: _attitude_topic(bag, well), RIG: topic_of(bag, RIG, wire.RIG_STATE.type_name, well)}
    given = given or InputSettings()
    if given.rig_topic:
        names[RIG] = named_topic(bag, given.rig_topic, wire.RIG_STATE)
    written.topics = tuple(name for name in names.values() if name)
    if not written.topics and (unread := bag.unread(wire.ATTITUDE.type_name, wire.RIG_STATE.type_name)):
        raise BagError(f"{bag.path} has no attitude and no rig data that can be read: {unread}")
    if not written.topics:
        raise BagError(
            f"{bag.path} has neither attitude nor rig data" + (f" of {well}" if well else ""),
            "record the attitude, or the IMU that it is computed from",
        )
    waiting: dict[int, SeriesRow] = {}
    done = -(2**62)
    stream = SampleStream(bag, written.topics, given)
    for block in filter(None, stream.blocks()):
        for relative, take in ((ATTITUDE, _attitude), (RIG, _rig)):
            part = block.get(names[relative] or "")
            if part is not None:
                samples = part[1]
                seconds = -(-samples["stamp_ns"] // _S)
                late = seconds <= done
                written.late += int(np.count_nonzero(late))
                take(samples[~late], seconds[~late], waiting)
        # Use the median stamp of the slowest topic, so that a single wrong stamp has no effect.
        middle = min(int(np.median(part[1]["stamp_ns"])) // _S for part in block.values())
        ready = sorted(second for second in waiting if second < middle - _OPEN_S)
        for second in ready:
            yield waiting.pop(second)
        done = max(done, middle - _OPEN_S - 1)
        logged = max(int(part[0][-1]) for part in block.values())
        progress((logged - bag.start_ns) / max(bag.end_ns - bag.start_ns, 1))
    written.remarks += stream.remarks
    for second in sorted(waiting):
        yield waiting[second]


def write(
    bag: Bag,
    path: Path,
    well: str = "",
    given: InputSettings | None = None,
    progress: Callable[[float], None] = lambda _share: None,
) -> Written:
    """
    Write the rows of a recording as .csv or .parquet, completely or not at all.

    Raises
    ------
    ValueError
        The file name has another ending.
    BagError
        The recording cannot be read, as in `rows`.
    OSError
        The file cannot be written.
    """
    writers = {".csv": _write_csv, ".parquet": _write_parquet}
    if path.suffix not in writers:
        raise ValueError(f"{path}: the ending of a time series must be {' or '.join(writers)}")
    written = Written()

    def counted() -> Iterator[SeriesRow]:
        for row in rows(bag, written, well, given, progress):
            written.rows += 1
            yield row

    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_name(path.name + ".writing")
    try:
        writers[path.suffix](fresh, counted())
        fresh.replace(path)
    finally:
        with contextlib.suppress(FileNotFoundError):
            fresh.unlink()
    return written


def _cells(row: SeriesRow) -> dict[str, str]:
    """Return the rounded numbers of a row as text by column, the same for every kind of file."""
    return {q.key: fixed(row.values.get(q.key), q.decimals, q.wrap) for q in QUANTITIES}


def _write_csv(path: Path, lines: Iterator[SeriesRow]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join(COLUMNS) + "\n")
        for row in lines:
            file.write(",".join((row.time, *_cells(row).values(), row.north)) + "\n")


def _write_parquet(path: Path, lines: Iterator[SeriesRow]) -> None:
    # Import pyarrow here, because loading it takes longer than writing most exports.
    import pyarrow as arrow
    from pyarrow import parquet

    fields = [
        (COLUMNS[0], arrow.string()),
        *((q.key, arrow.float64()) for q in QUANTITIES),
        (COLUMNS[-1], arrow.string()),
    ]
    schema = arrow.schema(fields)
    with parquet.ParquetWriter(path, schema) as writer:
        batch: list[dict[str, Any]] = []

        def flush() -> None:
            writer.write_table(arrow.Table.from_pylist(batch, schema=schema))
            batch.clear()

        for row in lines:
            numbers = {key: float(text) if text else None for key, text in _cells(row).items()}
            batch.append({COLUMNS[0]: row.time, **numbers, COLUMNS[-1]: row.north or None})
            if len(batch) == _BATCH:
                flush()
        flush()


def _rig(samples: Samples, seconds: NDArray[np.int64], waiting: dict[int, SeriesRow]) -> None:
    for quantity in _RIG_QUANTITIES:
        known = (samples["valid"] & wire.RIG_VALID[quantity.field]) != 0
        _place_samples(samples, seconds, known, (quantity,), waiting)


def _attitude(samples: Samples, seconds: NDArray[np.int64], waiting: dict[int, SeriesRow]) -> None:
    for angle, doubt in zip(_ANGLES, _SIGMAS, strict=True):
        known = np.isfinite(samples[doubt.field])
        which = _place_samples(samples, seconds, known, (angle, doubt), waiting)
        if angle.field == "azimuth":
            for k in which:
                second, north = int(seconds[k]), int(samples["north"][k])
                name = NORTHS[north] if north < len(NORTHS) else ""
                waiting[second] = dataclasses.replace(waiting[second], north=name)


def _place_samples(
    samples: Samples,
    seconds: NDArray[np.int64],
    known: NDArray[np.bool_],
    quantities: Sequence[SeriesQuantity],
    waiting: dict[int, SeriesRow],
) -> list[int]:
    """Put the last known sample of each second into the row of this second; return the indices of these samples."""
    for quantity in quantities:
        known = known & np.isfinite(samples[quantity.field])
    where = np.flatnonzero(known)
    # `unique` returns the first occurrence: reverse the order to get the last sample of each second.
    _, first = np.unique(seconds[where][::-1], return_index=True)
    places = [int(k) for k in where[::-1][first]]
    for k in places:
        row = waiting.setdefault(int(seconds[k]), SeriesRow(int(seconds[k]), {}, ""))
        for quantity in quantities:
            row.values[quantity.key] = quantity.unit.of(float(samples[quantity.field][k]))
    return places


def _attitude_topic(bag: Bag, well: str) -> str | None:
    """
    Return the topic of the tool's attitude, or else of the attitude that telemetry has sent; None without both.

    well: namespace of the well, if the recording has several.
    """
    name = wire.ATTITUDE.type_name
    return topic_of(bag, ATTITUDE, name, well) or topic_of(bag, LINK_ATTITUDE, name, well)
