# SPDX-License-Identifier: Apache-2.0
"""
Selection of the estimator's input from a bag: the topics of one well, in SI and plausible, in a complete recording.

Input that cannot be used is refused with advice on what to do, or reported as a warning.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.fault_messages import describe, unit_words
from mwd_estimation.core.sensor_fault import FaultCode, FaultUnit, SensorFault
from mwd_sensors.core import burst, units, wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.foreign_text import first_of
from mwd_sensors.core.mount import Mount, MountSettings, Transforms, resolve
from mwd_sensors.core.settings import setting
from mwd_surface.bags.bag_files import is_cut_off
from mwd_surface.bags.bag_reader import Bag, BagError, Block
from mwd_surface.bags.mcap.writer import is_being_written
from mwd_surface.bags.topic_info import FORCE, MAGNETIC, RATE, REMEDY
from mwd_surface.processing.half_imu import ImuKind, is_accelerometer, kind_of

IMU, MAG, PRECISION, TEMPERATURE, RIG = "imu/data_raw", "imu/mag", "gyro/data_raw", "imu/temperature", "rig/state"
IMU_BURST, PRECISION_BURST = burst.TOPICS
# Sensor, field of its message, quantity, and command option for the quantity's unit.
QUANTITIES = (
    ("imu", "linear_acceleration", "acceleration", "--accel-unit"),
    ("imu", "angular_velocity", "rate", "--gyro-unit"),
    ("mag", "magnetic_field", "field", "--mag-unit"),
)
# Fields to read, by message type.
FIELDS = {
    wire.IMU.type_name: (
        "angular_velocity",
        "angular_velocity_covariance",
        "linear_acceleration",
        "linear_acceleration_covariance",
    ),
    wire.MAG.type_name: ("magnetic_field", "magnetic_field_covariance"),
    wire.TEMPERATURE.type_name: ("temperature",),
    wire.RIG_STATE.type_name: ("bit_depth", "valid"),
}
# Topics of results with their types; a namespace with one of these topics belongs to a well that this program has
# estimated. _ORIENTED is the topic on which the estimator publishes the IMU samples with the orientation.
_RESULTS = {
    "attitude": "mwd_msgs/msg/Attitude",
    "gravity": "mwd_msgs/msg/Gravity",
    "survey": "mwd_msgs/msg/Survey",
    "surveys": "mwd_msgs/msg/SurveyList",
    "used_samples": "mwd_msgs/msg/UsedSamples",
}
_ORIENTED = "imu/data"
_TRANSFORMS = "tf2_msgs/msg/TFMessage"
_LOOKED_AT = 2000  # number of messages of all topics together after which frames and times are considered known
_AVERAGED, _AVERAGED_NS = 10, 5e7  # largest number of samples, and longest time, ns, of a mean tested for gravity
# Smallest mean specific force that can be gravity, in m/s2, g or mg; even a turning tool has a larger mean. The lowest
# limit in `units` is the same.
_LEAST_GRAVITY = 0.3
_IN_TURNS = 4  # smallest number of frame changes of a topic that shows that two units publish it
# Smallest number of messages with equal stamps that shows that a topic has no stamps of its own, and of samples in
# which missing gravity is looked for.
_SAME_AT_LEAST = 10


@dataclasses.dataclass(frozen=True)
class InputSettings:
    """Choice of the input from a bag, and how to read it."""

    imu_topic: str = setting(
        "", "Topic of the IMU or its gyro; empty: the topic ending in imu/data_raw, or the only one."
    )
    accel_topic: str = setting(
        "", "Topic of the accelerometer if imu_topic is only the gyro; empty: found by its name."
    )
    mag_topic: str = setting("", "Topic of the magnetometer; empty: imu/mag next to the IMU, or the only one.")
    gyro_topic: str = setting("", "Topic of the precision unit; empty: gyro/data_raw next to the IMU.")
    temperature_topic: str = setting("", "Topic of the IMU's temperature; empty: imu/temperature next to it.")
    rig_topic: str = setting("", "Topic of the rig state; empty: rig/state next to the IMU, or the only one.")
    accel_unit: str = setting("m/s2", "Unit of the specific force.", choices=tuple(units.FACTORS["acceleration"]))
    gyro_unit: str = setting("rad/s", "Unit of the angular rate.", choices=tuple(units.FACTORS["rate"]))
    mag_unit: str = setting("T", "Unit of the magnetic field.", choices=tuple(units.FACTORS["field"]))
    start_s: float = setting(0.0, "Begin this long after the first message.", unit="s", low=0.0)
    end_s: float = setting(math.inf, "End this long after the first message.", unit="s", low=0.0)
    partial: bool = setting(False, "Use the readable part of a bag that is cut off or damaged.")
    sensor_to_bit_m: float | None = setting(
        None, "Distance from sonde to bit; nan: the distance in the recording, else 0.", unit="m", low=0.0, high=100.0
    )
    stamps: str = setting(
        "header",
        "Times of the samples: header uses the stamps of the messages; recording converts them to the clock of the "
        "recorder, for sensors whose clocks disagree or were not set.",
        choices=("header", "recording"),
    )
    depths: str = setting("", "Table of depths, CSV; empty: the depths of the rig in the recording.")


def option_of(name: str) -> str:
    """Return the command-line option of a field of `InputSettings`."""
    return {"start_s": "--start", "end_s": "--end"}.get(name, f"--{name.replace('_', '-')}")


@dataclasses.dataclass(frozen=True)
class Topics:
    """The topics of one well in a bag; a topic that the bag lacks is None."""

    imu: str
    mag: str | None
    precision: str | None
    temperature: str | None
    rig: str | None
    #: topic of the accelerometer if `imu` is only the gyro
    accelerometer: str | None = None
    #: vectors that the messages of `imu` carry
    kind: ImuKind = ImuKind.WHOLE

    @property
    def all(self) -> list[str]:
        """Topics that are not None."""
        names = (self.imu, self.mag, self.precision, self.temperature, self.rig, self.accelerometer)
        return [name for name in names if name is not None]


def find_topics(bag: Bag, given: InputSettings) -> Topics:
    """
    Return the topics of the well that the settings select, or of the only well in a bag.

    Raises
    ------
    BagError
        The bag has no IMU, or has several and `given` names none of them; or a named topic has another type.
    """
    for name, quantity in ((given.imu_topic, RATE), (given.accel_topic, FORCE), (given.mag_topic, MAGNETIC)):
        _name_vector(bag, name, quantity)
    named_accelerometer = named_topic(bag, given.accel_topic, wire.IMU)
    imu = named_topic(bag, given.imu_topic, wire.IMU) or _imu_of(bag, named_accelerometer)
    # A live estimator of this program used each message as a complete reading: zeros in a message are then a sensor
    # fault.
    used_live, accelerometer = namespace_of(bag, imu) in graph_namespaces(bag), named_accelerometer
    if not used_live and accelerometer is None:
        imu, accelerometer = _halves(bag, imu)
    relative = next((name for name in (IMU, IMU_BURST) if imu.endswith(name)), None)
    namespace = imu.removesuffix(relative) if relative is not None else None

    def beside(layout: wire.Layout, *relatives: str, alone: bool = False) -> str | None:
        """
        Return the topic with a relative name next to the IMU, else the only topic that can belong to the same well.

        The result is None if there is neither.

        alone : whether the only topic may have any name.
        """
        for relative in relatives if namespace is not None else ():
            if _has(bag, f"{namespace}{relative}", layout):
                return f"{namespace}{relative}"
        there = [name for name in bag.topics if name not in (imu, accelerometer) and _has(bag, name, layout)]
        # A message of the type identifies the sensor better than a vector whose name suggests the quantity.
        there = [name for name in there if bag.topics[name].type_name == layout.type_name] or there
        usual = [name for name in there if name.endswith(relatives)]
        if namespace is not None:
            return there[0] if alone and len(there) == 1 and not usual else None
        found = there if alone else usual
        return found[0] if len(found) == 1 else None

    topics = Topics(
        imu,
        named_topic(bag, given.mag_topic, wire.MAG) or beside(wire.MAG, MAG, alone=True),
        named_topic(bag, given.gyro_topic, wire.IMU) or beside(wire.IMU, PRECISION, PRECISION_BURST),
        named_topic(bag, given.temperature_topic, wire.TEMPERATURE) or beside(wire.TEMPERATURE, TEMPERATURE),
        named_topic(bag, given.rig_topic, wire.RIG_STATE) or beside(wire.RIG_STATE, RIG, alone=True),
        accelerometer,
        ImuKind.GYRO if accelerometer else ImuKind.WHOLE if used_live else _kind(bag, imu),
    )
    _use_first_frames(bag, [name for name in (imu, accelerometer, topics.mag, topics.precision) if name is not None])
    return topics


def _use_first_frames(bag: Bag, names: Sequence[str]) -> None:
    """
    Use only the first frame of each topic whose messages alternate between frames, as the live estimator does.

    The other frames belong to a second unit. Messages alternate if the frame changes `_IN_TURNS` times or more among
    the first messages, about `_LOOKED_AT` of all topics together.
    """
    seen: dict[str, list[str]] = {name: [] for name in names if bag.topics[name].type_name != burst.TYPE_NAME}
    for count, (_, name, _, data) in enumerate(bag.messages(list(seen)) if seen else ()):
        with contextlib.suppress(wire.WireError):
            seen[name].append(wire.frame_id(data))
        if count > _LOOKED_AT:
            break
    for name, frames in seen.items():
        # A driver may change the name of its frame once, but not repeatedly.
        if sum(1 for one, other in itertools.pairwise(frames) if one != other) >= _IN_TURNS:
            bag.use_frame(name, frames[0])


def graph_namespaces(bag: Bag) -> list[str]:
    """Return the namespaces, with a slash at the end, in which a bag has results of this program's estimator."""
    return sorted(
        {
            about.name.removesuffix(name)
            for about in bag.topics.values()
            for name, type_name in _RESULTS.items()
            if about.type_name == type_name and about.name.endswith(f"/{name}")
        }
    )


