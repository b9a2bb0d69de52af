# SPDX-License-Identifier: Apache-2.0
"""
Settings of the tool: the errors of its sensors, and its position in the string.

Names and units are those of the grade files of the simulator, so that a grade file is a valid tool file (`tool_file`).
"""

from __future__ import annotations

from dataclasses import dataclass

from mwd_sensors.core.mount import MountSettings
from mwd_sensors.core.settings import setting

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Gyro:
    """Settings of the gyros of the conventional unit, 1 sigma unless stated otherwise."""

    range_deg_s: Vector = setting(
        (2000.0, 2000.0, 2000.0),
        "Largest rate that each axis can measure; the smallest of the three values is used. If set too large, clipped "
        "rates count as true rates; if too small, fast turning counts as clipped. From the data sheet.",
        low=0.1,
        high=2e6,
    )
    noise_deg_sqrt_h: float = setting(
        0.42,
        "White noise (angle random walk). Raising it widens the sigma of a gyro-propagated azimuth. From the data "
        "sheet, or from `mwd plot --what allan`.",
        low=0.0,
        high=100.0,
        expert=True,
    )
    bias_deg_h: float = setting(
        400.0,
        "Bias that remains after calibration, 1 sigma. Raising it slows the convergence of the gyro-propagated "
        "azimuth. From the data sheet (turn-on bias).",
        low=0.0,
        high=1e5,
        expert=True,
    )
    misalignment_mrad: float = setting(
        0.3,
        "Share of the rate about the tool axis that the cross axes read, 1 sigma. Raising it widens the sigma of "
        "inclination and azimuth in a turning string until the misalignment is estimated. 0.3 is usual after a "
        "calibration, 1 without.",
        low=0.0,
        high=100.0,
        expert=True,
    )
    g_deg_h_g: float = setting(
        3.6,
        "Sensitivity of the rate to specific force, 1 sigma. Raising it widens the sigma of a gyro-propagated azimuth.",
        low=0.0,
        high=1e4,
        expert=True,
    )


@dataclass(frozen=True)
class Accelerometer:
    """Settings of the accelerometers of the conventional unit."""

    range_g: Vector = setting(
        (16.0, 16.0, 16.0),
        "Largest force that each axis can measure; the smallest of the three values is used. If set too large, clipped "
        "shocks bias the estimate; if too small, ordinary vibration counts as clipped. From the data sheet.",
        low=0.1,
        high=2e5,
    )
    bias_ug: float = setting(
        408.0,
        "Bias of each axis that calibration leaves, 1 sigma. Raising it widens the sigma of inclination and toolface "
        "of every sample, and the acceptance limits of surveys. The default is the value of the ISCWSA MWD tool code "
        "(0.004 m/s^2); a calibration certificate may state less; a new unit without calibration has about 3000.",
        low=0.0,
        high=1e5,
        expert=True,
    )
    bias_ug_per_c: float = setting(
        10.0,
        "Growth of the bias beyond the temperatures of calibration, 1 sigma. Raising it widens the sigmas of surveys "
        "at such temperatures. From calibrations at several temperatures.",
        low=0.0,
        high=1e4,
        expert=True,
    )
    scale_ppm: float = setting(
        500.0,
        "Scale error of each axis that calibration leaves, 1 sigma. Raising it widens the sigmas and limits of "
        "surveys. The default is the value of the ISCWSA MWD tool code.",
        low=0.0,
        high=1e5,
        expert=True,
    )
    misalignment_mrad: float | None = setting(
        None,
        "Direction error of each axis that calibration leaves, 1 sigma, from the residual of a tumble calibration. "
        "Together with bias and scale error it sets the sigma of inclination and toolface of every sample; raising "
        "any of the three widens this sigma. nan: not stated; every sample then has the sigma of a new unit without "
        "calibration until the data show a smaller error, and all outputs say that the tool is assumed. In surveys "
        "this value is the angle by which the accelerometers may be rotated in their mount: it widens the sigmas of "
        "inclination and azimuth, and above about 5 mrad the first stations are doubtful until rotation of the "
        "string, or stations at other toolfaces, show the mount.",
        low=0.0,
        high=500.0,
        expert=True,
    )

    @property
    def assumed(self) -> bool:
        """Whether the errors of the accelerometers are assumed, because `misalignment_mrad` is not stated."""
        return self.misalignment_mrad is None


