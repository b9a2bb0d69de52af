# SPDX-License-Identifier: Apache-2.0
"""
Depths from a table, for a recording without rig depths: bit depth by time, or the depth of each survey.

Columns, by name and unit: `time` (UTC, ISO 8601, or stamp_ns) with `bit_depth_m` or `md_m`, or `survey` (its number)
with `md_m`. bit_depth is the depth of the bit, md is the depth of the sensor.
"""

from __future__ import annotations

import bisect
import dataclasses
import itertools
import math
from pathlib import Path

from mwd_sensors.core import utc
from mwd_surface.list_files import list_columns
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.table import read_table
from mwd_surface.surveys.depth import DepthReading

_TIMES = ("time", "time_utc", "dtim", "dtim_utc", "stamp_ns", "timestamp", "utc", "date_time")
_NUMBERS = ("survey", "sequence", "no", "station", "number")
_BIT, _SENSOR = ("bit_depth", "bit", "dbtm", "hole_depth"), ("md", "measured_depth", "depth")


@dataclasses.dataclass(frozen=True)
class DepthTable:
    """Depths from a table."""

    by_number: dict[int, float] = dataclasses.field(default_factory=dict)  #: depth of the sensor by survey number, m
    by_time: tuple[tuple[int, float], ...] = ()  #: stamp, ns, and depth, m, in order of time
    of_bit: bool = False  #: whether the depths by time are those of the bit instead of the sensor

    def sensor_depth(self, sequence: int, stamp_ns: int, sensor_to_bit: float) -> DepthReading:
        """
        Return the depth of the sensor at a survey, by its number or by interpolation in time between two rows.

        sensor_to_bit: distance from sensor to bit, m. The depth is NaN, with a reason, if the table does not have the
        survey or its time, or if the sensor is above the datum.
        """
        if self.by_number:
            if sequence not in self.by_number:
                return DepthReading(reason="the table of depths does not have this survey")
            return DepthReading(self.by_number[sequence], 0.0)
        after = bisect.bisect_left(self.by_time, (stamp_ns, -math.inf))
        if after == len(self.by_time) or (after == 0 and self.by_time[0][0] != stamp_ns):
            return DepthReading(reason="the survey is outside the times of the table of depths")
        (t_0, d_0), (t_1, d_1) = self.by_time[max(after - 1, 0)], self.by_time[after]
        depth = d_1 if t_1 == t_0 else d_0 + (d_1 - d_0) * (stamp_ns - t_0) / (t_1 - t_0)
        bit = depth if self.of_bit else depth + sensor_to_bit
        if bit < sensor_to_bit:
            return DepthReading(math.nan, 0.0, bit, f"bit at {bit:.2f} m: the sensor is still above the datum")
        return DepthReading(bit - sensor_to_bit, 0.0, bit)


def read_depths(path: Path) -> DepthTable:
    """
    Return the depths in a CSV file.

    Raises
    ------
    ListFileError, ValueError
        A column is missing or has no unit, a cell is not a number or time, the times do not increase, or a table by
        survey number has depths of the bit. The message names the column or row.
    OSError
        The file cannot be read.
    """
    table = read_table(path).columns()
    plain = {name: "_".join(name.lower().replace("(", " ").replace(")", " ").split()) for name in table}
    time = next((name for name in table if plain[name] in _TIMES), None)
    number = next((name for name in table if plain[name] in _NUMBERS), None)
    depth, of_bit, unit = _depth_column(list(table), path)
    if time is None and number is None:
        raise ListFileError(
            f"{path}: no column time or survey; expected time,bit_depth_m or survey,md_m, got {', '.join(table)}"
        )
    depths = [_number(cell, f"{path}, {depth}, row {k}") * unit for k, cell in enumerate(table[depth], start=1)]
    if time is None:
        numbers = [_number(cell, f"{path}, {number}, row {k}") for k, cell in enumerate(table[str(number)], start=1)]
        if of_bit:
            raise ListFileError(f"{path}: a table by survey number needs the depth of the sensor: name the column md_m")
        return DepthTable({int(n): d for n, d in zip(numbers, depths, strict=True)})
    stamps = [_stamp(cell, f"{path}, {time}, row {k}") for k, cell in enumerate(table[time], start=1)]
    for before, after in itertools.pairwise(stamps):
        if after <= before:
            raise ListFileError(f"{path}: the times of {time} do not increase")
    return DepthTable(by_time=tuple(zip(stamps, depths, strict=True)), of_bit=of_bit)


def _depth_column(names: list[str], path: Path) -> tuple[str, bool, float]:
    """
    Return the name of the depth column, whether it holds bit depths, and the factor from its unit to m.

    Raises ListFileError if there is no depth column, or if its unit is missing or unknown.
    """
    for words, of_bit in ((_BIT, True), (_SENSOR, False)):
        for name in names:
            lower = "_".join("".join(c if c.isalpha() else " " for c in name.lower()).split())
            for word in words:
                if lower == word or lower.startswith(word + "_"):
                    rest = lower.removeprefix(word).replace("_", " ").strip()
                    unit = list_columns.unit_word(rest)
                    column = list_columns.ListColumn(0, name, "md", unit, strange="" if unit else rest)
                    return name, of_bit, list_columns.factor(column, str(path))
    raise ListFileError(f"{path}: no column of depths; expected bit_depth_m or md_m, got {', '.join(names)}")


def _number(text: str, at: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ListFileError(f"{at}: expected a number, got {text!r}")
    return value


def _stamp(text: str, at: str) -> int:
    try:
        return int(text) if text.strip().isdecimal() else utc.stamp_ns(utc.moment(text))
    except ValueError as error:
        raise ListFileError(f"{at}: expected a time such as 2026-03-01T12:00:00Z or ns, got {text!r}") from error