def namespace_of(bag: Bag, imu: str) -> str | None:
    """
    Return the namespace of the well of an IMU, with a slash at its end; None if it is not known.

    An IMU whose name was chosen by its driver belongs to the only well with results in the bag.
    """
    for name in (IMU, IMU_BURST):
        if imu.endswith(name):
            return imu.removesuffix(name)
    spaces = graph_namespaces(bag)
    return spaces[0] if len(spaces) == 1 else None


def _measured(bag: Bag, names: Sequence[str]) -> list[str]:
    """
    Return the topics of IMUs without those that the estimator publishes, which repeat the same samples.

    If no other topic is left, return all topics.
    """
    own = {f"{space}{_ORIENTED}" for space in graph_namespaces(bag)}
    return [name for name in names if name not in own] or list(names)


def wells(bag: Bag, given: InputSettings) -> list[Topics]:
    """
    Return the topics of every well in a bag, one entry for each IMU with the usual name.

    If an IMU is selected, or fewer than two IMUs have the usual name, there is one entry.

    Raises BagError as `find_topics` does.
    """
    usual = [name for name in bag.topics if name.endswith(IMU) and _has(bag, name, wire.IMU)]
    if given.imu_topic or len(usual) < 2:
        return [find_topics(bag, given)]
    return [find_topics(bag, dataclasses.replace(given, imu_topic=name)) for name in sorted(usual)]