@dataclass(frozen=True)
class Magnetometer:
    """Settings of the magnetometer, without the field of the drill string."""

    present: bool = setting(
        True,
        "Whether the tool has a magnetometer. If false, a missing magnetometer is not reported as a fault.",
        expert=True,
    )
    range_ut: float = setting(
        800.0,
        "Largest field that an axis can measure; 0: not known. If set too large, saturation is not detected. See the "
        "data sheet.",
        low=0.0,
        high=1e6,
        expert=True,
    )
    bias_nt: float = setting(
        70.0,
        "Bias of each axis that calibration leaves, 1 sigma. Raising it widens the sigmas and acceptance limits of "
        "surveys. The default is the value of the ISCWSA MWD tool code.",
        low=0.0,
        high=10000.0,
        expert=True,
    )
    bias_nt_per_c: float = setting(
        1.0,
        "Growth of the bias beyond the temperatures of calibration, 1 sigma. Raising it widens the sigmas of surveys "
        "at such temperatures. From calibrations at several temperatures.",
        low=0.0,
        high=1e3,
        expert=True,
    )
    scale_ppm: float = setting(
        1600.0,
        "Scale error of each axis that calibration leaves, 1 sigma. Raising it widens the sigmas and limits of "
        "surveys. The default is the value of the ISCWSA MWD tool code.",
        low=0.0,
        high=1e5,
        expert=True,
    )
    delay_s: float = setting(
        0.02,
        "Time after its stamp at which a magnetic sample is used; samples that arrive later are counted and not used. "
        "Raising it delays the azimuth by the same time. Raise it if `mwd process` or the diagnostics count late "
        "samples.",
        low=0.0,
        high=0.2,
        expert=True,
    )


@dataclass(frozen=True)
class PrecisionGyro:
    """Settings of the gyros of the precision unit, 1 sigma; the defaults are those of a tactical MEMS unit."""

    range_deg_s: Vector = setting(
        (100.0, 100.0, 100.0),
        "Largest rate that each axis can measure; the smallest of the three values is used. If set too large, clipped "
        "rates bias the gyro azimuth. From the data sheet.",
        low=0.1,
        high=2e6,
        expert=True,
    )
    noise_deg_sqrt_h: float = setting(
        0.0,
        "White noise (angle random walk); 0: measured while the tool rests. Raising it widens the sigma of the gyro "
        "azimuth. Set it if pumps shake the tool during every survey.",
        low=0.0,
        high=10.0,
        expert=True,
    )
    bias_deg_h: float = setting(
        5.0,
        "Bias that remains after calibration, 1 sigma. Raising it widens the sigma of a gyro azimuth in one position. "
        "The bias of this unit is estimated from the stations of a run.",
        low=0.0,
        high=1e5,
    )
    walk_deg_h_sqrt_h: float = setting(
        0.3,
        "Random walk of the bias. Raising it widens the sigma of a long north seek and of a gyro-propagated azimuth.",
        unit="deg/h/sqrt(h)",
        low=0.0,
        high=1e4,
        expert=True,
    )
    misalignment_mrad: float = setting(
        0.3,
        "Share of the rate about the tool axis that the cross axes read, 1 sigma. Raising it widens the sigma of the "
        "gyro azimuth in a turning string.",
        low=0.0,
        high=100.0,
        expert=True,
    )
    g_deg_h_g: float = setting(
        0.5,
        "Sensitivity of the rate of each axis to the specific force along each axis, 1 sigma. Raising it widens the "
        "sigma of every gyro azimuth. Lower it for a better unit.",
        low=0.0,
        high=1e3,
        expert=True,
    )
    g_calibration_deg_h_g: tuple[float, float, float, float] = setting(
        (0.0, 0.0, 0.0, 0.0),
        "Sensitivity of the y and z gyros to specific force, known from a calibration and corrected. The four values "
        "a, c, s, h give the rate error (a + s) fy + (c + h) fz of y and (h - c) fy + (a - s) fz of z. Zeros: not "
        "calibrated.",
        expert=True,
    )


