# SPDX-License-Identifier: Apache-2.0
"""Physical constants that the packages share, each defined once with its source."""

from __future__ import annotations

import math

# Standard acceleration of gravity, m/s^2 (CGPM 1901).
STANDARD_GRAVITY = 9.80665
# Largest difference of gravity on land or at sea from standard gravity, m/s^2: WGS 84 normal gravity is 9.7803 at the
# equator and 9.8322 at the pole, less 0.003 for each km of height. A reading with a larger difference is wrong at any
# well.
GRAVITY_FARTHEST = 0.04
# 1 sigma of gravity when the place is not known, m/s^2: half the range of normal gravity over the latitudes, plus
# heights of one or two km.
GRAVITY_SPREAD = 0.03
# Ice point, K: 0 degC (SI Brochure, 9th edition, 2.3.1).
CELSIUS_ZERO = 273.15
# Rotation rate of the Earth, rad/s (WGS 84, NGA.STND.0036, table 3.1).
EARTH_RATE = 7.292115e-5
# One micro-g, m/s^2.
MICRO_G = 1e-6 * STANDARD_GRAVITY
# One degree per hour, rad/s: the unit of gyro bias.
DEG_PER_HOUR = math.radians(1.0) / 3600.0
# One degree per square root of an hour, rad/s/sqrt(Hz): the unit of gyro white noise.
DEG_PER_ROOT_HOUR = math.radians(1.0) / 60.0
