# SPDX-License-Identifier: Apache-2.0
"""The header of a table does not depend on its rows: a table without rows has the header of one with a row."""

import math

import numpy as np
import pytest
from typer.testing import CliRunner

from mwd_surface.clearance.clearance import Clearance, ClearanceRule
from mwd_surface.cli import app
from mwd_surface.exports.csv_tables import clearance_csv, forecast_csv
from mwd_surface.runs import tool_comparison
from mwd_surface.runs.tool_comparison import ToolDirection, ToolStation
from mwd_surface.uncertainty.forecast import Forecast


def forecast(rows):
    numbers = {name: np.ones(rows) for name in Forecast.__annotations__ if name not in ("limits", "no_go")}
    known = {**numbers, "limits": np.ones((rows, 3)), "no_go": np.ones(rows, bool), "most": 1.0, "axial": 0.0}
    return forecast_csv(Forecast(**known))


def clearance(rows):
    names = ("md", "offset_md", "distance", "allowed", "factor", "toolface", "bearing")
    return clearance_csv([Clearance(name="A-2", rule=ClearanceRule(), **{name: np.ones(rows) for name in names})])


def no_well(rows):
    return clearance(rows) if rows else clearance_csv([])


@pytest.fixture
def tools(tmp_path, monkeypatch):
    def table(rows):
        one = ToolDirection(0.1, 0.2, math.nan)
        station = ToolStation(10.0, one, one, one, automatic=False, accepted=True)
        monkeypatch.setattr(tool_comparison, "compared", lambda _story: [station] * rows)
        done = CliRunner().invoke(app, ["tools", "s1_lab", "-o", str(tmp_path / "tools.csv")])
        assert done.exit_code == 0, done.output
        return (tmp_path / "tools.csv").read_text()

    return table


@pytest.mark.parametrize("made", [forecast, clearance, no_well, "tools"])
def test_a_table_without_rows_has_the_header_of_a_table_with_one(made, request):
    table = request.getfixturevalue(made) if isinstance(made, str) else made
    header, row = table(1).splitlines()
    assert table(0).splitlines() == [header]
    assert header.count(",") == row.count(",")
