"""
A recording to attitude, surveys and the configuration that gave them: the estimator over a bag, in constant memory.

The same `Pipeline` as the live node's runs over blocks of the bag, while a thread reads ahead of it and another writes
behind it. Results appear complete or not at all.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from mwd_estimation import units
from mwd_estimation.pipeline import EstimatorSettings, Output, Pipeline
from mwd_estimation.status import Status
from mwd_estimation.survey import Survey
from mwd_sensors import burst, wire
from mwd_sensors import settings as settings_of
from mwd_sensors.compensation import Compensation
from mwd_sensors.settings import setting
from mwd_surface.bags.bag_reader import Bag, BagError, Block, Originals
from mwd_surface.bags.mcap_format import MAGIC
from mwd_surface.exports import attitude_csv
from mwd_surface.exports.thinner import Thinner
from mwd_surface.runs.imu_queue import ImuQueue
from mwd_surface.runs.merger import Merger
from mwd_surface.runs.overlap import ahead, behind
from mwd_surface.surveys import station_csv
from mwd_surface.surveys.depth import DepthTrack

IMU, MAG, PRECISION, TEMPERATURE, RIG = "imu/data_raw", "imu/mag", "gyro/data_raw", "imu/temperature", "rig/state"
IMU_BURST, PRECISION_BURST = burst.TOPICS
FORMATS = ("csv", "parquet", "mcap")
MERGED = "merged"
SURVEY_COLUMNS = ("sequence", "stamp_ns", "duration_s", "samples", "requested", *station_csv.COLUMNS, "uuid")

# All else of these messages is most of their bytes, and is not read.
_FIELDS = {
    wire.IMU.type_name: ("angular_velocity", "linear_acceleration"),
    wire.MAG.type_name: ("magnetic_field",),
    wire.TEMPERATURE.type_name: ("temperature",),
    wire.RIG_STATE.type_name: ("bit_depth", "valid"),
}
_FRAMES_LOOKED_AT = 2000
_BIT_DEPTH = 1  # RigState.VALID bit of bit_depth


@dataclasses.dataclass(frozen=True)
class InputSettings:
    """What to take from a bag, and how it is to be read."""

    imu_topic: str = setting("", "Topic of the AHRS; empty: the one that ends in imu/data_raw")
    mag_topic: str = setting("", "Topic of its magnetometer; empty: the one beside it that ends in imu/mag")
    accel_unit: str = setting("m/s2", "Unit of the specific force", choices=tuple(units.FACTORS["acceleration"]))
    gyro_unit: str = setting("rad/s", "Unit of the angular rate", choices=tuple(units.FACTORS["rate"]))
    mag_unit: str = setting("T", "Unit of the magnetic field", choices=tuple(units.FACTORS["field"]))
    start_s: float = setting(0.0, "Begin so long after the first message", unit="s", low=0.0)
    end_s: float = setting(math.inf, "End so long after the first message", unit="s", low=0.0)
    same_axes: bool = setting(False, "IMU and magnetometer share axes although their frames have different names")
    partial: bool = setting(False, "Use what can be read of a bag that is cut off or damaged")
    sensor_to_bit_m: float = setting(0.0, "Sonde behind the bit", unit="m", low=0.0, high=100.0)


@dataclasses.dataclass(frozen=True)
class OutputSettings:
    """What to write."""

    format: str = setting("csv", "File of the attitude", choices=FORMATS)
    rate_hz: float = setting(0.0, "At most so many rows a second; 0: one for every IMU message", unit="Hz", low=0.0)
    smooth: bool = setting(False, "Gravity of each sample from what came after it too; method bounded only")


@dataclasses.dataclass(frozen=True)
class Topics:
    """The topics of one well in a bag; None where the bag has none."""

    imu: str
    mag: str | None
    precision: str | None
    temperature: str | None
    rig: str | None

    @property
    def all(self) -> list[str]:
        """Those that are there."""
        return [name for name in dataclasses.astuple(self) if name is not None]


@dataclasses.dataclass
class Summary:
    """
    What came of a bag.

    Attributes
    ----------
    rows : int
        IMU messages.
    start_ns, end_ns : int
        Stamps of the first and the last of them.
    rejected, gaps, without_gravity, without_azimuth : int
        Rows with that flag or lack.
    lowest, highest : float
        Inclination met, rad; nan where there is none.
    north, reference : str
        North of the azimuth, and where the field comes from.
    surveys : list of (Survey, measured depth in m or nan)
    warnings : list of str
    files : list of str
        Names of what was written.
    """

    topics: Topics
    rows: int = 0
    start_ns: int = 0
    end_ns: int = 0
    rejected: int = 0
    gaps: int = 0
    without_gravity: int = 0
    without_azimuth: int = 0
    lowest: float = math.nan
    highest: float = math.nan
    north: str = "magnetic"
    reference: str = "none"
    surveys: list[tuple[Survey, float]] = dataclasses.field(default_factory=list)
    warnings: list[str] = dataclasses.field(default_factory=list)
    files: list[str] = dataclasses.field(default_factory=list)

    @property
    def seconds(self) -> float:
        """Time covered, s."""
        return (self.end_ns - self.start_ns) * 1e-9


def process(
    bag: Bag,
    folder: Path,
    estimator: EstimatorSettings,
    given: InputSettings | None = None,
    progress: Callable[[float], None] = lambda _share: None,
    compensation: Compensation | None = None,
    wanted: OutputSettings | None = None,
) -> Summary:
    """
    Write the attitude (by default attitude.csv), surveys.csv and config.yaml of a bag.

    Parameters
    ----------
    bag : Bag
    folder : Path
        Made where it doesn't exist; other files in it are left alone.
    estimator, given : settings
        Of the estimator and of the input.
    progress : callable
        Told the share that is done, 0 to 1, now and then.
    compensation : Compensation, optional
        Calibration of the AHRS, taken off its samples first.
    wanted : OutputSettings, optional

    Raises
    ------
    BagError
        The bag is cut off or damaged (unless `given.partial`), or has no IMU sample.
    ValueError
        The settings ask for a field that no model gives, or the IMU is not in SI.
    OSError
        The folder cannot be written.
    """
    given, wanted = given or InputSettings(), wanted or OutputSettings()
    with drafts(folder) as draft:
        with _destination(draft, bag, wanted, given) as (sink, merger):
            summary = estimate(bag, estimator, given, sink, progress, compensation, wanted.smooth, merger)
        (draft / "surveys.csv").write_text(survey_text(summary.surveys), encoding="utf-8")
        config = config_text(estimator, given, wanted, summary.topics)
        (draft / "config.yaml").write_text(config, encoding="utf-8")
        summary.files = [file.name for file in draft.iterdir()]
        # The largest first: what was asked for.
        summary.files.sort(key=lambda name: (name == "config.yaml", name == "surveys.csv"))
    return summary


def estimate(
    bag: Bag,
    estimator: EstimatorSettings,
    given: InputSettings,
    sink: Callable[[Output], None],
    progress: Callable[[float], None] = lambda _share: None,
    compensation: Compensation | None = None,
    smooth: bool = False,
    merger: Merger | None = None,
) -> Summary:
    """
    Run the estimator over a bag.

    sink: handed what each block gave, in order of time, in a thread of its own; what it raises ends the run.
    smooth: gravity from what comes after each sample too. merger: handed the same, and all messages of the bag.

    Raises
    ------
    BagError, ValueError
        As `process`; or `smooth` with a method that has no smoother.
    """
    if smooth and estimator.method != "bounded":
        raise ValueError(f"smooth: only the method bounded can be smoothed, not {estimator.method}")
    topics = find_topics(bag, given)
    _refuse_damaged(bag, given)
    summary = _estimate(bag, topics, estimator, given, compensation, sink, progress, smooth, merger)
    _refuse_damaged(bag, given)
    if summary.rows == 0:
        raise BagError(f"{bag.path} has no IMU sample in {topics.imu}", "look at it with `mwd bag info`")
    summary.warnings += _worth_saying(bag)
    return summary


def find_topics(bag: Bag, given: InputSettings) -> Topics:
    """
    The topics of the well that is meant.

    Raises
    ------
    BagError
        There is no IMU, or more than one well and none named, or a topic named has another type.
    """
    imu = _named(bag, given.imu_topic, wire.IMU) or _imu_of(bag)
    relative = next((name for name in (IMU, IMU_BURST) if imu.endswith(name)), None)
    namespace = imu.removesuffix(relative) if relative is not None else None

    def beside(relative: str, layout: wire.Layout) -> str | None:
        name = f"{namespace}{relative}"
        return name if namespace is not None and _has(bag, name, layout) else None

    mag = _named(bag, given.mag_topic, wire.MAG) or beside(MAG, wire.MAG)
    if mag is None:
        of_type = [t.name for t in bag.topics.values() if t.type_name == wire.MAG.type_name and t.count]
        named = [name for name in of_type if name.endswith(MAG)]
        # Without a namespace in common only the one that cannot be another well's is taken.
        mag = named[0] if namespace is None and len(named) == 1 else None
    return Topics(
        imu,
        mag,
        beside(PRECISION, wire.IMU) or beside(PRECISION_BURST, wire.IMU),
        beside(TEMPERATURE, wire.TEMPERATURE),
        beside(RIG, wire.RIG_STATE),
    )


@contextlib.contextmanager
def drafts(folder: Path) -> Iterator[Path]:
    """
    A folder beside `folder` to write results into; they move to `folder` when the block ends well, else vanish.

    Raises
    ------
    OSError
        `folder` is a file, or it cannot be made or written.
    """
    if folder.exists() and not folder.is_dir():
        raise NotADirectoryError(20, "it is a file, not a folder", str(folder))
    folder.parent.mkdir(parents=True, exist_ok=True)
    draft = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=".unfinished", dir=folder.parent))
    try:
        yield draft
        if folder.exists():
            for file in sorted(draft.iterdir()):
                if (folder / file.name).is_dir() and not (folder / file.name).is_symlink():
                    shutil.rmtree(folder / file.name)
                file.replace(folder / file.name)
        else:
            draft.chmod(0o777 & ~_umask())
            draft.rename(folder)
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def survey_text(surveys: list[tuple[Survey, float]]) -> str:
    """surveys.csv."""
    return station_csv.text(
        SURVEY_COLUMNS,
        (
            {
                "sequence": survey.sequence,
                "stamp_ns": survey.stamp_ns,
                "duration_s": station_csv.number(survey.duration, 1),
                "samples": survey.samples,
                "requested": "yes" if survey.requested else "no",
                **station_csv.cells(survey.station, depth),
                "uuid": survey.uuid,
            }
            for survey, depth in surveys
        ),
    )


def config_text(estimator: EstimatorSettings, given: InputSettings, wanted: OutputSettings, topics: Topics) -> str:
    """config.yaml: every setting in force, ready for --config; what was read and how stands in comments."""
    head = ["# Settings in force; use them again with: mwd process BAG --config config.yaml"]
    head += [f"# {name}: {value}" for name, value in dataclasses.asdict(topics).items() if value]
    for used, default in ((given, InputSettings()), (wanted, OutputSettings())):
        head += [
            f"# {field.name}: {getattr(used, field.name)}"
            for field in dataclasses.fields(used)
            if field.name not in ("imu_topic", "mag_topic")
            and getattr(used, field.name) != getattr(default, field.name)
        ]
    body: str = yaml.safe_dump(settings_of.to_mapping(estimator), sort_keys=False)
    return "\n".join(head) + "\n" + body


def read_config(path: Path) -> dict[str, Any]:
    """
    Settings of a YAML file: as config.yaml has them, or as a ROS parameter file gives them to the estimator node.

    Raises
    ------
    SettingsError
        It is not YAML, or not a table.
    OSError
        It cannot be read.
    """
    try:
        table = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise settings_of.SettingsError(f"{path} is not YAML: {str(error).splitlines()[0]}") from error
    if table is None:
        return {}
    if isinstance(table, dict):
        for node in table.values():
            if isinstance(node, dict) and isinstance(node.get("ros__parameters"), dict):
                return _nested(node["ros__parameters"])
        return _nested(table)
    raise settings_of.SettingsError(f"{path}: expected a table of settings, got {table!r}")


def _nested(table: dict[str, Any]) -> dict[str, Any]:
    """Dotted names, as ROS writes them, as tables in tables."""
    out: dict[str, Any] = {}
    for key, value in table.items():
        *parents, leaf = str(key).split(".")
        place = out
        for parent in parents:
            place = place.setdefault(parent, {})
        place[leaf] = _nested(value) if isinstance(value, dict) else value
    return out


@contextlib.contextmanager
def _destination(
    folder: Path, bag: Bag, wanted: OutputSettings, given: InputSettings
) -> Iterator[tuple[Callable[[Output], None], Merger | None]]:
    """What writes the attitude of each block."""
    thinner = Thinner(wanted.rate_hz)
    if wanted.format == "mcap":
        with Merger(folder / MERGED, bag, find_topics(bag, given).imu, thinner) as merger:
            yield lambda _output: None, merger
        return
    if wanted.format == "parquet":
        # Not for everyone: it takes longer to load than a short recording to process.
        from mwd_surface.exports import attitude_parquet

        with attitude_parquet.Writer(folder / "attitude.parquet") as writer:

            def write_table(output: Output) -> None:
                picked = thinner(output.attitude["stamp_ns"])
                writer.write(output.attitude[picked], output.gravity[picked])

            yield write_table, None
        return
    with (folder / "attitude.csv").open("wb") as file:
        file.write(attitude_csv.HEADER.encode() + b"\n")
        lines = attitude_csv.Lines()

        def write_lines(output: Output) -> None:
            picked = thinner(output.attitude["stamp_ns"])
            file.write(lines(output.attitude[picked], output.gravity[picked]))

        yield write_lines, None


@dataclasses.dataclass(frozen=True)
class _Found:
    """
    What one stage hands to the next.

    Attributes
    ----------
    output, log_ns : Output and ndarray of int64
        What some IMU samples gave, and when these were logged; or None.
    originals : list of Originals
        Messages of the bag.
    until_ns : int
        Nothing that is logged up to then is still to come.
    """

    output: Output | None
    log_ns: NDArray[np.int64] | None
    originals: list[Originals] = dataclasses.field(default_factory=list)
    until_ns: int | None = None


def _last_log(block: Block, originals: list[Originals]) -> int:
    """Log time of the last message of a block, ns."""
    logged = [int(part[0][-1]) for part in block.values()]
    return max(logged + [int(one.log_ns[-1]) for one in originals if len(one.log_ns)], default=0)


def _estimate(
    bag: Bag,
    topics: Topics,
    estimator: EstimatorSettings,
    given: InputSettings,
    compensation: Compensation | None,
    sink: Callable[[Output], None],
    progress: Callable[[float], None],
    smooth: bool,
    merger: Merger | None,
) -> Summary:
    summary = Summary(topics)
    differ = _frames_differ(bag, topics)
    pipeline = Pipeline(estimator)
    depth = DepthTrack()

    def sensor_depth(stamp_ns: int) -> float:
        reading = depth.sensor_depth(stamp_ns, given.sensor_to_bit_m)
        return reading.measured_depth if reading.measured_depth >= 0.0 else math.nan

    start_ns = bag.start_ns + round(given.start_s * 1e9)
    end_ns = bag.start_ns + round(given.end_s * 1e9) if math.isfinite(given.end_s) else None
    last_ns = min(bag.end_ns, end_ns) if end_ns is not None else bag.end_ns
    use_mag = topics.mag is not None
    if differ and not given.same_axes:
        use_mag = False
        summary.warnings.append(f"{differ}: the magnetometer is not used; if they share axes say --same-axes")
    unchecked = {topics.imu, topics.mag}

    def blocks() -> Iterator[tuple[Block, list[Originals]]]:
        if merger is not None:
            yield from bag.blocks_and_originals(topics.all, start_ns, end_ns, fields=_FIELDS)
            return
        for block in bag.blocks(topics.all, start_ns, end_ns, fields=_FIELDS):
            yield block, []

    def found() -> Iterator[_Found]:
        nonlocal use_mag, unchecked
        held = ImuQueue(estimator.bounded if smooth else None)
        with ahead(blocks()) as ready:
            for block, originals in ready:
                samples = _in_si(block, topics, given)
                if topics.imu in unchecked and topics.imu in samples:
                    summary.warnings += _check_imu(topics.imu, samples[topics.imu])
                if use_mag and topics.mag in unchecked and topics.mag in samples:
                    doubtful = _check_mag(topics.mag, samples[topics.mag])
                    summary.warnings += doubtful
                    use_mag = not doubtful
                unchecked -= samples.keys()
                if compensation is not None:
                    _compensate(compensation, samples, topics)
                # One block ahead of the IMU, so that where a block ends makes no difference to how a sample is paired.
                if use_mag and topics.mag in samples:
                    pipeline.push_mag(samples[topics.mag])
                if topics.precision in samples:
                    pipeline.push_precision(samples[topics.precision])
                if topics.temperature in samples:
                    pipeline.push_temperature(samples[topics.temperature])
                if topics.rig in samples:
                    for row in samples[topics.rig]:
                        depth.update(int(row["stamp_ns"]), float(row["bit_depth"]), bool(row["valid"] & _BIT_DEPTH))
                logged = _last_log(block, originals)
                for imu in held.done(logged):
                    yield _Found(pipeline.push_imu(imu.samples, imu.followed), imu.log_ns)
                if topics.imu in samples:
                    held.add(samples[topics.imu], block[topics.imu][0])
                if merger is not None:
                    yield _Found(None, None, originals, held.first_log_ns - 1 if held.waiting else logged)
                progress(_share(logged, start_ns, last_ns))
        for imu in held.finish():
            yield _Found(pipeline.push_imu(imu.samples, imu.followed), imu.log_ns)
        yield _Found(pipeline.finish(), None)

    def put_away(one: _Found) -> None:
        if merger is not None:
            merger.take(one.output, one.log_ns, one.originals, one.until_ns)
        if one.output is not None:
            sink(one.output)
            _count(one.output, summary)

    with behind(put_away) as give:
        for one in found():
            if one.output is not None:
                surveys = one.output.surveys
                summary.surveys += [(survey, sensor_depth(survey.stamp_ns)) for survey in surveys]
            give(one)
    if merger is not None:
        summary.warnings += merger.remarks
    progress(1.0)
    summary.north = pipeline.north
    summary.reference = pipeline.reference.source if pipeline.reference is not None else "none"
    if compensation is not None and compensation.without_temperature:
        summary.warnings.append(
            f"{compensation.without_temperature} samples were calibrated before any temperature was known"
        )
    if pipeline.counters.late_mag:
        summary.warnings.append(
            f"{pipeline.counters.late_mag} magnetic samples came later than azimuth.mag_lag_s allows: raise it"
        )
    return summary


def _compensate(compensation: Compensation, samples: dict[str | None, wire.Samples], topics: Topics) -> None:
    """Take the calibration off the AHRS samples of a block, in place."""
    if topics.temperature in samples:
        compensation.push_temperature(samples[topics.temperature])
    if topics.imu in samples:
        samples[topics.imu] = compensation.imu(samples[topics.imu])
    if topics.mag in samples:
        samples[topics.mag] = compensation.mag(samples[topics.mag])


def _count(output: Output, summary: Summary) -> None:
    attitude = output.attitude
    if summary.rows == 0 and len(attitude):
        summary.start_ns = int(attitude["stamp_ns"][0])
    summary.rows += len(attitude)
    if len(attitude):
        summary.end_ns = int(attitude["stamp_ns"][-1])
    status = np.ascontiguousarray(attitude["status"])
    summary.rejected += int(np.count_nonzero(status & int(Status.REJECTED)))
    summary.gaps += int(np.count_nonzero(status & int(Status.GAP)))
    known = attitude["sigma_inclination"] >= 0.0
    summary.without_gravity += int(len(attitude) - np.count_nonzero(known))
    summary.without_azimuth += int(np.count_nonzero(attitude["sigma_azimuth"] < 0.0))
    inclination = attitude["inclination"][known]
    if len(inclination):
        summary.lowest = float(np.fmin(summary.lowest, inclination.min()))
        summary.highest = float(np.fmax(summary.highest, inclination.max()))


def _in_si(block: Block, topics: Topics, given: InputSettings) -> dict[str | None, wire.Samples]:
    samples: dict[str | None, wire.Samples] = {name: part[1] for name, part in block.items()}
    for name, field, quantity, unit in (
        (topics.imu, "linear_acceleration", "acceleration", given.accel_unit),
        (topics.imu, "angular_velocity", "rate", given.gyro_unit),
        (topics.mag, "magnetic_field", "field", given.mag_unit),
    ):
        scale = units.factor(quantity, unit)
        if scale != 1.0 and name in samples:
            samples[name][field] *= scale
    return samples


def _check_imu(topic: str, imu: wire.Samples) -> list[str]:
    """Refuse an IMU that is not in SI; a warning where it is implausible in any unit."""
    warnings = []
    for field, quantity, option in (
        ("linear_acceleration", "acceleration", "--accel-unit"),
        ("angular_velocity", "rate", "--gyro-unit"),
    ):
        found = units.doubt(quantity, imu[field])
        if found and found[1]:
            raise ValueError(f"{topic}: {found[0]}; say so with {option} {found[1]}")
        if found:
            warnings.append(f"{topic}: {found[0]}")
    return warnings


def _check_mag(topic: str | None, mag: wire.Samples) -> list[str]:
    """Why a magnetometer cannot be used; empty where it can."""
    found = units.doubt("field", mag["magnetic_field"])
    if found is None:
        return []
    remedy = f"say so with --mag-unit {found[1]}" if found[1] else "look at the magnetometer or its driver"
    return [f"{topic}: {found[0]}; not used, there is no azimuth: {remedy}"]


def _frames_differ(bag: Bag, topics: Topics) -> str:
    """Which frames IMU and magnetometer name, where they name different ones; else empty."""
    if topics.mag is None:
        return ""
    found: dict[str, str] = {}
    for count, (_, name, _, data) in enumerate(bag.messages([topics.imu, topics.mag])):
        with contextlib.suppress(wire.WireError):
            found.setdefault(name, wire.frame_id(data))
        if len(found) == 2 or count > _FRAMES_LOOKED_AT:
            break
    if len(set(found.values())) < 2:
        return ""
    return " and ".join(f"{name} is in {frame!r}" for name, frame in found.items())


def _refuse_damaged(bag: Bag, given: InputSettings) -> None:
    if given.partial or (bag.complete and not _cut_off(bag.path)):
        return
    notes = _worth_saying(bag)
    reason = f": {notes[-1]}" if notes else ""
    raise BagError(
        f"{bag.path} is cut off or damaged{reason}",
        f"make it whole with `mwd recover {bag.path}`, or take what can be read with --partial",
    )


def _cut_off(path: Path) -> bool:
    """Whether a file lacks its very end: nothing may be lost, but nobody can know."""
    for file in path.glob("*.mcap") if path.is_dir() else [path]:
        if file.suffix == ".mcap":
            with file.open("rb") as opened:
                opened.seek(-len(MAGIC), os.SEEK_END)
                if opened.read() != MAGIC:
                    return True
    return False


def _worth_saying(bag: Bag) -> list[str]:
    # Most recordings of others carry no checksums; that is no news to who processes one.
    return [note for note in dict.fromkeys(bag.notes) if not note.startswith("the recording carries no checksums")]


def _share(logged_ns: int, start_ns: int, last_ns: int) -> float:
    return min(max((logged_ns - start_ns) / max(last_ns - start_ns, 1), 0.0), 1.0)


def _named(bag: Bag, name: str, layout: wire.Layout) -> str | None:
    """The topic of that name, checked to be there and of that type; None for an empty name."""
    if not name:
        return None
    for candidate in (name, f"/{name}"):
        about = bag.topics.get(candidate)
        if about is None:
            continue
        if not _carries(about.type_name, layout):
            raise BagError(f"{candidate} is a {about.type_name}", f"expected a {layout.type_name}")
        return candidate
    raise BagError(f"{bag.path} has no topic {name}", f"it has {', '.join(bag.topics)}")


def _imu_of(bag: Bag) -> str:
    """The AHRS: as single messages or, where there are none, in bursts."""
    single = any(topic.type_name == wire.IMU.type_name and topic.name.endswith(IMU) for topic in bag.topics.values())
    in_bursts = any(topic.type_name == burst.TYPE_NAME for topic in bag.topics.values())
    if in_bursts and not single:
        return bag.find_topic(burst.TYPE_NAME, IMU_BURST)
    return bag.find_topic(wire.IMU.type_name, IMU)


def _has(bag: Bag, name: str, layout: wire.Layout) -> bool:
    about = bag.topics.get(name)
    return about is not None and _carries(about.type_name, layout) and about.count > 0


def _carries(type_name: str, layout: wire.Layout) -> bool:
    """Whether a topic of that type gives samples of that layout."""
    return type_name == layout.type_name or (type_name == burst.TYPE_NAME and layout is wire.IMU)


def _umask() -> int:
    now = os.umask(0)
    os.umask(now)
    return now
