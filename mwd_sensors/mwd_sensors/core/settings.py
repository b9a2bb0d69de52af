# SPDX-License-Identifier: Apache-2.0
"""
Settings: frozen dataclasses whose fields carry default, unit, bounds and meaning.

The same declaration serves node parameters, configuration files and scenarios, with the same checks and messages. A
wrong key is an error that suggests the nearest valid keys. A wrong value is an error that states value, unit and bound.
"""

from __future__ import annotations

import dataclasses
import difflib
import enum
import functools
import math
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from mwd_sensors.core.hidden_characters import hidden

T = TypeVar("T")
#: A number of a record that may be unknown: NaN in the record, null in a file.
Number = typing.Annotated[float, "unknown"]

_MOST_NAMES = 12  # largest number of names that a message lists
# Types of the fields of a class; cached, because evaluating the annotations takes longer than checking the values.
_types: Callable[[Any], dict[str, Any]] = functools.cache(functools.partial(typing.get_type_hints, include_extras=True))
# Unit of a setting by the end of its name, longer ends first.
_UNITS = {
    "_kg_m3": "kg/m^3",
    "_deg_30m": "deg/30 m",
    "_deg_sqrt_h": "deg/sqrt(h)",
    "_deg_h_g": "deg/h/g",
    "_nt_per_c": "nT/degC",
    "_ug_per_c": "ug/degC",
    "_deg_h": "deg/h",
    "_deg_s": "deg/s",
    "_seconds": "s",
    "_mrad": "mrad",
    "_rpm": "r/min",
    "_lpm": "l/min",
    "_deg": "deg",
    "_uwb": "uWb",
    "_ppm": "ppm",
    "_bar": "bar",
    "_hz": "Hz",
    "_km": "km",
    "_kn": "kN",
    "_mm": "mm",
    "_nm": "N m",
    "_nt": "nT",
    "_ug": "ug",
    "_ut": "uT",
    "_a": "A",
    "_c": "degC",
    "_g": "g",
    "_h": "h",
    "_m": "m",
    "_s": "s",
    "_v": "V",
}
_SCALARS = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}


class SettingsError(ValueError):
    """A setting does not exist or its value is not allowed; the message names the setting and what is allowed."""


@dataclasses.dataclass(frozen=True)
class Rule:
    """Rule for one field: meaning, unit, inclusive bounds, choices, and the mark `expert` of `setting`."""

    doc: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    expert: bool = False

    def text(self) -> str:
        """Return meaning, unit and bounds on one line."""
        parts = [self.doc]
        if self.unit:
            parts.append(f"[{self.unit}]")
        if self.low is not None or self.high is not None:
            parts.append(f"({_bound(self.low)} to {_bound(self.high)})")
        if self.choices:
            parts.append("one of " + ", ".join(self.choices))
        return " ".join(parts)


