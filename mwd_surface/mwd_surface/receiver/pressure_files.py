# SPDX-License-Identifier: Apache-2.0
"""Standpipe pressure from files: a table, WAV, or a recording with PressureBurst or FluidPressure."""

from __future__ import annotations

import dataclasses
import io
import struct
import warnings
from pathlib import Path

import numpy as np
from scipy.io import wavfile

from mwd_sensors.core import budgets
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.budgets import BudgetError
from mwd_sensors.core.input_files import read_file
from mwd_sensors.telemetry.serial_frames import BITS_PER_BYTE
from mwd_surface.receiver.gauge_scale import FULL_SCALE_PA
from mwd_surface.receiver.lone_stamps import lone

_RECORDINGS = (".mcap", ".db3", ".bag", ".zstd", ".lz4")
# Longest pause of a recording, s; a longer pause means that the clock was set.
_LONGEST_GAP_S = 86400.0
# Longest usual time between samples, s. A gauge for pulses samples at least ten times per second; this limit only
# refuses files that are too slow for any telemetry.
_SLOWEST_S = 10.0
# Shortest pause between two samples, s, and largest share of pauses in a recording. A recording with a larger share and
# with more than a day of pauses is refused: each pause would be filled with samples.
_GAP_S, _MOST_GAPS = 60.0, 0.9
# Clipping is reported above this share of samples at a limit, and this number of times that the pressure reaches it.
_CLIPPED, _VISITS = 0.001, 3
_OFF = 0.05  # share of the highest pressure below which the pumps are off
_FROZEN_S = 1.0  # shortest time with one value that is reported as a frozen gauge, s; noise would change the value


@dataclasses.dataclass(frozen=True)
class PressureFile:
    """Rising times, s, and pressure, Pa, shape (n,), finite."""

    time_s: Array
    pressure_pa: Array
    origin: str  #: meaning of time 0
    notes: tuple[str, ...]  #: faults of the data
    #: Times of each pump's strokes, s, if recorded.
    strokes: dict[int, Array] = dataclasses.field(default_factory=dict)


def read(path: Path, gauge: int = 1, topic: str = "", link: str = "mud_pulse", columns: str = "") -> PressureFile:
    """
    Return the pressure in a file; in V in place of Pa for a link through the ground.

    Parameters
    ----------
    path : Path
        A table with columns of time and pressure (`pressure_table`); `.wav`, PCM or float, a channel for each gauge;
        or a recording.
    gauge : int
        1 or 2.
    topic : str
        Topic to read from a recording that has several pressure topics.
    link : str
        mud_pulse, em or coil: the link to read from a recording.
    columns : str
        Columns of a table, as `pressure_columns.columns_of` reads them.

    Raises
    ------
    ValueError
        The file has no readable pressure; the message says what is missing.
    OSError
        The file cannot be read.
    BagError
        The file is not a recording, or it has no such topic.
    """
    if gauge not in (1, 2):
        raise ValueError(f"--gauge: must be 1 or 2, got {gauge}")
    suffix = path.suffix.lower()
    strokes: dict[int, Array] = {}
    said: tuple[str, ...] = ()
    if suffix == ".wav":
        time, pressure, origin = _wav(path, gauge)
    elif path.is_dir() or suffix in _RECORDINGS:
        from mwd_surface.receiver import recorded_link

        second = "standpipe_2" if gauge == 2 else ""
        time, pressure, strokes, origin = recorded_link.read(path, link, topic or second)
    else:
        from mwd_surface.receiver import pressure_columns, pressure_table

        time, pressure, origin, said = pressure_table.read_pressure(path, gauge, pressure_columns.columns_of(columns))
    known = np.isfinite(time) & np.isfinite(pressure)
    wrong = np.zeros_like(known)
    wrong[known] = lone(time[known])
    if wrong.any():
        said = (*said, f"{int(wrong.sum())} samples have a time far from those around them and are left out")
    time, pressure, known = time[~wrong], pressure[~wrong], known[~wrong]
    notes = (*said, *_notes(time, pressure))
    time, pressure = time[known], pressure[known]
    rises = time > np.maximum.accumulate(np.append(-np.inf, time))[:-1]
    time, pressure = time[rises], pressure[rises]
    if len(time) < 64:
        raise ValueError(f"{path}: {len(time)} samples of pressure with rising times are too few")
    _check_times(path, time)
    return PressureFile(time, pressure, origin, notes, strokes)


