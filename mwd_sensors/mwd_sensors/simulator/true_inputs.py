# SPDX-License-Identifier: Apache-2.0
"""True motion of the sonde and true inputs of its sensors over an interval, without sensor errors."""

from __future__ import annotations

import dataclasses

import numpy as np

from mwd_sensors.core.arrays import Array


@dataclasses.dataclass(frozen=True)
class TrueInputs:
    """
    True motion and sensor inputs of n kinematic samples.

    Attributes
    ----------
    mat_nt, rate_t, position_n, velocity_n, md : ndarray
        Fields as in `Kinematics`.
    rate_it : ndarray, shape (n, 3)
        Rotation relative to inertial space, rad/s.
    f_t : list of ndarray, shape (n, 3)
        Specific force at each unit, m/s^2.
    drive : ndarray, shape (n, 2)
        Speed, rad/s, and torque, N m, of a top drive that obeys commands; shape (n, 0) without such a top drive.
    """

    mat_nt: Array
    rate_t: Array
    rate_it: Array
    position_n: Array
    velocity_n: Array
    md: Array
    f_t: list[Array]
    drive: Array

    def tail(self, count: int) -> TrueInputs:
        """Return the last samples."""
        return TrueInputs(
            self.mat_nt[-count:],
            self.rate_t[-count:],
            self.rate_it[-count:],
            self.position_n[-count:],
            self.velocity_n[-count:],
            self.md[-count:],
            [f[-count:] for f in self.f_t],
            self.drive[-count:],
        )

    def joined(self, new: TrueInputs) -> TrueInputs:
        """Return these samples followed by new ones."""
        return TrueInputs(
            np.concatenate([self.mat_nt, new.mat_nt]),
            np.concatenate([self.rate_t, new.rate_t]),
            np.concatenate([self.rate_it, new.rate_it]),
            np.concatenate([self.position_n, new.position_n]),
            np.concatenate([self.velocity_n, new.velocity_n]),
            np.concatenate([self.md, new.md]),
            [np.concatenate(pair) for pair in zip(self.f_t, new.f_t, strict=True)],
            np.concatenate([self.drive, new.drive]),
        )
