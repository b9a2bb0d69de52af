# SPDX-License-Identifier: Apache-2.0
"""Method pages have the same parts in the same order, and the figures of their worked examples are computed."""

import dataclasses
import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from mwd_estimation.assembly.assembly import read_assembly
from mwd_estimation.assembly.sag import sag
from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.downhole.log_sampler import rate
from mwd_estimation.gravity.bounded import filter as bounded
from mwd_estimation.gravity.bounded.params import BoundedParams
from mwd_estimation.gravity.bounded.state import initial
from mwd_estimation.gravity.fuzzy_mahony import MahonyParams, fuzzy_step
from mwd_estimation.magnetic.axial_correction import axial_correction
from mwd_estimation.pipeline.external_field import with_external
from mwd_estimation.survey.posterior import hypotheses
from mwd_estimation.survey.station import StationSettings, station
from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core.dipole import dipole_field
from mwd_sensors.core.frames import mat_nt
from mwd_sensors.simulator.mud_channel import WellGeometry, responses
from mwd_sensors.telemetry.downlink import Downlink, DownlinkFrame, levels, programme
from mwd_sensors.telemetry.pulse_position import encode, packets
from mwd_surface.receiver import sonde_locate, surface_readings
from mwd_surface.receiver.pulse.transmission import Presence, PulseEvidence
from mwd_surface.surveys.check_shots import check_shots
from mwd_surface.surveys.multi_station_analysis import analyse
from mwd_surface.uncertainty.collar_spacing import azimuth_error

PAGES = Path(__file__).parents[1] / "docs" / "methods"
PARTS = ["The idea", "A worked example", "Mathematics", "Parameters", "Limits"]
GENERATED = {"index", "sensor_health_ablation"}
NAMES = sorted(page.stem for page in PAGES.glob("*.md") if page.stem not in GENERATED)

# The place of all examples: 50 000 nT with a dip of 70 deg, so that H is 17 101 nT, and 2 deg of declination.
REFERENCE = Reference(50e-6, math.radians(70.0), math.radians(2.0), 0.0, 9.81, "example")
EARTH_RATE = 7.292115e-5


def sections(name: str) -> dict[str, str]:
    parts = re.split(r"(?m)^## (.*)$", (PAGES / f"{name}.md").read_text())
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def readings(inclination, azimuth, toolface, axial=0.0, east=0.0, noise=None):
    """Specific force and field of a tool at rest, azimuth from magnetic north; angles in deg, fields in T."""
    mat_tn = mat_nt(*np.radians([inclination, azimuth, toolface])).T
    force = mat_tn @ [0.0, 0.0, -9.81]
    field = mat_tn @ [REFERENCE.horizontal, east, REFERENCE.vertical] + np.array([axial, 0.0, 0.0])
    if noise is not None:
        force, field = force + 0.002 * noise.normal(size=3), field + 20e-9 * noise.normal(size=3)
    return force, field


def probable(found, cause):
    return f"{100.0 * dict(found.hypotheses)[cause]:.0f} %"


def survey_station() -> Iterator[str]:
    force, field = readings(40.0, 100.0, 30.0)
    yield from (f"{value:.3f}" for value in force)
    yield from (f"{value * 1e9:.0f}" for value in field)
    found = station(force, field, REFERENCE)
    assert found.verdict == "accept"
    yield f"{math.degrees(found.sigma_inclination):.2f} deg"
    yield f"{math.degrees(found.azimuth):.1f} deg"
    yield f"{math.degrees(found.sigma_azimuth):.1f} deg"


def azimuth_posterior() -> Iterator[str]:
    for axial, east, verdict, cause in (
        (0.0, 0.0, "accept", "clean"),
        (2e-6, 0.0, "doubtful", "axial"),
        (0.0, 3e-6, "accept", "clean"),
    ):
        found = station(*readings(40.0, 100.0, 30.0, axial, east), REFERENCE)
        assert found.verdict == verdict
        raw = math.degrees(found.by_method("raw").azimuth)
        yield f"| {raw:.1f} | {math.degrees(found.azimuth):.1f} | {math.degrees(found.sigma_azimuth):.1f} | {verdict} |"
        yield probable(found, cause)


def logs() -> Iterator[str]:
    (value, sigma, _), (_, of_two, _) = (rate(n * 482.0, n * 10.0, 10e-6) for n in (1, 2))
    yield f"{value:.2f} pulses per second"
    yield f"{1.5 * value:.1f} gAPI"
    yield f"sigma from the scatter of the counts is {1.5 * sigma:.1f} gAPI"
    yield f"its sigma is {1.5 * of_two:.1f} gAPI"


