# SPDX-License-Identifier: Apache-2.0
"""
Comparison of two runs of the estimator: station by station, and statistics of their attitudes.

The files of `mwd process` are compared, so that runs of two versions, two methods or two machines can be compared, or a
run and its expected results. Memory stays constant: both attitudes are read in parallel.

A golden folder holds a short bag with its expected results. Its input is `bag/`, `config.yaml` (settings of the
estimator that differ from the default) and `limits.yaml` (name -> limit and its reason, see `LIMITS`); its results are
`surveys.csv` and `attitude.csv` (one row per second, to keep it small).
"""

from __future__ import annotations

import dataclasses
import math
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core.arrays import Stamps
from mwd_sensors.core.input_files import read_yaml
from mwd_surface.bags.bag_files import recording_of
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.processing import process, run_config, run_folder
from mwd_surface.processing.run_folder import ANGLES, Rows
from mwd_surface.surveys.recorded_settings import recorded_settings

# Largest allowed differences, by name; without a limit, only rounding of the printed digits is allowed.
LIMITS = (
    "survey_inclination_deg",
    "survey_azimuth_deg",
    "survey_toolface_deg",
    "survey_sigma_share",  # difference of a station's sigma, relative to the expected sigma
    "survey_stamp_s",  # difference between the times of a station in the two runs
    # Largest difference between the two runs at any sample; "gravity" is the angle between the directions of gravity.
    "attitude_inclination_deg",
    "attitude_azimuth_deg",
    "attitude_toolface_deg",
    "attitude_gravity_deg",
    "attitude_status_share",  # share of the samples whose status words differ
)
_STATION_ANGLES = (("inclination_deg", False), ("azimuth_deg", True), ("toolface_deg", True))
_SIGMAS = ("sigma_inclination_deg", "sigma_azimuth_deg", "sigma_toolface_deg")
_PAIRED_WITHIN_NS = 2_000_000_000  # longest time between two stations that are paired, ns
_ROUNDING = 1.0 + 1e-9  # factor of a limit that allows for rounding


@dataclasses.dataclass(frozen=True)
class StationDifference:
    """One station of the expected run and its counterpart."""

    sequence: str
    measured_depth: str
    stamp_difference_s: float
    #: by column, this run minus the expected run, deg (shares for sigmas); nan if only one run has the value
    differences: dict[str, float]
    words: tuple[str, ...]  #: text on differences that are not numbers; empty if there are none
    unknown: frozenset[str] = frozenset()  #: columns that neither run has; their difference is 0


