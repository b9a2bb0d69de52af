# SPDX-License-Identifier: Apache-2.0
"""Summary of the processing of a bag: counts, surveys, faults, and the warnings that follow from them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.attitude import magnetic_delay
from mwd_estimation.core.reason_text import text
from mwd_estimation.core.sensor_fault import SensorFault
from mwd_estimation.core.status import Status
from mwd_estimation.gravity.bounded import sample_meaning
from mwd_estimation.pipeline.output import Output
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings import derivation
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.decided_survey import DecidedSurvey
from mwd_surface.processing.bag_input import Topics
from mwd_surface.surveys.survey_list import SurveyList

# Shares of the rows above which a warning is given: refused samples, rows without azimuth because of a disturbed field,
# and rows after a gap.
_MANY_REFUSED = 0.1
_MANY_DISTURBED = 0.05
_MANY_GAPS = 0.5
TOOL_ASSUMED = (
    "tool assumed: the errors of its accelerometers are not stated, so the sigmas of inclination and toolface are "
    "those of a new unit without calibration; give a tool file (--tool), or set tool.accelerometer.misalignment_mrad, "
    "bias_ug and scale_ppm from the calibration"
)


@dataclasses.dataclass
class Summary:
    """Summary of the processing of a bag."""

    topics: Topics
    rows: int = 0  #: number of IMU messages
    #: `start_ns`, `end_ns`: stamps of the first and the last IMU message, ns since 1970
    start_ns: int = 0
    end_ns: int = 0
    #: `rejected`, `gaps`, `without_gravity`, `without_azimuth`: number of rows flagged as rejected, flagged as
    #: following a gap, without gravity, and without azimuth
    rejected: int = 0
    gaps: int = 0
    without_gravity: int = 0
    without_azimuth: int = 0
    disturbed: int = 0  #: number of rows without an azimuth because the magnetic field differed from its reference
    #: `total_off`, `dip_off`: largest deviation of total field, T, and dip, rad, from the reference in blocks with such
    #: rows
    total_off: float = 0.0
    dip_off: float = 0.0
    #: `lowest`, `highest`: range of the inclination, rad, without angles that may have any error; nan without others
    lowest: float = math.nan
    highest: float = math.nan
    #: `north`, `reference`: north of the azimuth, and source of the reference field
    north: str = "magnetic"
    reference: str = "none"
    #: surveys as first decided, with their measured depths, m; nan if unknown
    surveys: list[tuple[DecidedSurvey, float]] = dataclasses.field(default_factory=list)
    #: survey list in the form of the surface node, with the definitive values of these surveys
    listed: SurveyList = dataclasses.field(default_factory=SurveyList)
    depths: str = ""  #: source of the depths of the surveys, as text
    depth_table: bool = False  #: whether the user gave a table of depths
    #: how `listed` differs from the survey list recorded live, as text; empty if none was recorded
    live: str = ""
    no_survey: str = ""  #: reason why there is no survey, as text; empty if there are surveys
    #: faults of sensors, as they were found, narrowed down or cleared
    faults: list[SensorFault] = dataclasses.field(default_factory=list)
    warnings: list[str] = dataclasses.field(default_factory=list)
    files: list[str] = dataclasses.field(default_factory=list)  #: names of the files written
    mag_used: bool = True  #: whether the magnetometer was used
    #: differences between the recorded samples and those that the live estimator used; empty if there are none
    other_input: list[str] = dataclasses.field(default_factory=list)
    as_live: bool = False  #: whether the settings are those of the live survey list in the recording

    @property
    def seconds(self) -> float:
        """Time covered by the rows, s."""
        return (self.end_ns - self.start_ns) * 1e-9

    def count(self, output: Output) -> None:
        """Count the rows of an output of the estimator."""
        attitude = output.attitude
        if self.rows == 0 and len(attitude):
            self.start_ns = int(attitude["stamp_ns"][0])
        self.rows += len(attitude)
        if len(attitude):
            self.end_ns = int(attitude["stamp_ns"][-1])
        status = np.ascontiguousarray(attitude["status"])
        self.rejected += int(np.count_nonzero(status & int(Status.REJECTED)))
        self.gaps += int(np.count_nonzero(status & int(Status.GAP)))
        known = np.isfinite(attitude["inclination"])
        self.without_gravity += int(len(attitude) - np.count_nonzero(known))
        unknown = np.isnan(attitude["azimuth"])
        self.without_azimuth += int(np.count_nonzero(unknown))
        withheld = int(np.count_nonzero(unknown & (status & int(Status.MAG_DISTURBED) != 0)))
        if withheld and len(output.interference):
            total, dip = (np.nan_to_num(output.interference[name]) for name in ("total_residual", "dip_residual"))
            self.total_off = max(float(total.min()), float(total.max()), self.total_off, key=abs)
            self.dip_off = max(float(dip.min()), float(dip.max()), self.dip_off, key=abs)
        self.disturbed += withheld
        # With a sigma of pi the angle may have any error.
        inclination = attitude["inclination"][known & (attitude["sigma_inclination"] < math.pi)]
        if len(inclination):
            self.lowest = float(np.fmin(self.lowest, inclination.min()))
            self.highest = float(np.fmax(self.highest, inclination.max()))


def hindrance(pipeline: Pipeline, summary: Summary) -> str:
    """Return why the estimator took no survey, as text; of several reasons, the most frequent."""
    settings, found = pipeline.settings.survey, pipeline.still.hindrances
    needed = settings.settle_s + settings.duration_s
    if not settings.automatic:
        return "surveys are not taken automatically (survey.automatic)"
    if summary.seconds < needed:
        return f"a survey needs {needed:g} s of data at rest, and there are {max(summary.seconds, 0.0):.1f} s"
    if summary.without_gravity == summary.rows:
        return "the inclination was never known: see the warnings about the sensors"
    if not found:
        return f"no rest lasted {needed:g} s"
    often, reason = max(found.values(), key=lambda one: one[0])
    return f"no rest lasted {needed:g} s; the most frequent reason, in {often} half seconds: {text(reason)}"


def pipeline_warnings(
    summary: Summary, pipeline: Pipeline, estimator: EstimatorSettings, samples_are: str = ""
) -> list[str]:
    """
    Return the warnings after the whole recording has passed the pipeline.

    samples_are : kind of the samples according to the data, from a smoother (`BoundedState.samples_are`).
    """
    warnings = []
    if estimator.tool.accelerometer.assumed:
        warnings.append(TOOL_ASSUMED)
    if summary.rejected > _MANY_REFUSED * summary.rows:
        warnings.append(
            f"{summary.rejected} of {summary.rows} IMU samples were refused, because their times do not advance, or "
            "their values are impossible or not finite"
        )
    # There is no rate if the last stamp is not after the first, because the time went back.
    if summary.gaps > _MANY_GAPS * summary.rows and summary.seconds > 0.0:
        rate_hz = (summary.rows - 1) / summary.seconds
        warnings.append(
            f"the IMU gives {rate_hz:.2g} samples/s, and most of them follow a gap: no survey can be averaged, and the "
            "attitude comes from single samples; record at the rate of the sensor"
        )
    if summary.disturbed > _MANY_DISTURBED * summary.rows:
        possible = derivation.interference_params(estimator).axial
        warnings.append(
            f"{summary.disturbed} of {summary.rows} rows have no azimuth because the magnetic field differs from the "
            f"reference (by up to {summary.total_off * 1e9:+,.0f} nT and {math.degrees(summary.dip_off):+.1f} deg of "
            f"dip). There is external interference, or the string causes more than {1e9 * possible:,.0f} nT, the limit "
            "from tool.axial_interference_nt; the first accepted survey will show a magnetised string"
        )
    if pipeline.went_back:
        often, (left_ns, begun_ns) = len(pipeline.went_back), pipeline.went_back[0]
        times = "once," if often == 1 else f"{often} times, the first"
        by_s, at_s = (left_ns - begun_ns) * 1e-9, (left_ns - summary.start_ns) * 1e-9
        warnings.append(f"time went back {times} by {by_s:.1f} s, {at_s:.1f} s after the start: the estimate restarted")
    warnings += pipeline.noise_notes
    if meaning := sample_meaning.in_words(samples_are or pipeline.samples_are):
        warnings.append(meaning)
    if pipeline.temperature.outside is not None:
        low, high = pipeline.temperature.outside
        warnings.append(
            f"the tool was at {low:.0f} to {high:.0f} degC, outside its calibration: the sigma of surveys at these "
            "temperatures is widened by tool.accelerometer.bias_ug_per_c and tool.magnetometer.bias_nt_per_c"
        )
    delay = magnetic_delay.in_words(pipeline.mag_late_ns)
    if delay:
        warnings.append(f"{delay} from then on; stamp the samples of both sensors when they are measured")
    if pipeline.counters.spikes:
        warnings.append(f"{pipeline.counters.spikes} magnetic samples were not used, because they were spikes")
    if pipeline.counters.late_mag:
        warnings.append(
            f"{pipeline.counters.late_mag} magnetic samples were not used, because they came later than "
            "tool.magnetometer.delay_s allows; raise this parameter"
        )
    return warnings
