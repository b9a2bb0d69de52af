# SPDX-License-Identifier: Apache-2.0
"""
Orientation of the sensor units in the tool: rotations from the axes of each unit to the tool axes.

A mount is written as a preset (axis of the unit that points down-hole or up-hole), as a matrix, as a quaternion, or as
`tf`, which uses the static transforms of a recording or of the graph. The live estimator and the processing of
recordings find the rotations in the same way.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping

import numpy as np

from mwd_sensors.core import frames, wire
from mwd_sensors.core.arrays import Array, Samples
from mwd_sensors.core.settings import setting

AS_IMU, TF = "as imu", "tf"
ALONG = math.cos(math.radians(8.0))
"""A direction counts as an axis of the unit if the cosine of the angle between them is above this (angle below
8 deg): the measured axis of an uncalibrated gyro is wrong by some degrees."""
# Largest difference of a quaternion's length from 1, or of an element of R R' from the identity matrix, that is
# accepted as rounding of the numbers that a user wrote.
_ROUNDING = 2e-3
_HALF_ABOUT_Z = np.diag([-1.0, -1.0, 1.0])


def _presets() -> dict[str, Array]:
    """
    Return the preset rotations; rows are the tool axes x, y, z in axes of the unit.

    "-down" presets are cyclic permutations of the axes. An "-up" preset is the "-down" preset of the same axis turned
    by 180 deg about the tool's z axis.
    """
    found = {}
    for k, axis in enumerate("xyz"):
        down = np.eye(3)[[k, (k + 1) % 3, (k + 2) % 3]]
        found[f"{axis}-down"], found[f"{axis}-up"] = down, _HALF_ABOUT_Z @ down
    return found


PRESETS = _presets()
"""Name -> rotation from unit to tool axes, shape (3, 3); `z-down` means that the unit's z points down-hole."""
_FORMS = f"one of {', '.join(PRESETS)}; nine numbers (rows of the matrix from unit to tool axes); x,y,z,w; or {TF}"


def rotation(text: str) -> Array:
    """
    Return the rotation from unit to tool axes, shape (3, 3), that a text describes.

    The text is a preset, nine numbers (row by row) or a quaternion x,y,z,w.

    Raises
    ------
    ValueError
        The text is something else or its numbers are not a rotation; the message says what is allowed.
    """
    if text in PRESETS:
        return PRESETS[text].copy()
    try:
        figures = np.array([float(part) for part in re.split(r"[\s,;]+", text.strip("[]() \t"))])
    except ValueError:
        figures = np.empty(0)
    if len(figures) not in (4, 9):
        raise ValueError(f"{text!r} is not a mount; write {_FORMS}")
    if len(figures) == 4:
        length = float(np.linalg.norm(figures))
        if not abs(length - 1.0) < _ROUNDING:
            raise ValueError(f"{text!r} is not a rotation: a quaternion has length 1, this one has {length:.4g}")
        return frames.mat_from_quat(figures / length)
    given = figures.reshape(3, 3)
    if not np.abs(given @ given.T - np.eye(3)).max() < _ROUNDING or np.linalg.det(given) < 0.0:
        raise ValueError(f"{text!r} is not a rotation: rows must have length 1, be orthogonal and right-handed")
    u, _, v = np.linalg.svd(given)
    nearest: Array = u @ v
    # A permutation of axes is returned exactly.
    return np.round(nearest) if np.abs(nearest - np.round(nearest)).max() < 1e-12 else nearest


@dataclasses.dataclass(frozen=True)
class MountSettings:
    """Orientation of the sensor units in the tool, as users write it."""

    imu: str = setting(
        "x-down",
        "Axes of the conventional unit in the tool: the axis that points down-hole (x-down, x-up, y-down, y-up, "
        "z-down, z-up), nine numbers (rows of the matrix from unit to tool axes), a quaternion x,y,z,w from unit to "
        f"tool, or tf (static transforms to the frame {wire.SONDE_FRAME}). Set it if the unit's x axis is not the "
        "tool's; the sensor health reports wrong axes.",
    )
    mag: str = setting(
        AS_IMU,
        "Axes of the magnetometer in the tool, written like mount.imu; as imu means the axes of the conventional unit, "
        "or a static transform to them if its messages name another frame.",
        expert=True,
    )
    precision: str = setting(
        AS_IMU,
        "Axes of the high-precision unit in the tool, written like mount.mag.",
        expert=True,
    )
    accelerometer: str = setting(
        "up",
        "Sign of the conventional unit's accelerometer at rest: up (specific force, as in REP-145) or down (gravity). "
        "Set it to down if the sensor health reports that all its signs are reversed.",
        choices=("up", "down"),
    )

    def __post_init__(self) -> None:
        """Raise ValueError for a text that is not a mount."""
        for name in ("imu", "mag", "precision"):
            value = getattr(self, name)
            if value == TF or (value == AS_IMU and name != "imu"):
                continue
            try:
                rotation(value)
            except ValueError as error:
                raise ValueError(f"{name}: {error}" + ("" if name == "imu" else f", or {AS_IMU}")) from error