def guesses(bag: Bag, topics: Topics, given: InputSettings) -> list[str]:
    """Return remarks on the choice of topics: topics used under an unusual name, and topics left out."""
    remarks = []
    for taken, named, usual, what in (
        (topics.imu, given.imu_topic, (IMU, IMU_BURST), "IMU"),
        (topics.mag, given.mag_topic, (MAG,), "magnetometer"),
    ):
        if taken == topics.imu and topics.accelerometer is not None:
            remarks.append(
                f"the gyro of {topics.imu} and the accelerometer of {topics.accelerometer} are paired by time"
            )
        elif taken is not None and not named and not taken.endswith(usual):
            remarks.append(f"{taken} is used as the {what}, because the recording has no other")
    remarks += [
        f"{name} comes in several alternating frames: two units publish it, and only frame {frame!r} is used"
        for name, frame in bag.frames_used.items()
        if name in topics.all
    ]
    if topics.mag is None:
        others = [name for name in bag.topics if _has(bag, name, wire.MAG)]
        if others:
            remarks.append(f"no magnetometer next to {topics.imu}; choose one with --mag-topic: {', '.join(others)}")
    if topics.precision is None:
        wells = (IMU, IMU_BURST, PRECISION, PRECISION_BURST)
        used = (topics.imu, topics.accelerometer)
        others = [n for n in bag.topics if _has(bag, n, wire.IMU)]
        others = [n for n in _measured(bag, others) if n not in used and not n.endswith(wells)]
        if others:
            remarks.append(f"not used: {', '.join(others)}; choose the precision unit with --gyro-topic")
    if topics.kind in (ImuKind.IN_TURNS, ImuKind.SOME_EMPTY):
        remarks.append(
            f"{topics.imu}: gyro and accelerometer come in alternating messages, each with zeros for the other sensor; "
            "they are paired by time"
            if topics.kind == ImuKind.IN_TURNS
            else f"{topics.imu}: messages that have only zeros are left out"
        )
    rigs = [name for name in bag.topics if _has(bag, name, wire.RIG_STATE) and name != topics.rig]
    if rigs and topics.rig is None:
        remarks.append(f"no depth: choose the topic of the rig with --rig-topic: {', '.join(rigs)}")
    elif rigs and not given.rig_topic:
        remarks.append(f"depths are read from {topics.rig}; not used: {', '.join(rigs)}")
    return remarks