def _check_times(path: Path, time: Array) -> None:
    """
    Refuse times whose even grid would have far more samples than the file.

    Raises ValueError if a step is longer than any pause, the usual step is too long for telemetry, the duration is
    longer than `budgets.PRESSURE` allows, or more than a day and most of the duration is gaps.
    """
    steps = np.diff(time)
    longest, at_s = float(steps.max()), float(time[steps.argmax()] - time[0])
    if longest > _LONGEST_GAP_S:
        raise ValueError(
            f"{path}: the time jumps by {longest:.6g} s, {at_s:.6g} s after the start, probably because the clock was "
            "set; cut the file there"
        )
    try:
        budgets.PRESSURE.check("seconds", float(time[-1] - time[0]))
    except BudgetError as error:
        raise ValueError(f"{path}: {error}; cut the file") from error
    usual = float(np.median(steps))
    if usual > _SLOWEST_S:
        raise ValueError(f"{path}: a sample each {usual:.3g} s is too slow for any telemetry; {_SLOWEST_S:g} s at most")
    gaps = float(steps[steps > _GAP_S].sum())
    if gaps > _LONGEST_GAP_S and gaps > _MOST_GAPS * float(time[-1] - time[0]):
        raise ValueError(f"{path}: {gaps:.6g} of {time[-1] - time[0]:.6g} s are gaps; cut the file there")


def read_strokes(path: Path) -> dict[int, Array]:
    """
    Read a CSV with columns pump and time_s, a row for each stroke.

    Returns
    -------
    dict of int to ndarray
        Times of each pump in order, s, on the clock of the pressure.

    Raises
    ------
    ValueError
        A column is missing, or a row is not numeric.
    OSError
        The file cannot be read.
    """
    from mwd_surface.receiver import pressure_table

    pumps, times = pressure_table.read_numbers(path, {})
    if not (np.isfinite(pumps).all() and np.isfinite(times).all()):
        raise ValueError(f"{path}: not all rows are numbers of a pump and times")
    return {int(pump): np.sort(times[pumps == pump]) for pump in np.unique(pumps)}


def read_bytes(path: Path, baud: int) -> PressureFile:
    """
    Return the bytes of a serial line, 0 to 255 in place of the pressure, from a recording or a raw capture.

    The times of a capture assume that the bytes followed each other without pauses, at `baud` bits per second.

    Raises
    ------
    OSError
        The file cannot be read.
    BagError
        The recording has no such topic.
    """
    if path.is_dir() or path.suffix.lower() == ".mcap":
        from mwd_surface.receiver import recorded_link

        time, octets, _, origin = recorded_link.read(path, "serial")
        return PressureFile(time, octets, origin, ())
    data = np.frombuffer(read_file(path, budgets.SERIAL), dtype=np.uint8).astype(float)
    return PressureFile((np.arange(len(data)) + 1.0) * BITS_PER_BYTE / baud, data, "first byte of the file", ())