def magnetic_interference() -> Iterator[str]:
    force, field = readings(40.0, 100.0, 30.0, axial=2e-6)
    errors = SensorErrors()
    covariance = np.diag([errors.accelerometer_bias_mps2**2] * 3 + [(errors.magnetometer_bias_nt * 1e-9) ** 2] * 3)
    off = azimuth_error(2e-6, math.radians(40.0), math.radians(100.0), REFERENCE.horizontal)
    found = axial_correction(
        force, field, REFERENCE.horizontal, REFERENCE.vertical, covariance, np.diag([1e-7**2, 1.5e-7**2]), 5e-6
    )
    yield f"{100.0 + math.degrees(off):.1f} deg"
    yield f"{-math.degrees(off):.1f} deg"
    yield f"{math.degrees(found.azimuth):.1f} deg with a sigma of {math.degrees(found.sigma_azimuth):.1f} deg"
    yield f"{1e9 * float(found.interference):.0f} nT with a sigma of {1e9 * float(found.sigma_interference):.0f} nT"


def multi_station_analysis() -> Iterator[str]:
    noise = np.random.default_rng(1)
    azimuths = np.linspace(60.0, 90.0, 12)
    rows = [
        readings(inclination, azimuth, 77.0 * k, 800e-9, noise=noise)
        for k, (inclination, azimuth) in enumerate(zip(np.linspace(10.0, 80.0, 12), azimuths, strict=True))
    ]
    found = analyse(np.array([force for force, _ in rows]), np.array([field for _, field in rows]), REFERENCE)
    assert found.refused is None
    raw, left = (np.degrees(azimuth) - azimuths for azimuth in (found.azimuth_raw, found.azimuth))
    yield f"{-raw[0]:.1f} deg at the first station and {-raw[-1]:.1f} deg at the last"
    yield f"{1e9 * found.estimate[0]:.0f} nT with a sigma of {1e9 * found.sigma[0]:.0f} nT"
    yield f"{np.abs(left).max():.2f} deg"


def check_shots_page() -> Iterator[str]:
    force, field = map(np.array, zip(*(readings(30.0, 100.0, face) for face in (10, 100, 190, 280)), strict=True))
    (found,) = check_shots([1000.0] * 4, force + np.array([0.0, 0.03, 0.0]), field, SensorErrors())
    bias = found.biases[0]
    assert (bias.sensor, bias.axis, found.verdict) == ("accelerometer", "y", "doubtful")
    yield f"{math.degrees(found.spread_inclination):.2f} deg"
    yield f"{math.degrees(found.expected_inclination):.2f} deg"
    yield f"{1e3 * bias.value:.0f} mm/s^2 with a sigma of {1e3 * bias.sigma:.1f} mm/s^2"
    yield found.verdict


def bottom_hole_assembly(tmp_path) -> Iterator[str]:
    text = (PAGES / "bottom_hole_assembly.md").read_text()
    path = tmp_path / "bha.yaml"
    path.write_text("\n".join(line[4:] for line in re.search(r"(?m)(^    .*\n)+", text).group().splitlines()))
    described = read_assembly(path)
    for at in (11.0, 12.0, 15.0):
        one = dataclasses.replace(described, sensor_m=at)
        sags = (math.degrees(sag(one, math.radians(angle))) for angle in (5, 10, 20, 90))
        yield f"| {at:.0f} | " + " | ".join(f"{abs(round(value, 2)):.2f}" for value in sags) + " |"


def bounded_gravity_filter() -> Iterator[str]:
    noise, rate, over, n = np.random.default_rng(1), 100, 40, 6000
    time = np.arange(n * over) / (rate * over)
    still = mat_nt(math.radians(60.0), 0.3, 0.0).T @ [0.0, 0.0, -9.81]
    shaken = 40.0 * np.sin(math.tau * 17.3 * time), 40.0 * np.cos(math.tau * 13.1 * time)
    y, z = still[1] + shaken[0], still[2] + shaken[1]
    cosine, sine = np.cos(4.0 * math.pi * time), np.sin(4.0 * math.pi * time)
    axial = still[0] + 20.0 * np.sin(math.tau * 9.7 * time)
    force = np.stack([axial, cosine * y + sine * z, cosine * z - sine * y], axis=1).reshape(n, over, 3).mean(axis=1)
    force += 0.05 * noise.normal(size=(n, 3))
    gyro = np.array([4.0 * math.pi, 0.0, 0.0]) + math.radians(0.05) * noise.normal(size=(n, 3)) + math.radians(0.1)
    stamps = (np.arange(1, n + 1) * 1e9 / rate).astype(np.int64)
    found = bounded.run(BoundedParams(), initial(BoundedParams()), stamps, gyro, force)
    for down in (-force, found.g_t):
        angle = np.degrees(np.arctan2(np.hypot(down[:, 1], down[:, 2]), down[:, 0]))[3000:]
        yield f"{math.sqrt(np.mean((angle - 60.0) ** 2)):.2g} deg"
    yield f"{math.degrees(found.sigma_inclination[3000:].mean()):.2g} deg"


