# SPDX-License-Identifier: Apache-2.0
"""
Check units of measurement, axes and signs with a window of motion, in which gravity and field should be constant.

Wrong units, axes and signs come from the installation and are constant for a run. The gyros rotate gravity and field to
common axes. Units of measurement follow from the lengths of gravity and field, axes from the mappings that explain
both, signs and frames from the dip if the reference dip is known. The observations are recorded in the checks of
`fault_debounce`. A vector is called carried if the gyros rotate it to the axes at the start of the window; a case is
one of the 48 cases of exchanged and reversed axes (`axis_mappings`). A case explains a vector if the mean of the
vector, carried with the axes of the case, has the length that is expected: if axes are exchanged, reversed or turned,
carried vectors spread and their mean becomes shorter. If the motion cannot distinguish some cases (a tool at rest, or
rotating about one axis only), several of them explain the same data.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.axis_mappings import ACCEL, MAG, MAPPINGS, MISTAKES, ROTATIONS, WEIGHTS
from mwd_estimation.core.sensor_fault import ACCEL as ACCEL_BIT
from mwd_estimation.core.sensor_fault import GYRO as GYRO_BIT
from mwd_estimation.core.sensor_fault import MAG as MAG_BIT
from mwd_estimation.core.sensor_fault import FaultCode
from mwd_estimation.health.fault_debounce import AGAINST, FAULT, FOR, NOTHING, OK, STRONGLY, observe
from mwd_estimation.health.motion_window import (
    ABOUT_X,
    LEAST_FIELD,
    MOST_FIELD,
    ROUGHLY_X,
    TURNING,
    UPWARDS,
    ExpectedField,
)
from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.kalman import rotate_right
from mwd_sensors.core.mount import ALONG, axis_down


@compiled
def attitudes(turns: Array, scale: float) -> Array:
    """
    Return the attitude before each step relative to the first, as rotation matrices, shape (n, 3, 3).

    turns, shape (n, 3): rotation in each step; scale: factor from its unit to rad.
    """
    mats = np.zeros((len(turns), 3, 3))
    mat = np.eye(3)
    for i in range(len(turns)):
        mats[i] = mat
        rotate_right(mat, scale * turns[i, 0], scale * turns[i, 1], scale * turns[i, 2])
    return mats


class Window:
    """Carried vectors of a window in each of the 48 cases of exchanged and reversed axes (`axis_mappings`)."""

    def __init__(self, steps: Any, began_ns: int, seconds: float) -> None:
        turn = np.ascontiguousarray(steps["turn"])
        force, field, counts = steps["force"], steps["field"], steps["fields"]
        self.began_ns, self.seconds = began_ns, seconds  #: start and length of the window, ns and s
        #: Number of samples of force and field.
        self.forces, self.fields = int(steps["forces"].sum()), int(counts.sum())
        #: `force2`, `field2`: mean squared length of force and field.
        self.force2 = float(steps["force2"].sum() / max(self.forces, 1))
        self.field2 = float(steps["field2"].sum() / max(self.fields, 1))
        #: Total rotation angle according to the gyros, rad; sum of the rotations about each axis, rad, shape (3,).
        self.path, self.turn = float(np.sqrt((turn**2).sum(axis=1)).sum()), turn.sum(axis=0)
        starts = np.flatnonzero(np.diff(steps["part"], prepend=-1))
        part_forces = np.add.reduceat(steps["forces"], starts)
        by_part, in_all = [], []
        for sign in (1.0, -1.0):
            mats = attitudes(turn, sign)
            carried = np.add.reduceat(np.einsum("nab,nj->nabj", mats, force), starts)
            by_part.append(np.einsum("wbj,pabj->pwa", ROTATIONS, carried))
            in_all.append(np.einsum("wbj,abj->wa", ROTATIONS, np.einsum("nab,nj->abj", mats, field)))
        sums = np.concatenate(by_part, axis=1)
        #: Mean carried force of each half second in each case; shape (parts, 48, 3).
        self.part_force = sums / np.maximum(part_forces, 1)[:, None, None]
        self.whole_parts = bool((part_forces > 0).all())
        n, m = max(self.forces, 1), max(self.fields, 1)
        #: `force`, `field`: squared length of the mean carried force and field in each case, in the squared units of
        #: the sensors; shape (48,).
        self.force = ((sums.sum(axis=0) / n) ** 2).sum(axis=1)
        self.field = ((np.concatenate(in_all) / m) ** 2).sum(axis=1)
        as_deg = attitudes(turn, math.radians(1.0))
        #: `force_deg`, `field_deg`: squared length of the mean carried force and field if the gyros send deg/s.
        self.force_deg = float(((np.einsum("nab,nb->a", as_deg, force) / n) ** 2).sum())
        self.field_deg = float(((np.einsum("nab,nb->a", as_deg, field) / m) ** 2).sum())
        tool_means = np.add.reduceat(force, starts) / np.maximum(part_forces, 1)[:, None]
        #: Largest magnitude of the mean force of a half second along an axis of the tool, in the unit of the sensor.
        self.push = float(np.abs(tool_means).max())
        self.mean_force = force.sum(axis=0) / n  #: mean force in tool axes; shape (3,)
        #: `force_fixed`, `field_fixed`: squared length of the mean force and field in tool axes.
        self.force_fixed = float((self.mean_force**2).sum())
        self.field_fixed = float(((field.sum(axis=0) / m) ** 2).sum())
        both = (counts > 0) & (steps["forces"] > 0)
        product = np.einsum("ni,nj->ij", force[both], field[both] / counts[both, None])
        #: Mean of force component i times field component j; shape (3, 3).
        self.product = product / max(int(steps["forces"][both].sum()), 1)

    def noise(self, case: int) -> float:
        """
        Return 1 sigma of the mean carried force of a case along one axis, from the scatter of the half seconds.

        The result is infinite for fewer than two half seconds, or if one of them has no force.
        """
        parts = self.part_force[:, case]
        if len(parts) < 2 or not self.whole_parts:
            return math.inf
        return math.sqrt(float(parts.var(axis=0).sum()) / (3.0 * (len(parts) - 1)))


Flags = NDArray[np.bool_]

# State of a sensor's samples in a window: whole; some at the end of the range; missing or constant.
WHOLE, CLIPPED, BROKEN = 0, 1, 2
_MATRICES = np.array(MAPPINGS, dtype=float)
_SENSOR, _MAPPING, _BY_FORCE, _BY_FIELD = MISTAKES.T
_FEW_FORCES, _FEW_FIELDS = 40, 10  # smallest number of samples of force and field in a window
_WHOLE_S = 2.9  # length above which a window counts as whole, s
_PARTS_OF_ONE = 1e6  # scale with which components of a direction are stored as integers


class WindowLimits(NamedTuple):
    """Limits of the checks of motion; their effects are listed in docs/methods/sensor_health_ablation.md."""

    #: `fits`, `rejects`: relative difference of the length of the mean carried force from gravity. A case explains
    #: gravity if the difference is below `fits` plus 3 sigma; it is rejected if the difference is above `rejects` plus
    #: 6 sigma.
    fits: float = 0.06
    rejects: float = 0.12
    #: A case is better than another if its squared mean force is larger by this share of squared gravity plus 2.2
    #: sigma.
    margin: float = 0.05
    quiet: float = 0.08  #: largest 1 sigma of the mean force, as a share of gravity, at which axes are checked
    #: `field_held`, `field_better`: smallest ratio of the squared mean carried field to the mean squared field for the
    #: best case, and smallest difference of this ratio between the best case and the present axes.
    field_held: float = 0.93
    field_better: float = 0.1
    #: `dip`, `dip_frame`: difference of the dip from the reference, rad. Interference may cause less than `dip`; more
    #: than `dip_frame` comes from a wrong frame or sign.
    dip: float = 0.21
    dip_frame: float = 0.26
    strength: float = 0.1  #: largest relative difference of the field from the reference at which the dip is used
    fastest: float = 50.0  #: mean rate that no string exceeds, rad/s; a larger rate shows that the gyros send deg/s
    #: `no_gravity`, `variances`: the mean force is not gravity if it differs by more than this share of gravity and the
    #: log-likelihood for no gravity is larger by more than `variances`.
    no_gravity: float = 0.35
    variances: float = 6.0
    #: `field_lost`, `gravity_lost`: the gyros do not follow the rotation of the tool if, in the best case, the
    #: squared mean carried field is below this share of the mean squared field, and the mean carried force is below
    #: this share of gravity.
    field_lost: float = 0.85
    gravity_lost: float = 0.9
    #: A larger mean force along an axis in half a second, m/s^2, is probably aliased vibration, which does not last.
    pushed: float = 15.0


@dataclasses.dataclass
class MappingEvidence:
    """Evidence of one vector, gravity or field, for the cases of exchanged and reversed axes."""

    #: bool, shape (48,); the cases that explain the vector.
    fits: Flags = dataclasses.field(default_factory=lambda: np.zeros(48, dtype=np.bool_))
    #: `judged`, `bad`, `confirms`, `degrees`: whether the vector can be evaluated, rejects the present axes, confirms
    #: the present axes, and is explained by gyros that send deg/s.
    judged: bool = False
    bad: bool = False
    confirms: bool = False
    degrees: bool = False


class WindowJudge:
    """
    Evaluation of one window; its observations are stored in `checks`.

    Parameters
    ----------
    samples : ndarray of int64, shape (3,)
        State of each sensor's samples: WHOLE, CLIPPED or BROKEN.
    checks : ndarray
        Checks of `fault_debounce`.
    """

    def __init__(
        self, limits: WindowLimits, expected: ExpectedField, window: Window, samples: Indices, checks: Any
    ) -> None:
        self._limits, self._expected, self._window = limits, expected, window
        self._samples, self._checks = samples, checks
        self._force, self._field = MappingEvidence(), MappingEvidence()
        self._length, self._sigma = expected.gravity, 1.0
        self._accel_unit = -1
        self._field_size = math.sqrt(window.field2)
        self._gyro_usable = samples[0] == WHOLE and checks[FaultCode.DEAD, 0].state != FAULT
        self._noisy = bool(checks[FaultCode.NOISE, 3].votes_for > 0)

    def judge(self) -> None:
        """Evaluate the window, and record the observations."""
        self._judge_units()
        if self._gyro_usable:
            self._show_force()
            self._show_field()
        w, gravity = self._window, self._judge_gravity()
        if gravity >= FOR or self._noisy:
            self._force = MappingEvidence()
        if self._judge_gyro_unit():
            return
        axes = self._judge_axes()
        self._judge_adrift()
        if axes != FOR and self._judge_mount():
            return
        # Check signs only in a whole window: a surge changes the mean force, and so the dip, of part of a window.
        whole = w.seconds > _WHOLE_S
        usable = whole and self._samples[0] < BROKEN
        if usable and gravity < FOR and axes != FOR and self._checks[FaultCode.AXES, 0].state != FAULT:
            self._judge_signs()

    def _note(self, code: FaultCode, place: int, seen: int, value: float = 0.0, limit: float = 0.0) -> Any:
        check = self._checks[code, place]
        observe(check, seen, self._window.began_ns, value, limit)
        return check

    def _judge_units(self) -> None:
        w, gravity = self._window, self._expected.gravity
        if w.forces >= _FEW_FORCES // 4 and self._samples[1] < BROKEN:
            # Even if axes are wrong, at least one case gives nearly the right length of the mean carried force.
            carried = np.sqrt([*w.force, w.force_deg, w.force_fixed]) / gravity
            rms = math.sqrt(w.force2)
            if rms < 0.7 * gravity and bool((np.abs(STANDARD_GRAVITY * carried - 1.0) < 0.15).any()):
                self._accel_unit, self._length = 1, gravity / STANDARD_GRAVITY
            elif rms > 0.8 * gravity and bool((np.abs(carried - 1.0) < 0.15).any()):
                self._accel_unit = 0
            self._note_unit(3, self._accel_unit, rms, gravity)
            if self._accel_unit >= 0 and self._samples[1] == WHOLE and w.forces >= _FEW_FORCES:
                self._sigma = self._noise() / self._length
        if w.fields >= 3 and self._samples[2] < BROKEN:
            # The gate removes readings in other units of measurement; `signal_checks.judge_refused` names these units.
            known = LEAST_FIELD < self._field_size < MOST_FIELD
            self._note_unit(6, 0 if known else -1, self._field_size, MOST_FIELD)

    def _note_unit(self, place: int, unit: int, value: float, limit: float) -> None:
        """Record the unit of measurement of a sensor: 0 for SI, a larger number for another one, -1 if unknown."""
        seen = FOR if unit > 0 else (AGAINST if unit == 0 else NOTHING)
        self._note(FaultCode.UNIT, place, seen, value, limit).seen_which[0] = max(unit, 0)

    def _noise(self) -> float:
        """Return 1 sigma of the mean force along one axis, in the unit of the sensor."""
        w = self._window
        best = int(np.argmax(w.force))
        # Compared with white noise, vibration disturbs the mean less if the sensor integrates, and much more if the
        # vibration is aliased. So use the scatter of the half seconds if it is known.
        own = min(w.noise(0), w.noise(best))
        if not math.isfinite(own):
            own = math.sqrt(max(w.force2 - w.force[best], 0.0) / (3.0 * w.forces))
        return max(1.2 * own, 0.004 * math.sqrt(w.force[best]))

    def _show_force(self) -> None:
        """
        Find the cases in which the mean carried force is as long as gravity; store the result in `self._force`.

        With wrong axes, the forces that the gyros rotate to the start of the window spread, and their mean is too
        short.
        """
        p, sigma, shown = self._limits, self._sigma, self._force
        length2 = self._window.force / self._length**2
        if sigma >= p.quiet or math.sqrt(length2[0]) - 1.0 > p.rejects + 6.0 * sigma:
            return
        off = np.sqrt(np.maximum(length2 - 3.0 * sigma**2, 0.0)) - 1.0
        near = np.abs(off) < p.fits + 3.0 * sigma
        top = float(length2[near].max()) if near.any() else 0.0
        # The force along the axis of rotation is the same in two cases, and its noise cancels in their difference.
        margin = p.margin + 2.2 * sigma
        shown.fits = near & (length2 > top - margin)
        shown.judged = True
        shown.bad = bool(
            abs(off[0]) > p.rejects + 6.0 * sigma or (off[0] < -0.02 - 2.5 * sigma and top - length2[0] > margin)
        )
        differs = not (np.abs(off) < 0.1 + 3.0 * sigma).all()
        shown.confirms = bool(not shown.bad and abs(off[0]) < 0.1 + 3.0 * sigma and differs)
        as_degrees = math.sqrt(self._window.force_deg) / self._length - 1.0
        shown.degrees = abs(as_degrees) < p.fits + 3.0 * sigma

    def _show_field(self) -> None:
        """
        Find the axes with which the samples of the carried field scatter least; store the result in `self._field`.

        The samples are rotated by the gyros to the start of the window; with wrong axes they scatter.
        """
        p, w, shown = self._limits, self._window, self._field
        if self._samples[2] != WHOLE or w.fields < _FEW_FIELDS or w.field2 <= 0.0:
            return
        held = w.field / w.field2
        best, own, as_degrees = float(held.max()), float(held[0]), w.field_deg / w.field2
        shown.fits = held > best - 0.04
        shown.judged = best > p.field_held
        worse = best - own > p.field_better and w.field_fixed / w.field2 < 0.9
        shown.bad = bool((shown.judged and worse) or (own < 0.8 and best < 0.85 and as_degrees < 0.9))
        shown.confirms = bool(shown.judged and best - own < 0.04 and held.min() < best - 0.1)
        shown.degrees = as_degrees > 0.95

    def _judge_gravity(self) -> int:
        """
        Check whether the mean force cannot be gravity; return the observation of the check GRAVITY.

        No other force acts on a tool in one direction for seconds.
        """
        w, gravity = self._window, self._expected.gravity
        enough = w.seconds >= 1.5 and w.forces >= _FEW_FORCES
        if not (enough and self._gyro_usable and self._samples[1] < BROKEN and self._accel_unit <= 0) or self._noisy:
            return NOTHING
        if self._force.fits.any():
            self._note(FaultCode.GRAVITY, 3, AGAINST)
            return AGAINST
        # While the axes are not known to be right, use the longest and the shortest mean force of all cases.
        known = self._checks[FaultCode.AXES, 0].state == OK
        most, least = (w.force[0], w.force[0]) if known else (w.force.max(), w.force.min())
        seen = self._no_gravity(math.sqrt(most), math.sqrt(least))
        self._note(FaultCode.GRAVITY, 3, seen, math.sqrt(most), gravity)
        return seen

    def _no_gravity(self, mean: float, least: float) -> int:
        p, w, gravity = self._limits, self._window, self._expected.gravity
        steady = float(w.field.max()) > 0.9 * w.field2 or w.field2 == 0.0
        by_field = self._field.judged and not self._field.bad and w.field[0] > 0.9 * w.field2
        if not (w.path < 1.0 and steady) and not by_field:
            return NOTHING
        variance = max(w.force2 - mean**2, 0.0) / (3.0 * w.forces)
        pushed = w.push > p.pushed
        # A mean force that is too short: compare the likelihood of no gravity with the likelihood of gravity. A large
        # force in half a second may be aliased vibration.
        missing = not pushed and gravity * (gravity - 2.0 * mean) > 2.0 * p.variances * variance
        off = max(gravity - mean, math.sqrt(max(least**2 - 3.0 * variance, 0.0)) - gravity)
        if missing or (off > p.no_gravity * gravity and off * off > 4.0 * p.variances * variance):
            return FOR if pushed else STRONGLY
        found = off < 0.2 * gravity + 2.0 * math.sqrt(variance) and variance < (0.15 * gravity) ** 2
        return AGAINST if found else NOTHING

    def _judge_gyro_unit(self) -> bool:
        """
        Check whether the gyros send deg/s; return True if they do.

        This is so if the rates are higher than any string reaches, or if gravity and field fit only rates that are 57
        times lower.
        """
        w, p = self._window, self._limits
        too_fast = w.path > p.fastest * w.seconds
        if self._samples[0] != WHOLE and not too_fast:
            return False
        explained = bool(self._force.fits.any()) or self._field.judged
        slower = w.path > 1.0 and (self._force.degrees or self._field.degrees) and not explained
        seen = NOTHING
        if slower or (too_fast and w.path < p.fastest * w.seconds * math.degrees(1.0)):
            seen = FOR
        elif (self._force.confirms or self._field.confirms) and w.path > 0.5:
            seen = AGAINST
        check = self._note(FaultCode.UNIT, 0, seen, w.path / w.seconds, p.fastest)
        check.seen_which[0] = 1
        return bool(seen == FOR or check.state == FAULT)

    def _right_strength(self) -> bool:
        total = self._expected.total
        return math.isfinite(self._expected.dip) and abs(self._field_size / total - 1.0) < self._limits.strength

    def _explaining(self) -> Flags:
        """Return a mask of the MISTAKES that explain the motion of gravity and field, shape (141,)."""
        by_force: Flags = self._force.fits[_BY_FORCE] | (not self._force.judged)
        by_field: Flags = self._field.fits[_BY_FIELD] | (not self._field.judged)
        return by_force & by_field

    def _dips(self) -> tuple[Array, float]:
        """
        Return the dip, rad, with each of MISTAKES corrected, shape (141,), and the dip with the present axes.

        A dip is NaN if the mean product of force and field is impossible for their lengths.
        """
        product = self._window.product
        of_force = np.einsum("krc,rc->k", _MATRICES, product)
        of_field = np.einsum("krc,cr->k", _MATRICES, product)
        total = np.where(_SENSOR == MAG, of_field[_MAPPING], of_force[np.where(_SENSOR == ACCEL, _MAPPING, 0)])
        sine = -np.append(total, of_force[0]) / (self._length * max(self._field_size, 1e-150))
        dips = np.where(np.abs(sine) < 1.1, np.arcsin(np.clip(sine, -1.0, 1.0)), math.nan)
        return dips[:-1], float(dips[-1])

    def _least_contrived(self, check: Any, explaining: Flags) -> list[int]:
        """
        Return the simplest mistakes that explain this window and all earlier windows, one bit mask for each sensor.

        The first window with an observation for the fault may contain the beginning of the fault, so it does not
        exclude mistakes for later windows. If no mistake explains all windows, only the latest window counts.
        """
        before = (check.possible[_SENSOR] >> _MAPPING & 1).astype(np.bool_)
        if check.votes_for and bool((explaining & before).any()):
            explaining = explaining & before
        if self._window.seconds > _WHOLE_S:
            check.possible = _bits(explaining) if check.votes_for else -1
        return _bits(explaining & (WEIGHTS[explaining].min() == WEIGHTS))

    def _judge_axes(self) -> int:
        """
        Record the simplest mistakes that explain the motion, and also the dip if the reference dip is known.

        Returns the observation of the check AXES.
        """
        masks, seen, check = [0, 0, 0], NOTHING, self._checks[FaultCode.AXES, 0]
        if self._force.bad or (self._field.bad and self._field.judged):
            explaining = self._explaining()
            if self._right_strength() and self._window.fields:
                with_dip = explaining & (np.abs(self._dips()[0] - self._expected.dip) < self._limits.dip)
                explaining = with_dip if with_dip.any() else explaining
            if explaining.any():
                masks, seen = self._least_contrived(check, explaining), FOR
        elif self._force.confirms or self._field.confirms:
            seen = AGAINST
        noted = self._note(FaultCode.AXES, 0, seen)
        noted.seen_which = masks
        # A motion that confirms the axes of two sensors does not confirm the axes of the third sensor.
        by_force = GYRO_BIT | ACCEL_BIT if self._force.confirms else 0
        noted.seen_sound = by_force | (GYRO_BIT | MAG_BIT if self._field.confirms else 0)
        return seen

    def _judge_adrift(self) -> None:
        """
        Check whether gravity and the magnetic field confirm the rotation that the gyros measure.

        The gyros are wrong if their rotation fits neither gravity nor the field under any mapping of the axes, while
        the measured dip is right.
        """
        w, p = self._window, self._limits
        if self._samples[0] != WHOLE or self._samples[2] != WHOLE or min(w.fields, w.forces) < _FEW_FIELDS:
            return
        seen = AGAINST if w.field[0] > p.field_held * w.field2 else NOTHING
        field_lost = max(float(w.field.max()), w.field_deg) < p.field_lost * w.field2
        gravity = math.sqrt(max(float(w.force.max()), w.force_deg)) / self._length
        if field_lost and gravity < p.gravity_lost and self._accel_unit != 1 and not self._noisy:
            off = abs(self._dips()[1] - self._expected.dip) if self._right_strength() else math.inf
            seen = FOR if off < p.dip else NOTHING
        self._note(FaultCode.ADRIFT, 0, seen, gravity, p.gravity_lost)

    def _judge_mount(self) -> bool:
        """
        Check whether the mount in the settings is wrong; return True for an observation of a wrong mount.

        The mount is wrong if the string turns about another axis of the unit than x, or if it turns backwards while the
        hole would point up.
        """
        w = self._window
        # If the axes of accelerometer and magnetometer do not match, the mount cannot be determined.
        together = self._force.confirms or self._field.confirms
        if not together or self._checks[FaultCode.AXES, 0].state == FAULT or self._samples[0] != WHOLE:
            return False
        net = float(np.linalg.norm(w.turn))
        if net < max(TURNING * w.seconds, 0.9 * w.path):
            return False
        about_x, down = float(w.turn[0]) / net, axis_down(w.turn, w.path)
        # A string that turns to the left while the hole would point up shows a unit that is mounted upside down.
        upwards = float(w.mean_force[0]) > UPWARDS * self._length
        least = ALONG if w.seconds > _WHOLE_S else ROUGHLY_X
        seen = AGAINST if abs(about_x) > ABOUT_X else NOTHING
        seen = FOR if abs(about_x) < least or (down == "x-up" and upwards) else seen
        check = self._note(FaultCode.MOUNT, 0, seen, about_x, least)
        check.seen_which = np.round(w.turn / net * _PARTS_OF_ONE).astype(np.int64)
        return seen == FOR

    def _judge_signs(self) -> None:
        """Check signs and frames by the dip if the reference is known, else by the inclination of a rotating string."""
        w, p, expected = self._window, self._limits, self._expected.dip
        up = float(w.mean_force[0]) / self._length
        inclination = math.acos(min(max(-up, -1.0), 1.0))
        known = self._right_strength() and self._samples[2] == WHOLE and w.fields >= 3
        if not known or abs(expected) <= 0.35:
            if abs(w.turn[0]) > TURNING * w.seconds:
                seen = FOR if inclination > 2.1 else (AGAINST if inclination < 1.75 else NOTHING)
                self._note(FaultCode.POINTS_UP, 3, seen, inclination, 1.75)
            return
        dips, dip = self._dips()
        off, sure = abs(dip - expected), 5.0 * self._sigma
        flipped = abs(dip + expected) < p.dip and off > p.dip_frame + sure
        seen = FOR if flipped else (AGAINST if off < p.dip_frame else NOTHING)
        if seen == AGAINST:
            # End a POINTS_UP fault that was found before the reference was known.
            self._note(FaultCode.POINTS_UP, 3, AGAINST)
        who = 2 if inclination > 1.75 else (4 if inclination < 1.4 else 6)
        self._note(FaultCode.SIGN, 3, seen, dip, expected).seen_which[0] = who
        wrong = off > p.dip_frame + sure and not flipped
        seen = FOR if wrong else (AGAINST if off < 0.2 else NOTHING)
        check = self._note(FaultCode.FRAME, 3, seen, dip, expected)
        if not check.votes_for:
            check.possible = -1
        if seen == FOR:
            explaining = self._frames(dips, up)
            if explaining.any():
                check.seen_which = self._least_contrived(check, explaining)
            elif check.votes_for:
                check.seen_which = check.which

    def _frames(self, dips: Array, up: float) -> Flags:
        """
        Return a mask of the simple MISTAKES, shape (141,), that explain motion, dip and a hole that points down.

        dips: dip with each mistake corrected, rad, shape (141,); up: axial force as a share of gravity.
        """
        matrices = _MATRICES[_MAPPING]
        rise = np.where(_SENSOR == ACCEL, matrices[:, :, 0] @ self._window.mean_force / self._length, up)
        near = np.abs(dips - self._expected.dip) < 0.1
        found: Flags = self._explaining() & near & (rise < 0.34) & (_SENSOR > 0) & (WEIGHTS <= 3)
        return found


def _bits(mistakes: Flags) -> list[int]:
    """
    Return the mappings of the marked mistakes, one bit mask for gyro, accelerometer and magnetometer.

    mistakes: mask of MISTAKES, shape (141,).
    """
    masks = [0, 0, 0]
    for m in np.flatnonzero(mistakes):
        masks[int(_SENSOR[m])] |= 1 << int(_MAPPING[m])
    return masks