def unstamped(bag: Bag, names: Sequence[str]) -> frozenset[str]:
    """
    Return topics without times of their own: the stamps of their first messages are all zero, or all equal.

    If the IMU is such a topic, a topic with a single message belongs to them if its stamp is zero.

    names : topics of samples, the IMU first.
    """
    fields = {layout.type_name: () for layout in (wire.IMU, wire.MAG, wire.TEMPERATURE, wire.RIG_STATE)}
    first = next(bag.blocks(names, block_messages=_LOOKED_AT, fields=fields), {})
    found = {name for name, (_, samples) in first.items() if _timeless(samples["stamp_ns"])}
    if names[0] in found:
        # A single stamp of 0 may be the start of a clock; if the IMU has no times, it means that the topic has none.
        found |= {name for name, (_, samples) in first.items() if not samples["stamp_ns"].any()}
    return frozenset(found)


def _timeless(stamp_ns: NDArray[np.int64]) -> bool:
    return len(stamp_ns) >= (_SAME_AT_LEAST if stamp_ns[0] else 2) and bool((stamp_ns == stamp_ns[0]).all())


def in_si(block: Block, topics: Topics, given: InputSettings) -> Block:
    """Return a block with the samples of IMU and magnetometer in SI; the samples are changed in place."""
    for name, field, quantity, unit in (
        (topics.imu, "linear_acceleration", "acceleration", given.accel_unit),
        (topics.imu, "angular_velocity", "rate", given.gyro_unit),
        (topics.mag, "magnetic_field", "field", given.mag_unit),
    ):
        scale = units.factor(quantity, unit)
        if scale != 1.0 and name in block:
            samples = block[name][1]
            samples[field] *= scale
            covariance = samples[f"{field}_covariance"]
            covariance[covariance[:, 0] != -1.0] *= scale**2
    return block


class OptionNeededError(ValueError):
    """Raised if the samples can be used only with other options of the input, which the message names."""


