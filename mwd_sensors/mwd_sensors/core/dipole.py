# SPDX-License-Identifier: Apache-2.0
"""
Alternating field of a small coil (a magnetic dipole) in uniform, conducting ground.

Source: J. R. Wait, Electromagnetic Waves in Stratified Media, 2nd ed., 1970 (dipole in a conducting medium,
displacement currents neglected). Without conductivity the field is that of a static dipole.
"""

from __future__ import annotations

import cmath
import math

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

_T_M3_PER_A_M2 = scipy.constants.mu_0 / (4.0 * math.pi)


def wave_number(frequency_hz: float, resistivity: float) -> complex:
    """Return the propagation constant of ground, 1/m; resistivity in ohm m, infinite for air."""
    return cmath.sqrt(2j * math.pi * frequency_hz * scipy.constants.mu_0 / resistivity)


def dipole_field(offset: ArrayLike, moment: ArrayLike, wave: complex = 0.0) -> NDArray[np.complex128]:
    """
    Return the complex amplitude of the alternating magnetic field of a dipole.

    Parameters
    ----------
    offset : array_like, shape (..., 3)
        Vector from the dipole to the point at which the field is computed, m; not zero.
    moment : array_like, shape (..., 3)
        Moment of the dipole (current times turns times area), A m^2, in the same axes.
    wave : complex
        Propagation constant of the ground, 1/m, as from `wave_number`; 0 for no loss.

    Returns
    -------
    ndarray, shape (..., 3)
        Complex amplitude of the field, T; its phase is relative to the phase of the current. Real in ground without
        loss.
    """
    r, m = np.asarray(offset, dtype=float), np.asarray(moment, dtype=float)
    distance = np.linalg.norm(r, axis=-1, keepdims=True)
    unit = r / distance
    x = wave * distance
    along = unit * np.sum(unit * m, axis=-1, keepdims=True)
    near = (3.0 + 3.0 * x + x * x) * along - (1.0 + x + x * x) * m
    return np.asarray(_T_M3_PER_A_M2 / distance**3 * np.exp(-x) * near, dtype=complex)
