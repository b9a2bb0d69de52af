# SPDX-License-Identifier: Apache-2.0
"""
Settings found in a recording, which are the defaults of every command that reads the recording.

The surface node writes the parameters of estimator and surface into every recording; later changes are messages of
/parameter_events. Changes of surface parameters apply to the whole list; changes of estimator parameters are only
reported. If a recording has no estimator parameters, the place comes from a fix of a satellite receiver, if there is
one in the recording.
"""

from __future__ import annotations

import ast
import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeVar

from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.settings.place import reference_of
from mwd_sensors.core import settings
from mwd_sensors.core.settings import setting
from mwd_surface.surveys.depth import DepthRules
from mwd_surface.surveys.leg_settings import LegSettings
from mwd_surface.surveys.list_rules import ListRules
from mwd_surface.surveys.well import Well

if TYPE_CHECKING:
    from mwd_surface.bags.bag_reader import Bag

S = TypeVar("S")

ESTIMATOR, SURFACE = "parameters/estimator", "parameters/surface"
_FIX = "sensor_msgs/msg/NavSatFix"
_EVENTS, _EVENT_TYPE = "/parameter_events", "rcl_interfaces/msg/ParameterEvent"
# Field of rcl_interfaces/msg/ParameterValue that holds the value, by type number.
_FIELDS = (
    "",
    "bool_value",
    "integer_value",
    "double_value",
    "string_value",
    "byte_array_value",
    "bool_array_value",
    "integer_array_value",
    "double_array_value",
    "string_array_value",
)


@dataclasses.dataclass(frozen=True)
class SurfacePart:
    """Sections of the surface's settings that affect a survey list."""

    well: Well = setting(Well, "The well.")
    rules: ListRules = setting(ListRules, "Rules of the survey list.")
    leg: LegSettings = setting(LegSettings, "Tie-on, leg and tool.")
    depth: DepthRules = setting(DepthRules, "Depth of a survey.")


@dataclasses.dataclass(frozen=True)
class Recorded:
    """Settings found in a recording; `estimator` and `surface` are None if the recording has none."""

    estimator: EstimatorSettings | None = None
    surface: SurfacePart | None = None
    source: str = ""  #: origin of the settings of the estimator, in words
    remarks: tuple[str, ...] = ()  #: sentences on settings that this version cannot use

    def well(self, usual: Well) -> Well:
        """
        Return the well of the recording, or `usual` if the recording has none.

        If the well has no latitude, it gets the place in the settings of the estimator.
        """
        well = self.surface.well if self.surface is not None else usual
        place = self.estimator.place if self.estimator is not None else None
        if place is None or place.lat_deg is None or well.latitude_deg is not None:
            return well
        return dataclasses.replace(well, latitude_deg=place.lat_deg, longitude_deg=place.lon_deg)


def recorded_settings(bag: Bag) -> Recorded:
    """
    Return the settings of estimator and surface in a recording.

    A parameter whose name or value this version does not allow keeps its default, and is named in the remarks.
    Parameters that changed during the recording have their last value (surface) or first value (estimator).
    """
    tables = bag.metadata()
    remarks: list[str] = []
    events = _changes(bag)
    if SURFACE in tables:
        tables[SURFACE] = dict(tables[SURFACE]) | events.get("surface", {})
    before = tables.get(ESTIMATOR, {})
    usual = settings.values(EstimatorSettings())
    changed = [name for name, text in events.get("estimator", {}).items() if before.get(name) not in (None, text)]
    if changed:
        remarks.append(
            f"{', '.join(changed)} changed during the recording: all of it is processed with its initial values"
        )
    estimator = surface = None
    if before:
        estimator = kept(EstimatorSettings(), _values(before, usual), remarks, "recording")
    if SURFACE in tables:
        surface = _sections(tables[SURFACE], SurfacePart(), remarks)
    source = "those of the recording" if estimator is not None else ""
    if estimator is None:
        estimator, source = _by_receiver(bag)
    return Recorded(estimator, surface, source, tuple(remarks))


