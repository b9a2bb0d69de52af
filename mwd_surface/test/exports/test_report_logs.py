# SPDX-License-Identifier: Apache-2.0
"""The report of a run: health of the tool with what is assumed, and the logs as depth tracks."""

import io

import numpy as np
import pytest

from mwd_sensors.telemetry.log_channels import LogSample
from mwd_sensors.telemetry.tool_limits import BatteryLimits, ExposureLimit, ToolLimits, ToolPart
from mwd_surface.exports.report_logs import health_section, log_section
from mwd_surface.logs.depth_log import DepthLog
from mwd_surface.logs.log_journal import NAME, LogJournal
from mwd_surface.logs.recorded_log import FILE
from mwd_surface.logs.tool_health import HealthLedger, ToolHealth
from mwd_surface.runs.player import run_logs
from mwd_surface.signals.table import Display
from mwd_surface.signals.units import FIELD

S = 10**9
T0 = 1_772_323_200 * S


def samples():
    for at in range(60, 3600, 60):
        for name, unit, value in (
            ("temperature", "degC", 130.0),
            ("battery_voltage", "V", 27.5),
            ("gamma", "gAPI", 80.0),
        ):
            sectors = (70.0, 75.0, 80.0, 85.0) if name == "gamma" else ()
            more = {"sectors": sectors, "sigma_sectors": sectors, "sector_durations": sectors}
            yield LogSample(T0 + at * S, name, unit, 60.0, 60.0, value, 1.0, source=name, **more)


def test_what_the_ledger_knows_is_printed_and_marked_where_it_is_beyond():
    limits = ToolLimits(
        BatteryLimits(), {"temperature": ExposureLimit(((125.0, 0.5),))}, {"gamma": ToolPart("G1", "2024-01-01")}
    )
    ledger = HealthLedger(limits)
    for one in samples():
        ledger.add(one)
    section = health_section(ledger.health(), Display(FIELD))
    run, exposure, parts = section.sheets
    values = {row[0]: row[1] for row in run.rows}
    assert values["Battery voltage"] == "27.5"
    assert float(values["Battery remaining"]) == round(ledger.health().battery.remaining / 3600.0, 1)
    assert exposure.rows[0][:1] == ("temperature",)
    assert exposure.tints[0, 5] == "reject"
    assert parts.rows[0][3]
    assert not exposure.legend
    assert health_section(ToolHealth(), Display()) is None


def test_the_logs_are_drawn_from_the_folder_of_a_run(tmp_path):
    journal = LogJournal(tmp_path / "surveys" / NAME)
    for at in range(3600):
        journal.add_rig(T0 + at * S, 1000.0 + 0.01 * at, pumping=True)
    for one in samples():
        journal.add_sample(one)
    journal.close()
    log, health = run_logs(tmp_path, 3.0)
    assert isinstance(log, DepthLog)
    assert any("tool file" in text for text in health_section(health, Display()).text)
    (drawing,) = log_section(log.curves(), Display(FIELD)).drawings
    figure = drawing.draw()
    # Gamma, its sectors, temperature, battery.
    assert len(figure.axes) == 4
    line = figure.axes[0].lines[0]
    np.testing.assert_allclose(line.get_xdata()[np.isfinite(line.get_xdata())], 80.0)
    assert figure.axes[0].yaxis_inverted()
    temperature = figure.axes[2].lines[0].get_xdata()
    np.testing.assert_allclose(temperature[np.isfinite(temperature)], 266.0)
    figure.savefig(io.BytesIO())
    assert log_section((), Display()) is None
    assert run_logs(tmp_path / "elsewhere", 3.0) is None


@pytest.mark.parametrize(
    "text", ["", '{"health": "{', "[]", "3", '{"health": 5}', '{"health": "[1]"}', '{"other": "x"}', b"\xff"]
)
def test_a_torn_file_of_the_limits_costs_the_limits_alone_and_is_said(tmp_path, text):
    journal = LogJournal(tmp_path / NAME)
    for one in samples():
        journal.add_sample(one)
    journal.close()
    _, health = run_logs(tmp_path, 3.0)
    assert not health.remarks
    (tmp_path / FILE).write_bytes(text if isinstance(text, bytes) else text.encode())
    _, health = run_logs(tmp_path, 3.0)
    assert any(FILE in one for one in health_section(health, Display()).text)
    (tmp_path / FILE).write_text("{}")
    assert not run_logs(tmp_path, 3.0)[1].remarks
