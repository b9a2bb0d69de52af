# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of the estimator: samples, reference field, sensors, current survey and attitude."""

from __future__ import annotations

from mwd_estimation.attitude import magnetic_delay
from mwd_estimation.core.fault_messages import describe
from mwd_estimation.core.reason_text import text
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.sensor_fault import ACCEL, GYRO
from mwd_estimation.core.status import Status, words
from mwd_estimation.gravity.bounded import sample_meaning
from mwd_estimation.health import fault_debounce
from mwd_estimation.health.fault_debounce import UNKNOWN
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.ros.diagnostics import ERROR, OK, WARN, Diagnostic

# Texts for the states of a check.
CONDITIONS = {UNKNOWN: "not yet known", fault_debounce.OK: "ok", fault_debounce.FAULT: "fault"}


def unused_samples(pipeline: Pipeline, unreadable: int) -> int:
    """Return the number of samples that were not used; unreadable: number of messages that could not be decoded."""
    counters = pipeline.counters
    return counters.rejected + counters.late_mag + counters.spikes + pipeline.of_no_time + unreadable


def sample_diagnostic(pipeline: Pipeline, unreadable: int, lately: bool = True) -> Diagnostic:
    """
    Return the diagnostic of the samples that were not used, with their number for each cause.

    unreadable: number of messages that could not be decoded; lately: whether there were unused samples in the last
    seconds.
    """
    counters, unused = pipeline.counters, unused_samples(pipeline, unreadable)
    values = (
        ("rejected", str(counters.rejected)),
        ("late magnetic", str(counters.late_mag)),
        ("magnetic spikes", str(counters.spikes)),
        ("at another time than the IMU", str(pipeline.of_no_time)),
        ("unreadable", str(unreadable)),
        ("time went back", str(counters.set_back)),
    )
    if not unused:
        return Diagnostic("samples", OK, "all used", values=values)
    if not lately:
        return Diagnostic(
            "samples", OK, f"all samples are used now; {unused} earlier samples were not used", values=values
        )
    # Each cause has its own remedy; sensor faults have diagnostics of their own.
    remedies = {
        "gaps, repeated stamps, sensor faults: see the other entries of this node": counters.rejected,
        "magnetic samples come later than those of the IMU: raise tool.magnetometer.delay_s": counters.late_mag,
        "look for a pulsed current near the magnetometer, or a loose plug": counters.spikes,
        "the stamps of only one sensor jumped: stamp all sensors with one clock": pipeline.of_no_time,
        "check that the published messages have the expected type": unreadable,
    }
    remedy = "; ".join(words for words, count in remedies.items() if count)
    return Diagnostic("samples", WARN, f"{unused} not used", remedy, values)


def input_diagnostics(pipeline: Pipeline) -> list[Diagnostic]:
    """Return diagnostics of the noise from covariances, kind of the samples, temperature and magnetometer delay."""
    found = [Diagnostic(f"stated noise {k + 1}", OK, note) for k, note in enumerate(pipeline.noise_notes)]
    if meaning := sample_meaning.in_words(pipeline.samples_are):
        message, _, remedy = meaning.partition("; ")
        found.append(Diagnostic("samples of the imu", WARN, message, remedy))
    if pipeline.temperature.outside_now:
        message = f"{pipeline.temperature.last:.0f} degC is outside of the calibration: the sigmas are widened"
        remedy = "cool the tool, or calibrate the tool at that temperature and set tool.calibrated_c"
        found.append(Diagnostic("temperature", WARN, message, remedy))
    delay = magnetic_delay.in_words(pipeline.mag_late_ns)
    if delay:
        found.append(Diagnostic("time imu/mag", WARN, delay, "stamp both sensors when they measure"))
    return found