class Transforms:
    """Static transforms between frames, of which only the rotations are used."""

    def __init__(self) -> None:
        self._to_parent: dict[str, tuple[str, Array]] = {}

    def add(self, parent: str, child: str, quaternion: tuple[float, float, float, float]) -> None:
        """
        Add a transform of tf, or replace the one of the same child.

        The quaternion (x, y, z, w) turns vectors from the child's axes into the parent's. The transform is ignored if
        child and parent have the same name, or if the length of the quaternion is not finite or not above 0.5.
        """
        length = math.hypot(*quaternion)
        if child.strip("/") != parent.strip("/") and math.isfinite(length) and length > 0.5:
            q = np.asarray(quaternion, dtype=float) / length
            self._to_parent[child.strip("/")] = (parent.strip("/"), frames.mat_from_quat(q))

    def between(self, source: str, target: str) -> Array | None:
        """
        Return the rotation, shape (3, 3), from axes of `source` to axes of `target`.

        Returns None if no transforms join the two frames.
        """
        from_source, from_target = self._chain(source.strip("/")), self._chain(target.strip("/"))
        for frame, mat in from_source.items():
            if frame in from_target:
                return np.asarray(from_target[frame].T @ mat)
        return None

    def full_name(self, frame: str) -> str:
        """
        Return the name that the transforms use for a frame.

        If the transforms do not have the plain name, but exactly one name with a prefix (``well/frame``), return this
        name; in all other cases return the plain name.
        """
        known = {name for child, (parent, _) in self._to_parent.items() for name in (child, parent)}
        prefixed = [name for name in known if name.endswith(f"/{frame}")]
        return prefixed[0] if frame not in known and len(prefixed) == 1 else frame

    def _chain(self, frame: str) -> dict[str, Array]:
        """Return the rotations from a frame to each of its ancestors, starting with the frame itself."""
        mat, found = np.eye(3), {}
        while frame not in found:
            found[frame] = mat
            if frame not in self._to_parent:
                break
            frame, step = self._to_parent[frame]
            mat = step @ mat
        return found


@dataclasses.dataclass(frozen=True)
class Mount:
    """Rotations from the axes of each unit to the tool axes, found from settings and transforms."""

    #: `imu`, `mag`, `precision`: shape (3, 3); rotation from the axes of the conventional unit, magnetometer and
    #: high-precision unit to the tool axes.
    imu: Array
    mag: Array
    precision: Array
    #: Units (imu, mag, precision) whose rotation is not known, each with a sentence that says what to do.
    unusable: Mapping[str, str] = dataclasses.field(default_factory=dict)
    #: True if the accelerometer of the conventional unit reads gravity instead of specific force.
    reversed_accelerometer: bool = False
    #: Units (imu, mag, precision) assumed to share the axes of the conventional unit although their messages name
    #: another frame, each with a sentence that says what to do.
    assumed: Mapping[str, str] = dataclasses.field(default_factory=dict)

    @property
    def turns(self) -> bool:
        """Whether the tool's axes differ from those of the conventional unit."""
        return not np.array_equal(self.imu, np.eye(3))

    def imu_in_tool(self, samples: Samples) -> Samples:
        """Return samples of the conventional unit, with all or some fields of `wire.IMU`, in tool axes."""
        out = _turned(samples, self.imu, ("angular_velocity", "linear_acceleration"))
        if self.reversed_accelerometer:
            out = out.copy() if out is samples else out
            out["linear_acceleration"] *= -1.0
        return out

    def mag_in_tool(self, samples: Samples) -> Samples:
        """Return samples of the magnetometer, with all or some fields of `wire.MAG`, in tool axes."""
        return _turned(samples, self.mag, ("magnetic_field",))

    def precision_in_tool(self, samples: Samples) -> Samples:
        """Return samples of the high-precision unit in tool axes, like `imu_in_tool`."""
        return _turned(samples, self.precision, ("angular_velocity", "linear_acceleration"))


