"""
What turns the hole axis, summed over bins of time from the rates of two units, and the samples it is paired with.

    azimuth' = (w - w_ie) . (d - (d.x) x) / sin^2 I        d: unit vector down in tool axes, from any gravity method

The x rate drops out, but for what leaks of it into the cross-axis gyros: in step with a turn whose speed wobbles once a
turn that does not average out (2 % of 120 r/min and .2 mrad are 10 deg/h at 30 deg inclination). A bin's sums hold all
that a filter needs to carry an azimuth and its covariance through it, and to find that leakage.
"""

from __future__ import annotations

from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled

# Sums of a bin: its index; turn of the axis as the gyros say; integrals of d_y / across^2, d_z / across^2, time,
# d_x / across, 1 / across^2 and of the squared rate that a tilted vertical mistakes; seconds of gaps; carried turn at
# its end; whether the hole was vertical in it; integrals of w_x d_y / across^2, w_x d_z / across^2, w_x, w_y, w_z,
# and of w_x (w_y d_z - w_z d_y) / across^2: what a second of lag behind gravity mistakes.
S_BIN, S_TURN, S_Y, S_Z, S_TIME, S_EARTH, S_NOISE, S_TILT, S_GAP, S_CARRIED, S_VERTICAL = range(11)
S_XY, S_XZ, S_SPIN, S_RATE_Y, S_RATE_Z, S_LAG, SUMS = 11, 12, 13, 14, 15, 16, 17
BINS = 4  # bins whose sums are kept: the open one, those that wait, and one to spare
RING = 8192  # samples kept for pairing with other streams: 1.5 s at 5 kHz; a power of two
# What the ring keeps of a sample: unit vector down, carried turn, x rate.
R_DOWN, R_CARRIED, R_SPIN, RING_ROW = 0, 3, 4, 5
# Clock: last stamp, head and length of the ring, bins opened.
LAST_NS, HEAD, LENGTH, OPENED, CLOCK = range(5)


@compiled
def place_in_ring(ring_ns: Stamps, head: int, length: int, at: int) -> int:
    """How far back from the newest the first sample at or after a time lies, 1 the newest; 0 where none is."""
    low, high = 0, length
    while low < high:
        middle = (low + high + 1) // 2
        if ring_ns[(head - middle) % RING] >= at:
            low = middle
        else:
            high = middle - 1
    return low


@compiled
def carried_at(ring_ns: Stamps, ring: Array, head: int, length: int, at: int) -> float:
    """Carried turn of the axis at a time, rad; the ends hold."""
    back = place_in_ring(ring_ns, head, length, at)
    if back == 0:
        return float(ring[(head - 1) % RING, R_CARRIED])
    later = (head - back) % RING
    if back == length:
        return float(ring[later, R_CARRIED])
    earlier = (head - back - 1) % RING
    share = (at - ring_ns[earlier]) / (ring_ns[later] - ring_ns[earlier])
    return float((1.0 - share) * ring[earlier, R_CARRIED] + share * ring[later, R_CARRIED])


@compiled
def precision_sums(
    limit: float, vertical: float, sums: Array, fine: Array, bin_ns: int, ring_ns: Stamps, ring: Array, clock: Stamps,
    stamps: Stamps, rates: Array, start: int,
) -> tuple[bool, int]:  # fmt: skip
    """
    The same sums by the precision unit, with gravity and x rate of the sample at or after each; whether of any use.

    A rate is the mean over the interval that ends at its stamp. Returns also the first sample of a later bin.
    """
    begin = int(sums[S_BIN]) * bin_ns
    while start < len(stamps) and stamps[start] < begin:
        start += 1
    for j in range(SUMS):
        fine[j] = sums[j]
    fine[S_TURN] = fine[S_Y] = fine[S_Z] = fine[S_NOISE] = 0.0
    for j in range(S_XY, SUMS):
        fine[j] = 0.0
    usable, covered = True, 0.0
    head, length = clock[HEAD], clock[LENGTH]
    last, back = begin, 0
    while start < len(stamps) and stamps[start] < begin + bin_ns:
        stamp, wy, wz = stamps[start], rates[start, 1], rates[start, 2]
        start += 1
        dt = (stamp - last) * 1e-9
        if dt <= 0.0:
            continue
        last = stamp
        if not (abs(wy) < limit and abs(wz) < limit):
            usable = False
            continue
        if back == 0:
            back = place_in_ring(ring_ns, head, length, stamp)
        while back > 1 and ring_ns[(head - back) % RING] < stamp:
            back -= 1
        if back == 0:
            usable = False
            break
        at = (head - back) % RING
        dy, dz, wx = ring[at, R_DOWN + 1], ring[at, R_DOWN + 2], ring[at, R_SPIN]
        across2 = dy * dy + dz * dz
        if across2 < vertical or dt > 0.5e-9 * bin_ns:
            usable = False
            continue
        share = dt / across2
        fine[S_TURN] += (wy * dy + wz * dz) * share
        fine[S_Y] += dy * share
        fine[S_Z] += dz * share
        fine[S_NOISE] += share
        fine[S_XY] += wx * dy * share
        fine[S_XZ] += wx * dz * share
        fine[S_SPIN] += wx * dt
        fine[S_RATE_Y] += wy * dt
        fine[S_RATE_Z] += wz * dt
        fine[S_LAG] += wx * (wy * dz - wz * dy) * share
        covered += dt
    # Where it covers the bin but for a sample or two, the little that is missing is taken in proportion.
    usable = usable and covered > 0.8 * sums[S_TIME] and sums[S_TIME] > 0.0
    if usable:
        whole = sums[S_TIME] / covered
        for j in (S_TURN, S_Y, S_Z, S_NOISE):
            fine[j] *= whole
        for j in range(S_XY, SUMS):
            fine[j] *= whole
    return usable, start
