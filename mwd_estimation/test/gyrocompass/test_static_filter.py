# SPDX-License-Identifier: Apache-2.0
"""S1's compiled filter: its Jacobian, and the order of its error state."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from mwd_estimation.gyrocompass import static_ekf, static_filter
from mwd_estimation.gyrocompass.static_filter import Error
from mwd_sensors.core.frames import mat_nt

ADDED = {
    "position": Error.POSITION,
    "velocity": Error.VELOCITY,
    "gyro_bias": Error.GYRO_BIAS,
    "accel_bias": Error.ACCEL_BIAS,
}


def test_transition_is_the_derivative_of_the_mechanisation() -> None:
    rng = np.random.default_rng(3)
    params, dt = static_ekf.Params(), 0.01
    p = static_ekf.kernel_params(params)
    # Times 1000, the Earth rate is large enough to be seen in a difference quotient.
    p = p._replace(north=1e3 * p.north, down=1e3 * p.down)
    state = static_ekf.initial(params)
    state.position[:], state.velocity[:] = rng.standard_normal((2, 3)) * 0.1
    state.mat[:] = mat_nt(1.0, 2.0, 0.5)
    state.gyro_bias[:], state.accel_bias[:] = rng.standard_normal((2, 3)) * 1e-3
    rate, force = rng.standard_normal(3) * 0.02, np.array([-3.0, 4.0, 8.0])

    def moved(error: np.ndarray):
        s = state.copy()
        for name, at in ADDED.items():
            getattr(s, name)[:] += error[at : at + 3]
        s.mat[:] = Rotation.from_rotvec(error[Error.ATTITUDE : Error.ATTITUDE + 3]).as_matrix() @ s.mat
        static_filter.propagate(p, s, dt, rate, force)
        return s

    phi = np.zeros((9, Error.SIZE))
    static_filter.transition(p, state.mat, dt, *(force - state.accel_bias), phi)
    base, step, numeric = moved(np.zeros(Error.SIZE)), 1e-5, np.zeros((9, Error.SIZE))
    for j in range(Error.SIZE):
        plus, minus = moved(step * np.eye(Error.SIZE)[j]), moved(-step * np.eye(Error.SIZE)[j])
        numeric[:3, j] = (plus.position - minus.position) / (2.0 * step)
        numeric[3:6, j] = (plus.velocity - minus.velocity) / (2.0 * step)
        turned = [Rotation.from_matrix(s.mat @ base.mat.T).as_rotvec() for s in (plus, minus)]
        numeric[6:, j] = (turned[0] - turned[1]) / (2.0 * step)
    # I + F T leaves out terms of second order in T: (rate T) T, 1e-5 here.
    np.testing.assert_allclose(phi, numeric, atol=2e-5)
