# SPDX-License-Identifier: Apache-2.0
"""Checks of a standpipe pressure file: sample rate, gaps, clipping, resolution, flow."""

from __future__ import annotations

import math

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.carrier.carrier_receiver import least_rate
from mwd_surface.receiver.flow_spans import FlowSpans
from mwd_surface.receiver.pressure_files import PressureFile
from mwd_surface.receiver.pulse.pulse_receiver import LEAST_PER_TU
from mwd_surface.runs.doctor import CheckResult, missing, note, ok

# Lowest standpipe pressure while drilling, Pa. Values in bar or psi that are read as Pa are far below this limit.
_LEAST_PA = 3.0e5
# Largest power of the rounding errors relative to the power of the noise from sample to sample. A gauge with larger
# rounding errors hides weak pulses.
_ROUNDING = 0.1
# Unit in which the size of the samples is shown, and its factor: a pressure, or the voltage of a tool without pulses in
# the mud.
_UNITS = {True: ("bar", 1.0e5), False: ("V", 1.0)}


def examine_pressure(read: PressureFile, tool: ToolConfiguration | None = None) -> list[CheckResult]:
    """
    Run all checks of a pressure file; return their results, in the order in which problems should be fixed.

    The voltage of a tool that sends through the earth or by a coil has neither the size of a standpipe pressure nor the
    start of the pumps, so these checks are left out.

    Parameters
    ----------
    tool : ToolConfiguration, optional
        Tool whose telemetry the file should contain.
    """
    in_mud = tool is None or tool.medium == "mud"
    results = [_rate(read.time_s, tool), *([_size(read.pressure_pa)] if in_mud else [])]
    results.append(_resolution(read.pressure_pa, *_UNITS[in_mud]))
    results += [_flow(read, tool)] if in_mud else []
    results += [note("data", text) for text in read.notes]
    return results


def _rate(time: Array, tool: ToolConfiguration | None) -> CheckResult:
    steps = np.diff(time)
    usual = float(np.median(steps))
    rate = 1.0 / usual
    spread = float(np.percentile(steps, 95) - np.percentile(steps, 5)) / usual
    narrowest = 2.0 * LEAST_PER_TU / rate
    state = (
        f"{len(time)} samples in {time[-1] - time[0]:.0f} s, {rate:.4g} a second, intervals equal within "
        f"{100 * spread:.0f} %"
    )
    if tool is not None and tool.code == "psk":
        carrier = tool.carrier
        needed = least_rate(carrier)
        if rate < needed * (1.0 - 1e-6):
            return missing("sample rate", state, f"record {needed:.3g} samples a second or more")
        return ok("sample rate", f"{state}: enough for the carrier of {carrier.frequency_hz:g} Hz")
    state = f"{state}: enough for pulses of {narrowest:.2g} s and longer"
    if tool is not None and tool.pulse_width_s < narrowest * (1.0 - 1e-6):
        needed = 2.0 * LEAST_PER_TU / tool.pulse_width_s
        return missing("sample rate", state, f"record {needed:.3g} samples a second or more")
    return ok("sample rate", state)


def _size(pressure: Array) -> CheckResult:
    bar = _UNITS[True][1]
    low, middle, high = (float(value) / bar for value in np.percentile(pressure, (1, 50, 99)))
    state = f"median {middle:.4g} bar, most values from {low:.4g} to {high:.4g} bar"
    if high * bar < _LEAST_PA:
        remedy = (
            "check the unit, and name the column by it: pressure_bar, pressure_psi, pressure_kpa or pressure_mpa; if it"
            " is the voltage of an EM tool, name the configuration of the tool with --tool"
        )
        return note("size", f"{state}: this is too low for a standpipe", remedy)
    return ok("size", state)


def _resolution(pressure: Array, unit: str, scale: float) -> CheckResult:
    steps = np.diff(np.unique(pressure))
    if len(steps) == 0:
        return missing("resolution", "all samples are equal", "check the gauge and its cable")
    # The steps of an analog-to-digital converter are multiples of one step. The smallest step of computed values has no
    # meaning, so use a percentile.
    step = float(np.percentile(steps, 5))
    differences = np.diff(pressure)
    noise = 1.4826 * float(np.median(np.abs(differences - np.median(differences)))) / math.sqrt(2.0)
    state = f"steps of {step / scale:.3g} {unit}, noise from sample to sample {noise / scale:.3g} {unit}"
    if step**2 / 12.0 > _ROUNDING * noise**2 and len(steps) < len(pressure) // 2:
        remedy = "use a gauge or converter with a smaller range or more bits; rounding hides weak pulses"
        return note("resolution", state, remedy)
    return ok("resolution", state)


def _flow(read: PressureFile, tool: ToolConfiguration | None) -> CheckResult:
    flow = FlowSpans()
    flow.push(read.time_s, read.pressure_pa)
    starts = [span.end_s for span in flow.spans if math.isfinite(span.end_s)]
    delay = "" if tool is None else f"; a survey begins {tool.transmit_delay_s + tool.head_s:.0f} s later"
    if not starts:
        remedy = "a pulse tool sends its sync after the pumps start; start the recording before the pumps"
        return note("flow", "the pumps never start in this file", remedy)
    at = ", ".join(f"{start:.0f}" for start in starts[:8])
    return ok("flow", f"the pumps start at {at} s{delay}")
