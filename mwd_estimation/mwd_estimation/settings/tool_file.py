# SPDX-License-Identifier: Apache-2.0
"""Read a tool file, or a grade file of the simulator, as the block `tool` of the estimator's settings."""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mwd_estimation.settings.tool import PrecisionUnit, Tool
from mwd_sensors.core.input_files import read_yaml
from mwd_sensors.core.settings import SettingsError, unknown_key

TUMBLE_MRAD = 0.1  # 1 sigma of the direction error of the axes after a tumble calibration, mrad
# For each block of a grade file ("": top level), the names that only the simulator uses.
_SIMULATED_ONLY = {
    "": "name source temperature_c calibrated_at_c adc_hz gyro accelerometer magnetometer",
    "gyro": "bandwidth_hz instability_deg_h instability_s walk_deg_h_sqrt_h scale_ppm delay_ms bias_deg_h_per_c "
    "scale_ppm_per_c g2_deg_h_g2 step_deg_s",
    "accelerometer": "bandwidth_hz noise_ug_sqrt_hz instability_ug instability_s walk_ug_sqrt_h scale_ppm_per_c "
    "g2_ug_g2 step_ug delay_ms",
    "magnetometer": "noise_nt misalignment_mrad step_nt",
}


def from_file(path: Path, unit: type[Tool] | type[PrecisionUnit] = Tool) -> dict[str, Any]:
    """
    Return the part of a tool or grade file that the estimator uses, as a table for `Tool` or `PrecisionUnit`.

    If the file of a `Tool` describes the accelerometers without `misalignment_mrad`, the table gets `TUMBLE_MRAD`.

    Raises
    ------
    SettingsError
        If the file is not YAML, not a table, or has a name that neither a tool file nor a grade file may have.
    OSError
        If the file cannot be read.
    """
    table = read_yaml(path)
    if not isinstance(table, Mapping):
        raise SettingsError(f"{path}: expected a table of settings, got {table!r}")
    try:
        read = used(table, unit)
    except SettingsError as error:
        raise SettingsError(f"{path}: {error}") from error
    if unit is Tool and isinstance(read.get("accelerometer"), dict):
        # A file that describes the accelerometers must not give the samples the sigma of a tool without description.
        read["accelerometer"].setdefault("misalignment_mrad", TUMBLE_MRAD)
    return read


def used(table: Mapping[str, Any], unit: type[Any], where: str = "") -> dict[str, Any]:
    """
    Return the part of a table that a class of settings declares; names that only the simulator uses are left out.

    unit: class of settings; where: name of the block, "" for the top level.

    Raises
    ------
    SettingsError
        If the table has a name that neither a tool file nor a grade file may have; the message lists similar names.
    """
    hints, kept = typing.get_type_hints(unit), {}
    known = {field.name for field in dataclasses.fields(unit)}
    simulated = set(_SIMULATED_ONLY.get(where, "").split())
    for name, value in table.items():
        if name in known:
            block = dataclasses.is_dataclass(hints[name]) and isinstance(value, Mapping)
            kept[name] = used(value, hints[name], name) if block else value
        elif name not in simulated:
            raise SettingsError(unknown_key(str(name), sorted(known | simulated), where))
    return kept