def setting(
    default: Any = dataclasses.MISSING,
    doc: str = "",
    *,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    expert: bool = False,
) -> Any:
    """
    Declare a field of a settings dataclass.

    Parameters
    ----------
    default : any, optional
        Default value; without it the field must be given. A list, dict or set is copied for each instance.
    doc, unit : str
        Meaning in one sentence, and unit as people write it ("m/s^2", "deg"). The unit is left out if the name of the
        field says it (`unit_of`).
    low, high : float, optional
        Inclusive bounds; for a list they apply to every element.
    choices : tuple of str
        Allowed words.
    expert : bool
        True if the default suits nearly all users; the reference lists these fields last.
    """
    metadata = {"rule": Rule(doc, unit, low, high, choices, expert)}
    if isinstance(default, (list, dict, set)):
        return dataclasses.field(default_factory=lambda: type(default)(default), metadata=metadata)
    if isinstance(default, type) and dataclasses.is_dataclass(default):
        return dataclasses.field(default_factory=default, metadata=metadata)
    if default is dataclasses.MISSING:
        return dataclasses.field(metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def unit_of(name: str) -> str:
    """Return the unit at the end of the name of a setting, such as "m" for `look_ahead_m`; empty if there is none."""
    return next((unit for end, unit in _UNITS.items() if name.endswith(end)), "")


@functools.cache
def rule_of(field: dataclasses.Field[Any]) -> Rule:
    """Return the rule of a dataclass field; a field declared without `setting` allows any value of its type."""
    rule = field.metadata.get("rule")
    if not isinstance(rule, Rule):
        return Rule("")
    return dataclasses.replace(rule, unit=rule.unit or unit_of(field.name))


def from_mapping(cls: type[T], given: Mapping[str, Any], path: str = "") -> T:
    """
    Return a settings object from a nested mapping (YAML, JSON, parameters); path precedes the names in messages.

    Raises
    ------
    SettingsError
        A key is unknown (the message suggests near ones) or missing, a value has a wrong type, is out of bounds, is not
        finite or not among the choices, a text is too long or has an invisible character, or the class refuses the
        values.
    """
    if not isinstance(given, Mapping):
        raise SettingsError(f"{path or cls.__name__}: expected a table of settings, got {given!r}")
    hints = _types(cls)
    fields = {f.name: f for f in dataclasses.fields(cls) if f.init}  # type: ignore[arg-type]
    for key in given:
        if key not in fields:
            raise SettingsError(unknown_key(str(key), fields, path))
    values = {}
    for name, field in fields.items():
        where = f"{path}.{name}" if path else name
        if name in given:
            values[name] = checked(given[name], hints[name], rule_of(field), where)
        elif field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            raise SettingsError(f"{where}: must be given: {rule_of(field).text()}")
    try:
        return cls(**values)
    except SettingsError:
        raise
    except ValueError as error:
        raise SettingsError(f"{path}: {error}" if path else str(error)) from error


def to_mapping(settings: Any) -> dict[str, Any]:
    """Return the settings as a nested dict of plain values, ready for YAML or JSON; an unknown number is None."""
    return {f.name: _plain(getattr(settings, f.name)) for f in dataclasses.fields(settings) if f.init}


def flat(settings: Any, prefix: str = "") -> dict[str, tuple[Any, Rule]]:
    """
    Return the dotted name of every field with its value and rule, in order of declaration: the parameters of a node.

    prefix is put in front of each name.
    """
    leaves: dict[str, tuple[Any, Rule]] = {}
    for field in dataclasses.fields(settings):
        name, value = prefix + field.name, getattr(settings, field.name)
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            leaves.update(flat(value, name + "."))
        else:
            leaves[name] = (value, rule_of(field))
    return leaves


def values(settings: Any) -> dict[str, Any]:
    """Return the dotted name and value of every field, in order of declaration."""
    return {name: value for name, (value, _) in flat(settings).items()}


def changed(settings: T, changes: Mapping[str, Any]) -> T:
    """
    Return a copy of the settings with some values changed.

    changes: dotted name -> new value.

    Raises
    ------
    SettingsError
        The errors of `from_mapping`; the original is unchanged.
    """
    nested = to_mapping(settings)
    known = flat(settings)
    for name, value in changes.items():
        if name not in known:
            raise SettingsError(unknown_key(name, known, ""))
        *parents, leaf = name.split(".")
        table = nested
        for parent in parents:
            table = table[parent]
        table[leaf] = value
    return from_mapping(type(settings), nested)


def unknown_key(key: str, known: Mapping[str, Any] | typing.Iterable[str], path: str) -> str:
    """Return the message for a key that does not exist, with similar names, or else with the names that exist."""
    names, where = list(known), f"{path}.{key}" if path else key
    near = difflib.get_close_matches(key, names, n=3, cutoff=0.5)
    # A setting that moved to another block usually keeps the last part of its name.
    near += [name for name in names if "." in key and name.endswith(key[key.rindex(".") :]) and name not in near][:3]
    hint = f"did you mean {' or '.join(near)}?" if near else _all_of(names)
    return f"{where}: no such setting; {hint}"


def _all_of(names: Sequence[str]) -> str:
    """Return the names as text if they are few or not in blocks, otherwise the blocks (first parts of the names)."""
    if len(names) <= _MOST_NAMES or not any("." in name for name in names):
        return f"known: {', '.join(names)}"
    blocks = dict.fromkeys(name.partition(".")[0] for name in names)
    return f"settings begin with {', '.join(blocks)}"


def checked(value: Any, kind: Any, rule: Rule, where: str) -> Any:
    """
    Return a value converted to its declared type `kind`; where is the name of the setting in messages.

    Raises
    ------
    SettingsError
        The value does not have the type, or does not comply with the rule (bounds, choices).
    """
    origin = typing.get_origin(kind)
    if origin is typing.Annotated:
        unknown = value is None or (isinstance(value, float) and math.isnan(value))
        return math.nan if unknown else checked(value, float, rule, where)
    if origin in (typing.Union, types.UnionType):
        return _checked_union(value, kind, rule, where)
    if origin in (list, tuple):
        return _checked_sequence(value, kind, rule, where)
    if origin is dict:
        if not isinstance(value, Mapping):
            raise SettingsError(f"{where}: expected a table, got {value!r}")
        item = typing.get_args(kind)[1]
        return {str(k): checked(v, item, rule, f"{where}.{k}") for k, v in value.items()}
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        return value if isinstance(value, kind) else from_mapping(kind, value, where)
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        return _checked_word(value, kind, rule, where)
    return _checked_scalar(value, kind, rule, where)


def _checked_union(value: Any, kind: Any, rule: Rule, where: str) -> Any:
    options = typing.get_args(kind)
    # A ROS parameter of type double has no empty value: NaN means "not given".
    if type(None) in options and (value is None or (isinstance(value, float) and math.isnan(value))):
        return None
    errors = []
    for option in options:
        if option is type(None):
            continue
        try:
            return checked(value, option, rule, where)
        except SettingsError as error:
            errors.append(str(error))
    raise SettingsError("; or ".join(errors))


def _checked_sequence(value: Any, kind: Any, rule: Rule, where: str) -> Any:
    if isinstance(value, (str, bytes)) or not hasattr(value, "__iter__"):
        raise SettingsError(f"{where}: expected a list, got {value!r}")
    items, args = list(value), typing.get_args(kind)
    if typing.get_origin(kind) is list:
        return [checked(v, args[0], rule, f"{where}[{k}]") for k, v in enumerate(items)]
    if len(args) == 2 and args[1] is Ellipsis:
        return tuple(checked(v, args[0], rule, f"{where}[{k}]") for k, v in enumerate(items))
    if len(items) != len(args):
        raise SettingsError(f"{where}: expected {len(args)} values, got {len(items)}: {value!r}")
    return tuple(checked(v, a, rule, f"{where}[{k}]") for k, (v, a) in enumerate(zip(items, args, strict=True)))


def _checked_word(value: Any, kind: type[enum.Enum], rule: Rule, where: str) -> enum.Enum:
    """Return the member of the enumeration `kind` that has this value; raise SettingsError if there is none."""
    try:
        return kind(value)
    except ValueError:
        known = ", ".join(str(one.value) for one in kind)
        raise SettingsError(f"{where}: {value!r} is not one of {known}; {rule.text()}") from None


_LONGEST_TEXT = 4096  # largest number of characters of a text: the longest path of Linux


def _short(value: Any) -> str:
    """Return a value as text for a message, shortened to `_MOST_QUOTED` characters."""
    words = repr(value)
    return words if len(words) <= _MOST_QUOTED else f"{words[:_MOST_QUOTED]}..."


_MOST_QUOTED = 100


def _checked_scalar(value: Any, kind: Any, rule: Rule, where: str) -> Any:
    if kind is Any:
        return value
    if kind is float and value is None:
        value = math.nan
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if kind is str and isinstance(value, bool):
        # YAML reads yes, no, on and off as booleans; if one of these words is a choice, the word was meant.
        words = ("true", "yes", "on") if value else ("false", "no", "off")
        value = next((word for word in words if word in (rule.choices or ())), value)
    if type(value) is not kind:
        hint = " (write it with a decimal point)" if kind is float and isinstance(value, str) else ""
        raise SettingsError(f"{where}: expected {_SCALARS.get(kind, kind)}{hint}, got {_short(value)}; {rule.text()}")
    if isinstance(value, str) and len(value) > _LONGEST_TEXT:
        why = f"has {len(value)} characters, more than {_LONGEST_TEXT}"
        raise SettingsError(f"{where}: {_short(value)} {why}; {rule.text()}")
    if isinstance(value, str) and (code := next(hidden(value), "")):
        raise SettingsError(f"{where}: {_short(value)} has an invisible character ({code}); {rule.text()}")
    if isinstance(value, float) and not math.isfinite(value):
        raise SettingsError(f"{where}: must be finite, got {value!r}; {rule.text()}")
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        unit = f" {rule.unit}" if rule.unit else ""
        if rule.low is not None and value < rule.low:
            raise SettingsError(
                f"{where}: {_figure(value)}{unit} is below the lowest allowed, {_figure(rule.low)}{unit}; {rule.doc}"
            )
        if rule.high is not None and value > rule.high:
            raise SettingsError(
                f"{where}: {_figure(value)}{unit} is above the highest allowed, {_figure(rule.high)}{unit}; {rule.doc}"
            )
    if rule.choices and isinstance(value, str) and value not in rule.choices:
        near = difflib.get_close_matches(value, rule.choices, n=1, cutoff=0.5)
        hint = f"did you mean {near[0]}? " if near else ""
        raise SettingsError(f"{where}: {value!r} is not allowed; {hint}one of {', '.join(filter(None, rule.choices))}")
    return value


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return to_mapping(value)
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, float) and math.isnan(value):
        return None
    return value.value if isinstance(value, enum.Enum) else value


def _bound(value: float | None) -> str:
    return "any" if value is None else _figure(value)


def _figure(value: float) -> str:
    """Return a number as text: all digits of a whole number, else six significant digits."""
    return f"{value:.0f}" if float(value).is_integer() and abs(value) < 1e15 else f"{value:g}"