def recorded_sections(bag: Bag, usual: S) -> S | None:
    """
    Return sections of the surface's settings in a recording; None if the recording has none.

    usual: default sections. A parameter that changed during the recording has its last value.
    """
    table = bag.metadata().get(SURFACE)
    if table is None:
        return None
    return _sections(dict(table) | _changes(bag).get("surface", {}), usual, [])


def _sections(table: Mapping[str, str], usual: S, remarks: list[str]) -> S:
    """Return the sections in `usual` with the values from a table of all surface parameters."""
    parts = settings.values(usual)
    known = {name: text for name, text in table.items() if name in parts}
    return kept(usual, _values(known, parts), remarks, "recording")


def with_a_model(estimator: EstimatorSettings, stamp_ns: int) -> tuple[EstimatorSettings, str]:
    """
    Return settings whose field model is valid on the day, and a remark, which is empty if nothing was changed.

    If the chosen model is not valid on the day, the IGRF replaces it. stamp_ns: time whose day is used if the
    settings contain no date. Raises ValueError if the settings use no model, or if the IGRF cannot be used either.
    """
    try:
        reference_of(estimator.place, stamp_ns)
    except ValueError as error:
        if not estimator.place.model:
            raise
        older = settings.changed(estimator, {"place.field": "igrf"})
        if older == estimator:
            raise
        try:
            reference_of(older.place, stamp_ns)
        except ValueError:
            raise error from None
        return older, f"the field is taken from the IGRF: {error}"
    return estimator, ""


def _by_receiver(bag: Bag) -> tuple[EstimatorSettings | None, str]:
    """
    Return estimator settings with the place of the first fix of a satellite receiver, and a note that names the topic.

    Without a valid fix in the recording, the settings are None and the note is empty.
    """
    fixes = [topic.name for topic in bag.topics.values() if topic.type_name == _FIX]
    for _, name, _, data in bag.messages(fixes) if fixes else ():
        fix = bag.decode(name, data)
        if fix.status.status >= 0 and abs(fix.latitude) <= 90.0 and -180.0 <= fix.longitude <= 360.0:
            place = {"place.lat_deg": round(float(fix.latitude), 5), "place.lon_deg": round(float(fix.longitude), 5)}
            changes = {"place.field": "model", "survey.north": "true", **place}
            return settings.changed(EstimatorSettings(), changes), f"the place of {name}"
    return None, ""


def _changes(bag: Bag) -> dict[str, dict[str, str]]:
    """Return the parameters that changed during the recording: node name -> parameter name -> last value as text."""
    about = bag.topics.get(_EVENTS)
    changes: dict[str, dict[str, str]] = {}
    if about is None or about.type_name != _EVENT_TYPE:
        return changes
    for _, name, _, data in bag.messages([_EVENTS]):
        event = bag.decode(name, data)
        table = changes.setdefault(event.node.rsplit("/", 1)[-1], {})
        for parameter in event.changed_parameters:
            value = getattr(parameter.value, _FIELDS[parameter.value.type])
            table[parameter.name] = str(value.tolist() if hasattr(value, "tolist") else value)
    return changes


def kept(usual: S, given: Mapping[str, Any], remarks: list[str], source: str) -> S:
    """
    Return settings with the given values; a setting whose value is not allowed stays as in `usual`, with a remark.

    given: dotted name -> value. remarks: receives a sentence for each value that is not used. source: origin of the
    values, in words.
    """
    try:
        return settings.changed(usual, given)
    except settings.SettingsError:
        made = usual
        for name, value in given.items():
            try:
                made = settings.changed(made, {name: value})
            except settings.SettingsError as error:
                remarks.append(f"{name} = {value} of the {source} is not used: {error}")
        return made


def _values(table: Mapping[str, str], usual: Mapping[str, Any]) -> dict[str, Any]:
    """
    Return the values of parameters by name, parsed from their texts.

    Names without a dot are left out: every ROS node has these parameters. usual: default value by name.
    """
    return {name: _value(text, usual.get(name)) for name, text in table.items() if "." in name}


def _value(text: str, usual: Any) -> Any:
    """Return the value of a parameter from its text; the text itself if `usual` is a text or parsing fails."""
    if isinstance(usual, str):
        return text
    if text in ("inf", "-inf", "nan"):
        return float(text)
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text
