# SPDX-License-Identifier: Apache-2.0
"""Mount of a magnetometer in the tool, found from the angle between gravity and the reference field in a recording."""

from __future__ import annotations

import math

import numpy as np

from mwd_estimation.core.axis_mappings import MAPPINGS
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.settings import derivation
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import mount as mounts
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.processing.bag_input import InputSettings, Topics, mount_of
from mwd_surface.processing.input_stream import InputStream

# Every how many magnetic samples one is used; allowed differences of gravity (sine) and of the dip (rad).
_EVERY, _STEADY, _DIP = 7, 0.01, 0.05


def reference_of(estimator: EstimatorSettings, first_ns: int) -> Reference | None:
    """Return the field of the place if it is known for the date; a date outside the model is reported as missing."""
    try:
        return derivation.reference(estimator, first_ns)
    except ValueError:
        return None


def mag_mounts(bag: Bag, topics: Topics, given: InputSettings, estimator: EstimatorSettings) -> list[str]:
    """
    Return the mounts of the magnetometer, of the 24 along the tool's axes, that fit gravity and the reference field.

    The angle between gravity and field is the complement of the dip in every attitude: with a wrong mount it varies as
    the tool turns, or gives another dip. Empty without a reference field.
    """
    mount = mount_of(bag, topics, estimator.tool.mount)
    up, field, first_ns = [], [], 0
    for block in InputStream(bag, topics, given).blocks():
        samples = {name: part[1] for name, part in block.items()}
        if topics.imu not in samples or topics.mag not in samples:
            continue
        imu, mag = mount.imu_in_tool(samples[topics.imu]), samples[topics.mag][::_EVERY]
        first_ns = first_ns or int(imu["stamp_ns"][0])
        at = np.searchsorted(imu["stamp_ns"], mag["stamp_ns"]).clip(max=len(imu) - 1)
        up.append(imu["linear_acceleration"][at])
        field.append(mag["magnetic_field"])
    reference = reference_of(estimator, first_ns)
    if not up or reference is None or reference.dip is None:
        return []
    f, b = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (np.concatenate(up), np.concatenate(field)))
    rotations = [np.array(m, dtype=float) for m in MAPPINGS if np.linalg.det(np.array(m, dtype=float)) > 0.0]
    sines = [-np.einsum("ni,ij,nj->n", f, mat, b) for mat in rotations]
    spread = [float(np.nanstd(sine)) for sine in sines]
    dips = [math.asin(min(max(float(np.nanmean(sine)), -1.0), 1.0)) for sine in sines]
    return [
        mounts.words(mat)
        for mat, wide, dip in zip(rotations, spread, dips, strict=True)
        if wide < 1.5 * min(spread) + _STEADY and abs(dip - reference.dip) < _DIP
    ]