def _wav(path: Path, gauge: int) -> tuple[Array, Array, str]:
    try:
        with warnings.catch_warnings():
            # Ignore chunks that are not samples, and a missing end, which a recorder leaves after a power failure.
            warnings.simplefilter("ignore", wavfile.WavFileWarning)
            data = read_file(path, budgets.PRESSURE)
            # Read into memory first: from a file, scipy would allocate the size that the header claims before reading.
            rate, samples = wavfile.read(io.BytesIO(data))
            budgets.PRESSURE.check("records", samples.size)
            budgets.PRESSURE.check_ratio(len(data), samples.nbytes)
    except BudgetError as error:
        raise ValueError(f"{path}: {error}") from error
    except (ValueError, EOFError, struct.error, ZeroDivisionError, UnboundLocalError) as error:
        # scipy raises UnboundLocalError for a file without a format or data chunk, and ZeroDivisionError for a sample
        # width of 0.
        raise ValueError(f"{path}: not a WAV that can be read (PCM or float): {error}") from error
    table = samples if samples.ndim == 2 else samples[:, np.newaxis]
    if gauge > table.shape[1]:
        raise ValueError(f"{path}: the WAV has one channel, so it has no gauge {gauge}")
    if rate <= 0:
        raise ValueError(f"{path}: the WAV gives no sample rate")
    one = table[:, gauge - 1].astype(float)
    if samples.dtype.kind == "u":
        one -= 128.0
    # 24-bit samples come in the upper bits of 32; floats are already fractions of full scale.
    full = 1.0 if samples.dtype.kind == "f" else 2.0 ** (8 * samples.dtype.itemsize - 1)
    return np.arange(len(one)) / rate, one * (FULL_SCALE_PA / full), "start of the WAV file"


def _notes(time: Array, pressure: Array) -> tuple[str, ...]:
    """Return notes on faults of the data that a survey engineer should know before trusting the result."""
    notes = []
    known = np.isfinite(pressure) & np.isfinite(time)
    if not known.all():
        notes.append(f"{int((~known).sum())} samples are not numbers and are left out")
    steps = np.diff(time[known])
    usual = float(np.median(steps)) if len(steps) else 0.0
    rising = time[known]
    fallen = int(np.sum(rising[1:] <= np.maximum.accumulate(rising)[:-1]))
    if fallen:
        notes.append(f"{fallen} times do not rise; those samples are left out")
    gaps = steps > max(20.0 * usual, 1.0)
    if gaps.any():
        notes.append(f"{int(gaps.sum())} gaps, {float(steps[gaps].sum()):.1f} s in all")
    values = pressure[known]
    notes += _clipped(values)
    notes += _frozen(time[known], values)
    distinct = np.unique(values)
    if len(distinct) < 64:
        notes.append(
            f"the pressure takes only {len(distinct)} values: the resolution is too coarse, or the gauge is stuck"
        )
    return tuple(notes)


def _clipped(values: Array) -> list[str]:
    """
    Return notes on a highest or lowest value that the pressure reaches again and again, as a clipping converter does.

    A lowest value near zero is not reported: it is the pressure while the pumps are off.
    """
    notes = []
    size = float(np.max(np.abs(values), initial=0.0))
    for limit, words in ((values.max(initial=-np.inf), "highest"), (values.min(initial=np.inf), "lowest")):
        at = values == limit
        visits = int(np.sum(at[1:] & ~at[:-1])) + int(at[:1].sum())
        share = float(at.mean()) if at.size and (words == "highest" or limit > _OFF * size) else 0.0
        if share > _CLIPPED and visits > _VISITS and np.ptp(values) > 0.0:
            notes.append(
                f"{100.0 * share:.1f} % of the samples are at the {words} value: the gauge or its converter clips"
            )
    return notes


def _frozen(time: Array, values: Array) -> list[str]:
    """
    Return a note on a gauge that holds its value for longer than noise, rounding and clipping explain.

    The list is empty if the gauge does not.
    """
    changes = np.flatnonzero(np.diff(values) != 0.0) + 1
    if not changes.size:
        return []
    begins, ends = np.append(0, changes), np.append(changes, values.size) - 1
    held = time[ends] - time[begins]
    usual = float(np.percentile(held, 99))
    held_at = values[begins]
    # At its highest or lowest value the gauge may clip, and near zero the pumps are off.
    moving = (held_at < values.max()) & (held_at > values.min()) & (np.abs(held_at) > _OFF * np.max(np.abs(values)))
    stuck = (held > max(_FROZEN_S, 10.0 * usual)) & moving
    if not stuck.any():
        return []
    note = (
        f"the gauge is frozen for {float(held[stuck].sum()):.0f} s in {int(stuck.sum())} spans, first at"
        f" {float(time[begins[stuck][0]]):.0f} s: check the gauge, its converter and the network"
    )
    return [note]