def check_units(topics: Topics, samples: Mapping[str | None, Samples]) -> list[str]:
    """
    Return warnings about readings that are implausible in every unit.

    samples : some samples of the IMU and of the magnetometer, in SI.

    Raises
    ------
    OptionNeededError
        Readings look like another unit; the message names all of them and the options to set.
    """
    warnings, words, options = [], [], []
    for name, field, quantity, option in QUANTITIES:
        topic = getattr(topics, name)
        found = units.doubt(quantity, samples[topic][field]) if topic in samples else None
        if found and found[1]:
            words.append(f"{topic}: {found[0]}")
            options.append(f"{option} {found[1]}")
        elif found:
            remedy = "; not used: check the magnetometer and its driver" if name == "mag" else ""
            warnings.append(f"{topic}: {found[0]}{remedy}")
    if options:
        raise OptionNeededError(f"{'; '.join(words)}; set the unit with {' '.join(options)}")
    return warnings


def refuse_wrong_unit(topics: Topics, faults: Sequence[SensorFault]) -> None:
    """Raise OptionNeededError if a fault that lasts to the end shows a wrong unit; the message names the option."""
    last = {fault.check: fault for fault in faults if fault.unit == FaultUnit.CONVENTIONAL}
    for fault in last.values():
        if fault.code == FaultCode.UNIT and not fault.cleared_ns:
            option, unit = QUANTITIES[(1, 0, 2)[fault.place // 3]][3], unit_words(fault)
            topic = topics.mag if fault.place // 3 == 2 else topics.imu
            raise OptionNeededError(f"{topic}: {describe(fault).message}; set the unit with {option} {unit}")


def mount_of(bag: Bag, topics: Topics, given: MountSettings) -> Mount:
    """
    Return the mount of the units in the tool, from the settings, the message frames and the static transforms.

    Raises
    ------
    BagError
        The mount of the IMU is not known.
    """
    units = {"imu": topics.imu, "mag": topics.mag, "precision": topics.precision}
    seen = frame_names(bag, [name for name in units.values() if name is not None])
    names = {unit: seen.get(name, "") for unit, name in units.items() if name is not None}
    mount = resolve(given, names, static_transforms(bag))
    if "imu" in mount.unusable:
        raise BagError(
            f"{topics.imu}: {mount.unusable['imu']}", "give the mount to `mwd process`, for example --mount z-down"
        )
    there = {unit: why for unit, why in mount.unusable.items() if units[unit] is not None}
    return dataclasses.replace(mount, unusable=there)


def tool_frame(bag: Bag, topics: Topics, mount: Mount) -> str:
    """
    Return the name of the frame of the tool's axes.

    This is the frame of the sonde if the mount turns the samples, else the frame in the messages of the IMU.
    """
    frame = frame_names(bag, [topics.imu]).get(topics.imu, wire.SONDE_FRAME)
    return frame[: frame.rfind("/") + 1] + wire.SONDE_FRAME if mount.turns else frame


def frame_names(bag: Bag, topics: list[str]) -> dict[str, str]:
    """
    Return, by topic, the frame in the first message that has one; topics without a frame are left out.

    Only the first messages of all topics together, about `_LOOKED_AT`, are read.
    """
    found: dict[str, str] = {}
    for count, (_, name, _, data) in enumerate(bag.messages(topics)):
        with contextlib.suppress(wire.WireError):
            if frame := wire.frame_id(data):
                found.setdefault(name, frame)
        if len(found) == len(topics) or count > _LOOKED_AT:
            break
    return found


def static_transforms(bag: Bag) -> Transforms:
    """Return the static transforms in a bag, from all topics whose name ends in tf_static."""
    transforms = Transforms()
    topics = [t.name for t in bag.topics.values() if t.name.endswith("tf_static") and t.type_name == _TRANSFORMS]
    for _, name, _, data in bag.messages(topics) if topics else ():
        for one in bag.decode(name, data).transforms:
            q = one.transform.rotation
            transforms.add(one.header.frame_id, one.child_frame_id, (q.x, q.y, q.z, q.w))
    return transforms


def refuse_damaged(bag: Bag, given: InputSettings) -> None:
    """Raise BagError for a damaged recording, unless `given.partial` accepts it."""
    if given.partial or (bag.complete and not is_cut_off(bag.path)):
        return
    if is_being_written(bag.path):
        raise BagError(
            f"{bag.path} is being recorded", "stop the recording first, or use the readable part with --partial"
        )
    notes = worth_saying(bag)
    reason = f": {notes[-1]}" if notes else ""
    raise BagError(
        f"{bag.path} is cut off or damaged{reason}",
        f"repair it with `mwd recover {bag.path}`, or use the readable part with --partial",
    )


def worth_saying(bag: Bag) -> list[str]:
    """Return the notes on a recording that a user should see."""
    # Most recordings of other programs carry no checksums, so this note would not help the user.
    return [note for note in dict.fromkeys(bag.notes) if not note.startswith("the recording carries no checksums")]


def _name_vector(bag: Bag, name: str, quantity: str) -> None:
    """Set the quantity of a topic of vectors that a user chose for a sensor, unless its name shows a quantity."""
    for candidate in (name, f"/{name}"):
        about = bag.topics.get(candidate)
        if about is not None and about.type_name == wire.VECTOR.type_name and not about.quantity:
            bag.topics[candidate] = dataclasses.replace(about, quantity=quantity)


def named_topic(bag: Bag, name: str, layout: wire.Layout) -> str | None:
    """
    Return the topic of a name, with or without its first slash; None for an empty name.

    Raises
    ------
    BagError
        There is no topic of that name, or its messages do not carry samples of the type of `layout`.
    """
    if not name:
        return None
    for candidate in (name, f"/{name}"):
        if candidate in bag.unreadable:
            raise BagError(f"{bag.path}: {bag.unreadable[candidate].described()}", REMEDY)
        about = bag.topics.get(candidate)
        if about is None:
            continue
        if about.gives != layout.type_name:
            what = f"{about.type_name} of {about.quantity}" if about.quantity else about.type_name
            raise BagError(f"{candidate} is a {what}", f"expected a {layout.type_name}")
        return candidate
    raise BagError(f"{bag.path} has no topic {name}", f"it has {first_of(list(bag.topics))}")


def _imu_of(bag: Bag, accelerometer: str | None) -> str:
    """
    Return the topic of the IMU: a topic of single messages or, if the bag has none, of bursts or of vectors.

    The only IMU in a bag may have any name.

    accelerometer : topic known to be only the accelerometer half.

    Raises BagError if there is no IMU, or if several topics may be the IMU.
    """
    here = [t for t in bag.topics.values() if t.type_name == wire.IMU.type_name and t.name != accelerometer]
    # Ignore topics without messages if another topic has some.
    here = [topic for topic in here if topic.count] or here
    usual = [topic.name for topic in here if topic.name.endswith(IMU)]
    if not usual and any(topic.type_name == burst.TYPE_NAME for topic in bag.topics.values()):
        return bag.find_topic(burst.TYPE_NAME, IMU_BURST)
    if not any(topic.count for topic in here):
        here = [t for t in bag.topics.values() if t.quantity == RATE and t.count]
        here = here or [t for t in bag.topics.values() if t.quantity == FORCE and t.count]
    candidates = usual or [topic.name for topic in here if topic.count and not topic.name.endswith(PRECISION)]
    candidates = _measured(bag, candidates)
    if len(candidates) > 1 and not usual:
        candidates = _likely(bag, candidates)
    if len(candidates) == 1:
        return candidates[0]
    if candidates:
        which = f"end in {IMU!r}" if usual else "may be the IMU"
        raise BagError(
            f"{bag.path} has {len(candidates)} topics that {which}: {', '.join(candidates)}",
            "choose one with --imu-topic",
        )
    vectors = [t.name for t in bag.topics.values() if t.type_name == wire.VECTOR.type_name and t.count]
    if vectors:
        raise BagError(
            f"{bag.path} has no IMU, and the names of its topics of type {wire.VECTOR.type_name} do not show what they "
            f"measure: {', '.join(vectors)}",
            "choose the gyro with --imu-topic, the accelerometer with --accel-topic, the magnetometer with --mag-topic",
        )
    return bag.find_topic(wire.IMU.type_name, IMU)


def _likely(bag: Bag, candidates: list[str]) -> list[str]:
    """
    Return the topics that may be the IMU, from their first samples.

    These are the topics with gyro and accelerometer, and of these the topics with gravity if there are any. If no topic
    has both sensors, return the gyro of a pair of two topics, else all candidates.
    """
    first = {name: first_samples(bag, name) for name in candidates}
    whole = [name for name in candidates if kind_of(first[name]) != ImuKind.GYRO and not is_accelerometer(first[name])]
    if whole:
        return [name for name in whole if not without_gravity(first[name])] or whole
    gyros = [name for name in candidates if kind_of(first[name]) == ImuKind.GYRO]
    return gyros if len(gyros) == 1 and len(candidates) == 2 else candidates


def _halves(bag: Bag, imu: str) -> tuple[str, str | None]:
    """Return the topics of gyro and accelerometer; `imu` and None if `imu` has both or the other half is not found."""
    kind, alone = _kind(bag, imu), _is_accelerometer(bag, imu)
    if kind != ImuKind.GYRO and not alone:
        return imu, None
    others = [name for name in bag.topics if _has(bag, name, wire.IMU)]
    others = [name for name in _measured(bag, others) if name != imu]
    if alone:
        gyro = _nearest(imu, [name for name in others if _kind(bag, name) == ImuKind.GYRO])
        return (gyro, imu) if gyro is not None else (imu, None)
    halves = [name for name in others if _is_accelerometer(bag, name)]
    # A driver may publish the acceleration with and without gravity: prefer topics with gravity.
    return imu, _nearest(imu, [name for name in halves if not without_gravity(first_samples(bag, name))] or halves)


def _nearest(name: str, others: list[str]) -> str | None:
    """Return the topic whose name shares the longest beginning with `name`; None unless exactly one topic does."""
    pairs = {other: zip(name, other, strict=False) for other in others}
    shared = {
        other: sum(1 for _ in itertools.takewhile(lambda two: two[0] == two[1], pairs[other])) for other in others
    }
    best = [other for other in others if shared[other] == max(shared.values())]
    return best[0] if len(best) == 1 else None


def _kind(bag: Bag, imu: str) -> ImuKind:
    """Return the kind of an IMU topic, by the vectors that its messages carry."""
    if quantity := bag.topics[imu].quantity:
        return ImuKind.GYRO if quantity == RATE else ImuKind.ACCELEROMETER
    return kind_of(first_samples(bag, imu))


def _is_accelerometer(bag: Bag, name: str) -> bool:
    return bag.topics[name].quantity == FORCE or is_accelerometer(first_samples(bag, name))


def first_samples(bag: Bag, name: str) -> Samples:
    """Return the first samples of an IMU topic, with the fields of `FIELDS`; empty if no sample can be read."""
    layout = wire.IMU.dtype_of(FIELDS[wire.IMU.type_name])
    for block in bag.blocks([name], block_messages=_LOOKED_AT, fields=FIELDS):
        return np.asarray(block[name][1][: 2 * _LOOKED_AT], dtype=layout)
    return np.empty(0, dtype=layout)


def without_gravity(samples: Samples) -> bool:
    """
    Return whether a driver has removed gravity from the specific force.

    Means over at most 10 samples and 50 ms are near gravity even if the tool shakes and turns. Gravity is missing if a
    tenth of these means are below `_LEAST_GRAVITY`, which is far below gravity in any unit. The result is False for
    fewer than `_SAME_AT_LEAST` samples, and if all forces are zero.
    """
    force = samples["linear_acceleration"]
    if len(force) < _SAME_AT_LEAST or not np.any(force):
        return False
    interval_ns = float(np.median(np.diff(samples["stamp_ns"])))
    # Average over so short a time that a tool hardly turns.
    each = min(max(int(_AVERAGED_NS / interval_ns), 1), _AVERAGED) if interval_ns > 0.0 else 1
    count = len(force) // each
    means = force[: count * each].reshape(count, each, 3).mean(axis=1)
    strength = np.linalg.norm(means[np.isfinite(means).all(axis=1)], axis=1)
    return len(strength) > 0 and float(np.percentile(strength, 10.0)) < _LEAST_GRAVITY


def _has(bag: Bag, name: str, layout: wire.Layout) -> bool:
    about = bag.topics.get(name)
    return about is not None and about.gives == layout.type_name and about.count > 0