def fuzzy_mahony() -> Iterator[str]:
    shaken, step = 40.0 / 9.81, fuzzy_step(40.0, 120.0)
    yield f"{math.degrees(math.atan(shaken)):.0f} deg"
    yield f"{step:.3f} 1/s"
    for gain in (MahonyParams().k_p, MahonyParams().k_p + step):
        yield f"{math.degrees(gain * shaken / (math.tau * 17.0)):.2f} deg"
    surge = bias = integral = carried = most = 0.0
    for _ in range(4000):
        carried += -MahonyParams().k_i * bias * 0.01
        bias += (0.1 - MahonyParams().k_p * bias + carried) * 0.01
        most = max(most, bias)
    for _ in range(1000):
        off = math.degrees(1.0 / 9.81) - surge
        integral += MahonyParams().k_i * off * 0.01
        surge += (MahonyParams().k_p * off + integral) * 0.01
    yield f"{surge:.1f} deg"
    yield f"{most:.2f} deg"


def gyrocompass() -> Iterator[str]:
    horizontal = EARTH_RATE * math.cos(math.radians(60.0))
    noise = math.radians(0.05) / 60.0
    yield f"{math.degrees(horizontal) * 3600.0:.1f} deg/h"
    for seconds in (120.0, 600.0):
        yield f"{math.degrees(noise / horizontal / math.sqrt(seconds)):.1f} deg"
    yield f"{math.degrees(math.radians(0.5) / 3600.0 / horizontal):.1f} deg"
    yield f"{math.degrees(noise / horizontal / math.sqrt(120.0)) / math.sqrt(1.0 - 0.75):.1f} deg"


def magnetic_reference() -> Iterator[str]:
    found = with_external(REFERENCE, np.array([-120e-9, 80e-9, 30e-9]), 0.2, "an observatory")
    yield f"{1e9 * found.total:.0f} nT"
    yield f"{math.degrees(found.dip):.2f} deg"
    yield f"{math.degrees(found.declination):.2f} deg"


def survey_run() -> Iterator[str]:
    priors = StationSettings().priors
    for hours in (0.5, 6.0, 24.0):
        yield f"{100.0 * -math.expm1(-hypotheses.hazard(priors, hours)):.2g} %"


def dense_trajectory() -> Iterator[str]:
    angles = np.radians([20.0, 23.0, 23.0])
    arc = mc.path([0.0, 30.0], angles[:2], [0.0, 0.0])[-1]
    slide = mc.path([0.0, 10.0, 30.0], angles, [0.0, 0.0, 0.0])[-1]
    yield f"{arc[2] - slide[2]:.2f} m"
    yield f"{slide[0] - arc[0]:.2f} m"


def mud_channel() -> Iterator[str]:
    for depth in (1000.0, 3000.0, 5000.0):
        gain = np.abs(responses(WellGeometry(depth_m=depth), np.array([0.5, 1.0, 2.25]))[0])
        yield f"| {depth:.0f} | " + " | ".join(f"{20.0 * math.log10(value):.0f}" for value in gain) + " |"


def pulse_receiver() -> Iterator[str]:
    pulses = encode(142, 8)
    yield ", ".join(map(str, packets(8)))
    yield ", ".join(map(str, pulses.edges))
    yield f"{pulses.length} TU"
    for evidence, confirmed in ((9.0, True), (8.0, False)):
        presence = Presence(14.0)
        presence.judge(PulseEvidence(evidence, evidence, 3, 1))
        assert presence.confirmed == confirmed
        yield f"{2.0 * evidence:.0f}"


def downlink() -> Iterator[str]:
    frame, settings = DownlinkFrame(3, 1, 2), Downlink()
    yield f"{frame.echo}"
    yield ", ".join(map(str, levels(frame, settings)))
    yield f"{programme(frame, settings).duration_s:.0f} s"
    yield f"{programme(frame, settings).lowest:.0%}".replace("%", " %")


def carrier_and_serial() -> Iterator[str]:
    for decibel in (4.0, 6.0):
        ratio = 10.0 ** (decibel / 10.0)
        yield f"{100.0 * 0.5 * math.erfc(math.sqrt(ratio)):.2g} %"
        yield f"{100.0 * 0.5 * math.exp(-ratio):.2g} %"