@dataclasses.dataclass(frozen=True)
class DifferenceStatistics:
    """Differences of one quantity over the samples in which both runs have the quantity, deg."""

    name: str
    count: int  #: number of samples in which both runs have the quantity
    mean: float
    rms: float
    largest: float
    known_in_one: int  #: number of samples in which only one run has the quantity


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Differences between a run and the expected run."""

    stations: tuple[StationDifference, ...]
    #: `missing`, `extra`: stations only in the expected run, or only in this run, as "number at depth"
    missing: tuple[str, ...]
    extra: tuple[str, ...]
    statistics: tuple[DifferenceStatistics, ...]
    #: `rows`, `rows_missing`, `rows_extra`: number of samples in both runs; only in the expected run; only in this run
    rows: int
    rows_missing: int
    rows_extra: int
    status_differs: int  #: number of samples with different status words
    failures: tuple[str, ...]  #: a sentence for each limit that is exceeded; empty if the runs agree

    @property
    def agree(self) -> bool:
        """Whether every difference is within its limit."""
        return not self.failures


def read_limits(path: Path) -> dict[str, float]:
    """
    Return the limits in a YAML file: name -> {limit, reason}. A limit without a reason is refused.

    Raises
    ------
    ValueError
        The file is not YAML or not a table of limits, a name is unknown, or a reason is missing.
    OSError
        The file cannot be read.
    """
    table = read_yaml(path)
    if not isinstance(table, dict):
        raise ValueError(f"{path}: expected a table of limits")  # noqa: TRY004
    limits = {}
    for name, entry in table.items():
        if not isinstance(entry, dict) or set(entry) != {"limit", "reason"} or not str(entry["reason"]).strip():
            raise ValueError(f"{path}: {name}: expected `limit` and `reason`, got {entry!r}")
        limits[str(name)] = entry["limit"]
    return checked_limits(limits)


def checked_limits(limits: dict[str, float]) -> dict[str, float]:
    """
    Return the limits if all names are known and all values are finite numbers of 0 or more.

    Raises
    ------
    ValueError
        A name is unknown or a value is not allowed.
    """
    for name, value in limits.items():
        if name not in LIMITS:
            raise ValueError(f"limit {name}: unknown; known are {', '.join(LIMITS)}")
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < math.inf:
            raise ValueError(f"limit {name}: must be a number of 0 or more, got {value!r}")
    return limits


def compare(ours: Path, expected: Path, limits: dict[str, float] | None = None) -> Comparison:
    """
    Compare the run in folder `ours` with the run in folder `expected`; return the differences.

    `ours` must have every station and sample of the expected run. Additional samples are reported and allowed, because
    an expected run may keep one row per second; additional stations are not allowed.

    Raises
    ------
    FileNotFoundError, ValueError
        A folder does not hold a run, or a limit is unknown.
    """
    limits = checked_limits(dict(limits or {}))
    stations, missing, extra = _stations(run_folder.surveys(ours), run_folder.surveys(expected))
    walk = _Walk()
    for pair in _side_by_side(run_folder.attitude(ours), run_folder.attitude(expected), walk):
        walk.add(*pair)
    statistics = walk.statistics()
    failures = [f"station {name} is missing" for name in missing] + [f"station {name} is new" for name in extra]
    failures += _station_failures(stations, limits)
    if walk.rows_missing:
        failures.append(f"{walk.rows_missing} samples of the expected run are missing")
    if not walk.rows:
        failures.append("the attitudes have no sample in common")
    for one in statistics:
        limit = limits.get(f"attitude_{one.name}_deg", 0.0)
        if one.largest > limit * _ROUNDING:
            failures.append(f"{one.name} differs by up to {one.largest:.4f} deg, limit {limit:g}")
        if one.known_in_one:
            failures.append(f"{one.name} is known in only one of the runs at {one.known_in_one} samples")
    share = walk.status_differs / max(walk.rows, 1)
    if share > limits.get("attitude_status_share", 0.0) * _ROUNDING:
        failures.append(f"status differs at {walk.status_differs} of {walk.rows} samples")
    return Comparison(
        tuple(stations),
        tuple(missing),
        tuple(extra),
        statistics,
        walk.rows,
        walk.rows_missing,
        walk.rows_extra,
        walk.status_differs,
        tuple(failures),
    )


def _name(line: dict[str, str]) -> str:
    return f"{line['sequence']} at {line['md_m'] or 'unknown depth'}{' m' if line['md_m'] else ''}"


def _stations(
    ours: list[dict[str, str]], expected: list[dict[str, str]]
) -> tuple[list[StationDifference], list[str], list[str]]:
    """
    Pair the stations by nearest time, within 2 s, each station in one pair at most.

    Return pairs, names of missing stations and names of additional stations.
    """
    left = list(ours)
    pairs, missing = [], []
    for line in expected:
        stamp = int(line["stamp_ns"])
        near = min(left, key=lambda one: abs(int(one["stamp_ns"]) - stamp), default=None)
        if near is None or abs(int(near["stamp_ns"]) - stamp) > _PAIRED_WITHIN_NS:
            missing.append(_name(line))
            continue
        left.remove(near)
        pairs.append(_beside(near, line))
    return pairs, missing, [_name(line) for line in left]


def _beside(ours: dict[str, str], expected: dict[str, str]) -> StationDifference:
    differences: dict[str, float] = {}
    for name, around in _STATION_ANGLES:
        difference = _number(ours[name]) - _number(expected[name])
        both_unknown = not ours[name] and not expected[name]
        differences[name] = 0.0 if both_unknown else _short_way(difference) if around else difference
    for name in _SIGMAS:
        a, b = _number(ours[name]), _number(expected[name])
        both_unknown = not ours[name] and not expected[name]
        differences[name] = 0.0 if both_unknown or a == b else (a - b) / b if b else math.inf
    words = tuple(
        f"{name.replace('_', ' ')}: {ours[name] or 'none'}, expected {expected[name] or 'none'}"
        for name in ("verdict", "azimuth_method", "azimuth_reference")
        if ours[name] != expected[name]
    )
    stamp_s = (int(ours["stamp_ns"]) - int(expected["stamp_ns"])) * 1e-9
    unknown = frozenset(name for name in differences if not ours[name] and not expected[name])
    return StationDifference(expected["sequence"], expected["md_m"], stamp_s, differences, words, unknown)


def _station_failures(stations: list[StationDifference], limits: dict[str, float]) -> Iterator[str]:
    for one in stations:
        yield from (f"station {one.sequence}: {words}" for words in one.words)
        if abs(one.stamp_difference_s) > limits.get("survey_stamp_s", 0.0) * _ROUNDING:
            yield f"station {one.sequence}: taken {one.stamp_difference_s:+.3f} s from the expected time"
        for name, value in one.differences.items():
            key = "survey_sigma_share" if name in _SIGMAS else f"survey_{name}"
            limit = limits.get(key, 0.0)
            # The comparison is negated so that NaN, for a value known in one run only, also fails.
            if not abs(value) <= limit * _ROUNDING + 1e-9:
                yield f"station {one.sequence}: {name} differs by {value:+.4g}, limit {limit:g}"


def _number(text: str) -> float:
    return float(text) if text else math.nan


def _short_way(degrees: float) -> float:
    return (degrees + 180.0) % 360.0 - 180.0


class _Walk:
    """Sums of the differences between the attitudes of two runs, block by block."""

    def __init__(self) -> None:
        names = [name.removesuffix("_deg") for name in ANGLES] + ["gravity"]
        self._sums = {name: np.zeros(3) for name in names}
        self._largest = dict.fromkeys(names, 0.0)
        self._alone = dict.fromkeys(names, 0)
        self.rows = self.rows_missing = self.rows_extra = self.status_differs = 0

    def add(self, ours: Rows, expected: Rows) -> None:
        """Add rows with equal stamps."""
        self.rows += len(ours["stamp_ns"])
        self.status_differs += int(np.count_nonzero(ours["status"] != expected["status"]))
        for column in ANGLES:
            difference = ours[column] - expected[column]
            if column != "inclination_deg":
                difference = (difference + 180.0) % 360.0 - 180.0
            self._sum(column.removesuffix("_deg"), difference, ours[column], expected[column])
        a, b = ours["gravity"], expected["gravity"]
        # The half-angle from the chord is exactly zero for equal vectors; arccos is not.
        chord = np.linalg.norm(a - b, axis=1)
        angle = np.degrees(2.0 * np.arcsin(np.minimum(chord / 2.0, 1.0)))
        self._sum("gravity", angle, a[:, 0], b[:, 0])

    def _sum(
        self, name: str, difference: NDArray[np.float64], ours: NDArray[np.float64], expected: NDArray[np.float64]
    ) -> None:
        self._alone[name] += int(np.count_nonzero(np.isnan(ours) != np.isnan(expected)))
        known = difference[np.isfinite(difference)]
        self._sums[name] += len(known), known.sum(), np.square(known).sum()
        self._largest[name] = max(self._largest[name], float(np.abs(known).max(initial=0.0)))

    def statistics(self) -> tuple[DifferenceStatistics, ...]:
        """Return the statistics of each quantity."""
        found = []
        for name, (count, total, squares) in self._sums.items():
            mean = total / count if count else math.nan
            rms = math.sqrt(squares / count) if count else math.nan
            found.append(DifferenceStatistics(name, int(count), mean, rms, self._largest[name], self._alone[name]))
        return tuple(found)


def _side_by_side(ours: Iterator[Rows], expected: Iterator[Rows], walk: _Walk) -> Iterator[tuple[Rows, Rows]]:
    """
    Yield, block by block, the rows of both runs that have equal stamps; count all other rows in `walk`.

    Rows that share a stamp are paired in their order.
    """
    ours, expected = _whole_stamps(ours), _whole_stamps(expected)
    a, b = next(ours, None), next(expected, None)
    while a is not None and b is not None:
        if not len(a["stamp_ns"]) or not len(b["stamp_ns"]):
            a = next(ours, None) if not len(a["stamp_ns"]) else a
            b = next(expected, None) if b is not None and not len(b["stamp_ns"]) else b
            continue
        until = min(int(a["stamp_ns"][-1]), int(b["stamp_ns"][-1]))
        head_a, a = _cut(a, until)
        head_b, b = _cut(b, until)
        _, in_a, in_b = np.intersect1d(*_numbers(head_a["stamp_ns"], head_b["stamp_ns"]), return_indices=True)
        walk.rows_extra += len(head_a["stamp_ns"]) - len(in_a)
        walk.rows_missing += len(head_b["stamp_ns"]) - len(in_b)
        yield _rows(head_a, in_a), _rows(head_b, in_b)
    walk.rows_extra += _left(a, ours)
    walk.rows_missing += _left(b, expected)


def _whole_stamps(blocks: Iterator[Rows]) -> Iterator[Rows]:
    """Yield rows in blocks, each in the order of its stamps; successive rows with one stamp are in one block."""
    held: Rows | None = None
    for block in blocks:
        rows = block if held is None else {name: np.concatenate([held[name], block[name]]) for name in block}
        rows = _rows(rows, np.argsort(rows["stamp_ns"], kind="stable"))
        if not len(rows["stamp_ns"]):
            continue
        whole, held = _cut(rows, int(rows["stamp_ns"][-1]) - 1)
        yield whole
    if held is not None:
        yield held


def _numbers(ours: Stamps, expected: Stamps) -> tuple[Stamps, Stamps]:
    """Return a number for each row of two runs, equal for the k-th rows with one stamp; the stamps are in order."""
    code = np.unique(np.concatenate([ours, expected]), return_inverse=True)[1]
    place = np.concatenate([np.arange(len(one)) - np.searchsorted(one, one) for one in (ours, expected)])
    number = code * (place.max(initial=0) + 1) + place
    return number[: len(ours)], number[len(ours) :]


def _cut(rows: Rows, until_ns: int) -> tuple[Rows, Rows]:
    split = int(np.searchsorted(rows["stamp_ns"], until_ns, side="right"))
    head = {name: values[:split] for name, values in rows.items()}
    return head, {name: values[split:] for name, values in rows.items()}


def _rows(rows: Rows, index: NDArray[np.intp]) -> Rows:
    return {name: values[index] for name, values in rows.items()}


def _left(rows: Rows | None, more: Iterator[Rows]) -> int:
    return (len(rows["stamp_ns"]) if rows is not None else 0) + sum(len(block["stamp_ns"]) for block in more)


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
    return read_limits(file) if file.is_file() else {}


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


def accept_golden(golden: Path) -> None:
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