def reference_diagnostic(reference: Reference | None) -> Diagnostic:
    """Return the diagnostic of the current reference, with its values in T, rad and m/s^2 in full precision."""
    if reference is None:
        message, remedy = (
            "no reference field: the azimuth is magnetic and uncorrected",
            "set place.field, or call set_reference_field",
        )
        return Diagnostic("reference field", WARN, message, remedy)
    if not reference.has_field:
        # Without a field, the source of the reference is a sentence with the cause and, after "; ", the remedy.
        message, _, remedy = reference.source.rpartition("; ")
        return Diagnostic("reference field", WARN, message or remedy, remedy)
    names = ("total", "dip", "declination", "convergence", "gravity")
    values = [(name, getattr(reference, name)) for name in names]
    known = tuple((name, repr(float(value))) for name, value in values if value is not None)
    return Diagnostic("reference field", OK, reference.source, values=known)


def sensor_diagnostics(pipeline: Pipeline, *, has_azimuth: bool) -> list[Diagnostic]:
    """
    Return one entry for each sensor fault; without a fault, return one entry that lists the undecided checks.

    The level depends on the consequence for the driller (ISA-18.2): a faulty magnetometer or precision unit is only a
    warning as long as the other sensors still give an azimuth (`has_azimuth`).
    """
    faults = pipeline.sensor_faults
    if not faults:
        known = pipeline.sensors_known
        undecided = [name for name, condition in known.items() if condition == UNKNOWN]
        message = f"no fault; not yet known: {', '.join(undecided)}" if undecided else "healthy"
        values = tuple((name, CONDITIONS[condition]) for name, condition in known.items())
        return [Diagnostic("sensors", OK, message, values=values)]
    found = []
    for k, fault in enumerate(faults):
        said = describe(fault)
        replaced = has_azimuth and fault.unusable != 0 and not fault.unusable & (GYRO | ACCEL)
        message = f"{said.message}; the azimuth is computed without this sensor" if replaced else said.message
        values = (
            ("kind", said.kind),
            ("sensor", said.sensor),
            ("axis", said.axis),
            ("confidence", f"{said.confidence:.2f}"),
            ("since_s", f"{fault.since_ns * 1e-9:.1f}"),
        )
        level = ERROR if said.severity == "error" and not replaced else WARN
        found.append(Diagnostic("sensors" if k == 0 else f"sensors {k + 1}", level, message, said.remedy, values))
    return found


def survey_diagnostic(pipeline: Pipeline, settings: EstimatorSettings, requested_s: float | None) -> Diagnostic:
    """Return the diagnostic of the current survey; requested_s: duration of a requested survey, or None."""
    survey, still = settings.survey, pipeline.still
    share = still.progress
    if not (survey.automatic or requested_s is not None) or share == 0.0:
        return Diagnostic("survey", OK, "none under way")
    if share >= 1.0:
        return Diagnostic("survey", OK, "a survey was taken here; the next one comes after the tool has moved")
    seconds = survey.settle_s + survey.duration_s if requested_s is None else requested_s
    if still.waits_for is not None:
        waits_for, waited = text(still.waits_for), still.waited_s
        left = max(survey.wait_for_gyro_s - waited, 0.0)
        waits = (("elapsed_s", f"{waited:.1f}"), ("remaining_s", f"{left:.1f}"), ("waits_for", waits_for))
        return Diagnostic(
            "survey", OK, f"averaging continues while the survey waits for the gyro: {waits_for}", values=waits
        )
    values = (("elapsed_s", f"{share * seconds:.1f}"), ("remaining_s", f"{(1.0 - share) * seconds:.1f}"))
    settling = requested_s is None and share * seconds < survey.settle_s
    return Diagnostic("survey", OK, "letting the string settle" if settling else "averaging", values=values)


def attitude_diagnostic(status: int) -> Diagnostic:
    """Return the diagnostic of the attitude, with the names of its status bits."""
    return Diagnostic("attitude", OK, words(status & ~int(Status.NO_REFERENCE)) or "no sample so far")