def telemetry_link() -> Iterator[str]:
    lag = 2200.0 * 0.1 / 473.0
    yield f"{lag:.2f} m"
    yield f"{lag / (20.0 / 3600.0):.0f} s"
    yield f"{math.degrees(lag / 0.1):.0f} deg"


def sensor_health() -> Iterator[str]:
    yield f"{1.25 * 2000.0:.0f} deg/s"
    yield f"{math.radians(1.25 * 2000.0):.1f} rad/s"
    yield f"{math.degrees(20.0 * 0.01):.0f} deg"


def position_and_clearance() -> Iterator[str]:
    yield f"{(25.0 - 0.16 - 0.12 - 0.3) / (3.5 * math.sqrt(3.0**2 + 4.0**2 + 0.5**2)):.2f}"
    yield f"{3.5 * math.sqrt(3.0**2 + 4.0**2 + 0.5**2) + 0.58:.1f} m"


def continuous_attitude() -> Iterator[str]:
    yield f"{100.0 * 6.0 * 0.01:.0f} deg"
    yield f"{10.0 / math.sin(math.radians(30.0)):.0f} deg/h"


def coil_link() -> Iterator[str]:
    above = float(np.linalg.norm(dipole_field((0.0, 0.0, 4.0), (5.0, 0.0, 0.0)).real))
    yield f"{1e9 * above:.1f} nT"
    yield f"{sonde_locate.depth_overhead(above, 5.0, 0.0):.1f} m"
    yield f"{100.0 * (1.0 - sonde_locate.depth_overhead(1.02 * above, 5.0, 0.0) / 4.0):.1f} %"
    behind, ahead = sonde_locate.locate_points(4.0, 0.0)
    yield f"{ahead:.2f} m"
    yield f"{ahead - behind:.2f} m"
    behind, ahead = sonde_locate.locate_points(4.0, math.radians(-10.0))
    yield f"{-behind:.2f} m"
    yield f"{ahead:.2f} m"
    azimuth, pitch, noise = math.radians(42.0), math.radians(-1.2), np.random.default_rng(1)
    ahead_n = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    right_n = np.array([-ahead_n[1], ahead_n[0], 0.0])
    axis = math.cos(pitch) * ahead_n - np.array([0.0, 0.0, math.sin(pitch)])
    middle = np.array([23.5, 21.0, 0.0])
    points = np.array([middle + a * ahead_n + b * right_n for a in (-4, 0, 4) for b in (-3, 0, 3)]).round(1)
    field = dipole_field(points - np.array([24.0, 21.5, 3.9]), 5.0 * axis).real
    field += np.hypot(1e-11, 0.02 * np.linalg.norm(field, axis=1))[:, None] * noise.normal(size=field.shape)
    read = sonde_locate.SurfaceReadings(points, field, np.full(9, np.nan))
    known = sonde_locate.SondeFacts(surface_readings.calibrated("3,18.5"), pitch=pitch, azimuth=azimuth)
    yield from surface_readings.lines(sonde_locate.locate(read, known), surface_readings.SentAttitude())[:4]


EXAMPLES = {
    "azimuth_posterior": azimuth_posterior,
    "bounded_gravity_filter": bounded_gravity_filter,
    "carrier_and_serial": carrier_and_serial,
    "check_shots": check_shots_page,
    "coil_link": coil_link,
    "continuous_attitude": continuous_attitude,
    "dense_trajectory": dense_trajectory,
    "downlink": downlink,
    "fuzzy_mahony": fuzzy_mahony,
    "gyrocompass": gyrocompass,
    "logs": logs,
    "magnetic_interference": magnetic_interference,
    "magnetic_reference": magnetic_reference,
    "mud_channel": mud_channel,
    "multi_station_analysis": multi_station_analysis,
    "position_and_clearance": position_and_clearance,
    "pulse_receiver": pulse_receiver,
    "sensor_health": sensor_health,
    "survey_run": survey_run,
    "survey_station": survey_station,
    "telemetry_link": telemetry_link,
}


@pytest.mark.parametrize("name", NAMES)
def test_a_page_of_a_method_has_its_parts_in_order(name):
    found = [title for title in sections(name) if title in PARTS]
    assert found == PARTS


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(EXAMPLES))
def test_the_figures_of_a_worked_example_are_those_of_the_code(name):
    text = " ".join(sections(name)["A worked example"].split())
    missing = [figure for figure in EXAMPLES[name]() if figure not in text]
    assert not missing


@pytest.mark.slow
def test_the_sag_table_of_the_page_is_that_of_its_assembly(tmp_path):
    text = sections("bottom_hole_assembly")["A worked example"]
    missing = [row for row in bottom_hole_assembly(tmp_path) if row not in text]
    assert not missing