@dataclass(frozen=True)
class PrecisionUnit:
    """Settings of the precision unit (topic gyro/data_raw); a tool without such a unit does not use them."""

    gyro: PrecisionGyro = setting(PrecisionGyro, "Gyros of the high-precision unit.")


@dataclass(frozen=True)
class Tool:
    """Settings of the tool's sensors and of its position in the string; these facts are set nowhere else."""

    gyro: Gyro = setting(Gyro, "Gyros of the conventional (AHRS) unit.")
    accelerometer: Accelerometer = setting(Accelerometer, "Accelerometers of the conventional unit.")
    magnetometer: Magnetometer = setting(Magnetometer, "Magnetometer.")
    precision: PrecisionUnit = setting(PrecisionUnit, "The high-precision unit.")
    mount: MountSettings = setting(MountSettings, "Mounting of the units in the tool.")
    samples: str = setting(
        "integrated",
        "Meaning of a sample of the conventional unit: integrated (strapdown-integrated over its interval), means "
        "(mean rates and forces), points (values at an instant). A wrong choice costs accuracy under vibration: 5 Hz "
        "coning of 2 deg causes a drift of 65 deg/h. With gravity.method bounded, samples that are stated as "
        "integrated but are points are detected when the rotary speed changes; they are then used as points, and "
        "reported. See the data sheet.",
        choices=("integrated", "means", "points"),
    )
    calibrated_c: tuple[float, float] = setting(
        (-40.0, 175.0),
        "Lowest and highest temperature of the calibration. Surveys outside this range have wider sigmas and a "
        "warning. From the calibration report.",
        low=-273.0,
        high=1000.0,
        expert=True,
    )
    latency_s: float = setting(
        0.0,
        "Time from the measurement of a sample to its stamp. Both toolfaces are extrapolated by this time with the "
        "x gyro. Raising it amplifies gyro noise. Set it if the tool stamps its samples late.",
        low=0.0,
        high=2.0,
        expert=True,
    )
    toolface_offset_deg: float = setting(
        0.0,
        "Angle from the sensor housing to the scribe line, added to both toolfaces. Measure it at make-up.",
        low=-360.0,
        high=360.0,
    )
    hole_axis_deg: tuple[float, float] = setting(
        (0.0, 0.0),
        "Known misalignment, which is corrected: angles from the tool axis to the hole axis, about y (towards -z) and "
        "about z (towards +y).",
        low=-10.0,
        high=10.0,
        expert=True,
    )
    assembly_file: str = setting(
        "",
        "YAML file of the bottom-hole assembly; its sag is computed and added to the inclination, and its "
        "sigma_sag_deg is used for surveys. Empty: sag_correction_deg is used. `mwd sag` shows the correction.",
    )
    sag_correction_deg: float = setting(
        0.0,
        "Sag correction of the assembly in a horizontal hole; this value times the sine of the inclination is added to "
        "the inclination. A value other than 0 lowers the sigma of the sag (SAGE) from 0.2 to 0.08 deg. From a sag "
        "model of the assembly.",
        low=-5.0,
        high=5.0,
        expert=True,
    )
    string: str = setting(
        "non_magnetic",
        "Pipe around the magnetometer: non_magnetic (enough non-magnetic collars: 220 nT along the axis, 1 sigma), "
        "short (too few of them: 1500 nT), steel (no such collars, as around a probe in steel pipe: 3000 nT along the "
        "axis, 1000 "
        "nT across it, and at one station in three a rotated field). In a string of steel a magnetic azimuth "
        "alone is not accepted: use a gyro.",
        choices=("non_magnetic", "short", "steel"),
    )
    axial_interference_nt: float | None = setting(
        None,
        "Axial field of the drill string at the magnetometer, 1 sigma; default: by the kind of string. Raising it "
        "widens the sigma of uncorrected azimuths, applies the axial correction sooner and lets the correction "
        "explain a stronger string: up to nine times this value per sample. Set it from the collar's length.",
        low=0.0,
        high=50000.0,
    )