def resolve(
    given: MountSettings, names: Mapping[str, str] | None = None, transforms: Transforms | None = None
) -> Mount:
    """
    Return the rotations that follow from settings, frame names and static transforms.

    Parameters
    ----------
    names : mapping of str to str, optional
        Frame name in the messages of each unit (imu, mag, precision); missing or empty if not known.

    Returns
    -------
    Mount
        A unit whose rotation is not known gets the rotation of the conventional unit and is listed in `unusable`. A
        precision unit with the mount `as imu` is listed in `assumed` instead, because its rates can be compared with
        the rates of the conventional unit.
    """
    names, transforms = names or {}, transforms or Transforms()
    unusable: dict[str, str] = {}
    assumed: dict[str, str] = {}
    found: dict[str, Array] = {}
    for unit in ("imu", "mag", "precision"):
        text, frame, imu_frame = getattr(given, unit), names.get(unit, ""), names.get("imu", "")
        if text == TF:
            known = transforms.between(frame, transforms.full_name(wire.SONDE_FRAME)) if frame else None
            if known is None:
                unusable[unit] = (
                    f"no static transform leads from {frame or 'its frame'!r} to {wire.SONDE_FRAME!r}: publish one on "
                    f"/tf_static, or set tool.mount.{unit} to a preset such as z-down"
                )
            found[unit] = found.get("imu", np.eye(3)) if known is None else known
        elif text != AS_IMU:
            found[unit] = rotation(text)
        elif not frame or not imu_frame or frame == imu_frame:
            found[unit] = found["imu"]
        else:
            known = transforms.between(frame, imu_frame)
            found[unit] = found["imu"] if known is None else found["imu"] @ known
            if known is None:
                apart = f"it is in {frame!r}, the IMU in {imu_frame!r}, and no static transform joins them: "
                if unit == "mag":
                    unusable[unit] = (
                        f"{apart}set tool.mount.mag (x-down if it shares the tool's axes), or publish the transform on "
                        "/tf_static"
                    )
                else:
                    assumed[unit] = f"{apart}set tool.mount.precision (x-down if it shares the tool's axes)"
    clean = {unit: _snapped(mat) for unit, mat in found.items()}
    return Mount(clean["imu"], clean["mag"], clean["precision"], unusable, given.accelerometer == "down", assumed)


def _snapped(mat: Array) -> Array:
    """Return `mat` without rounding errors if it only exchanges axes (elements 0, 1 or -1); else return `mat`."""
    whole = np.round(mat)
    # Adding zero turns -0 into 0.
    return whole + 0.0 if np.abs(mat - whole).max() < 1e-9 else mat


_SAME_AXES = np.eye(3)


def _turned(samples: Samples, mat: Array, fields: tuple[str, ...]) -> Samples:
    if (mat == _SAME_AXES).all():
        return samples
    out = samples.copy()
    for name in fields:
        out[name] = turned(mat, samples[name])
        covariance = f"{name}_covariance"
        if covariance in (samples.dtype.names or ()):
            square = samples[covariance].reshape(-1, 3, 3)
            reported = (square[:, :1, :1] != -1.0) & square.any(axis=(1, 2), keepdims=True)
            out[covariance] = np.where(reported, mat @ square @ mat.T, square).reshape(-1, 9)
    return out


def turned(mat: Array, vectors: Array) -> Array:
    """
    Return vectors, shape (n, 3), turned by a matrix.

    If the matrix only exchanges axes, the result is exact, and NaN or infinity stays in its own axis.
    """
    order = np.abs(mat).argmax(axis=1)
    signs = mat[np.arange(3), order]
    if np.array_equal(np.abs(mat), np.eye(3)[order]):
        return np.asarray(vectors[:, order] * signs)
    return np.asarray(vectors @ mat.T)


def words(mat: Array) -> str:
    """Return a rotation as text for users: the name of its preset, or its nine numbers."""
    for name, preset in PRESETS.items():
        if np.array_equal(mat, preset):
            return name
    return ", ".join(f"{value:.4g}" for value in mat.ravel())


def by_turning(turn: Array) -> Array:
    """
    Return the rotation from unit to tool axes, shape (3, 3), of a unit on a rotating string.

    turn, shape (3,), is the rotation vector of the string in axes of the unit, of any length except 0; it points
    down-hole (see `axis_down`). If this vector lies along an axis of the unit (`ALONG`), the result is the preset of
    this axis. Otherwise the result is the preset of the nearest axis, followed by the smallest rotation that makes the
    vector point down-hole: rotation of the string does not show where the scribe line is.
    """
    axis = np.asarray(turn, dtype=float) / np.linalg.norm(turn)
    k = int(np.abs(axis).argmax())
    preset = PRESETS[f"{'xyz'[k]}-{'down' if axis[k] > 0.0 else 'up'}"]
    if abs(axis[k]) > ALONG:
        return preset.copy()
    x, y, z = preset @ axis
    # Rodrigues' rotation that takes (x, y, z) to (1, 0, 0), about their cross product.
    cross = np.array([[0.0, y, z], [-y, 0.0, 0.0], [-z, 0.0, 0.0]])
    found: Array = (np.eye(3) + cross + cross @ cross / (1.0 + x)) @ preset
    return found


def axis_down(turn: Array, path: float) -> str:
    """
    Find the unit's axis that points down-hole from the rotation of the string; return its preset, such as "z-down".

    turn, shape (3,), is the sum of the unit's rotation vectors, rad; path is the sum of their lengths, rad. A drill
    string turns to the right (clockwise seen down-hole), so the rotation vector points down-hole. Returns an empty text
    if the rotation is not about one axis of the unit.
    """
    length = float(np.linalg.norm(turn))
    k = int(np.abs(turn).argmax())
    if length < 0.8 * path or abs(turn[k]) < 0.95 * length:
        return ""
    return f"{'xyz'[k]}-{'down' if turn[k] > 0.0 else 'up'}"
