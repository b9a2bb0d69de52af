"""Samples as they stream to the page, with the figures a test gives them."""

from mwd_sensors.core import wire


def attitude(inclination=0.8, azimuth=1.0, toolface=0.5, sigma=0.01, status=0, north=3, n=1, **more):
    samples = wire.ATTITUDE.empty(n)
    samples["stamp_ns"] = 5
    samples["inclination"], samples["azimuth"], samples["gravity_toolface"] = inclination, azimuth, toolface
    for name in ("inclination", "azimuth", "gravity_toolface", "magnetic_toolface"):
        samples["sigma_" + name] = sigma
    samples["status"], samples["north"] = status, north
    for name, value in more.items():
        samples[name] = value
    return samples


def rig(valid=2047, **values):
    samples = wire.RIG_STATE.empty(1)
    samples["valid"] = valid
    for name, value in values.items():
        samples[name] = value
    return samples
