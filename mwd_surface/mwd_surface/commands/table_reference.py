# SPDX-License-Identifier: Apache-2.0
"""Reference field for a table or list, from the options of a command; an option that has no use is refused."""

from __future__ import annotations

import dataclasses
import datetime as dt
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mwd_surface.commands.shared_options import estimator_settings, field_figures, place_changes

if TYPE_CHECKING:
    from mwd_estimation.core.reference_field import Reference
    from mwd_estimation.settings.estimator import EstimatorSettings
    from mwd_surface.commands.shared_options import GivenPlace

# Settings of the place that have no use with a table, by source of the field.
_BESIDE_A_MODEL = ("total_nt", "dip_deg", "declination_deg", "convergence_deg")
_UNUSED = {
    "fixed": ("grid", "date"),
    "model": _BESIDE_A_MODEL,
    "igrf": _BESIDE_A_MODEL,
}
# Settings that are also used with a field from columns of the table.
_ANY_FIELD = ("field", "observatory_file", "observatory_share")


@dataclasses.dataclass(frozen=True)
class GivenReference:
    """Single values of the reference that the user gives, in deg and m/s^2; None if not given."""

    declination: float | None = None
    convergence: float | None = None
    gravity: float | None = None

    @classmethod
    def of(
        cls, field: str | None, declination: float | None, convergence: float | None, gravity: float | None = None
    ) -> GivenReference:
        """
        Return the values of options; the declination in --field is used if --declination is not given.

        Raise ValueError if --field cannot be read.
        """
        if declination is None and field is not None:
            declination = field_figures(field)[2]
        return cls(declination, convergence, gravity)

    def figures(self) -> dict[str, Any]:
        """Return the given values as fields of `Reference`, by name, in SI."""
        named = {
            name: math.radians(value)
            for name, value in (("declination", self.declination), ("convergence", self.convergence))
            if value is not None
        }
        return named if self.gravity is None else {**named, "gravity": self.gravity}


def table_settings(config: Path | None, changes: Sequence[str] | None, given: GivenPlace) -> EstimatorSettings:
    """
    Return settings for a table from the options of a command.

    Raises
    ------
    ValueError
        Options contradict each other, or a setting of the place would not be used.
    """
    from mwd_estimation.settings.place import Place

    named = place_changes(*given)
    # The rows of a table may contain a declination that the options do not give.
    named.pop("survey.north", None)
    settings = estimator_settings(config, named, changes)
    place, usual = settings.place, Place()
    names = _UNUSED.get(place.field) or tuple(f.name for f in dataclasses.fields(place) if f.name not in _ANY_FIELD)
    for name in names:
        # Compare texts, because an unknown value is NaN, which is not equal to itself.
        if repr(getattr(place, name)) != repr(getattr(usual, name)):
            why = {
                "none": "needs a place (--lat, --lon) or a field (--field)",
                "fixed": "is not used for a table if a field is given",
                "model": "is not used for a table with a model; use --declination, --convergence, --gravity",
            }["model" if place.model else place.field]
            raise ValueError(f"place.{name}: {why}")
    return settings


class RowReference:
    """
    Reference of each row at its time, with the external field of an observatory and the sigmas of the tool code.

    Raise ValueError if the observatory's file cannot be used.
    """

    def __init__(self, settings: EstimatorSettings) -> None:
        from mwd_estimation.pipeline.external_field import Observatory

        self._settings, self._observatory = settings, Observatory(settings.place)

    def at(self, reference: Reference, time: str) -> Reference:
        """Return the reference of a row at its time, given as text; raise ValueError if the tool code does not fit."""
        from mwd_estimation.settings import derivation

        coded, moment = derivation.with_code(self._settings, reference), _moment(time)
        stamp_ns = None if moment is None else round(moment.timestamp() * 1e9)
        return self._observatory.at(coded, stamp_ns) or coded


def table_reference(
    settings: EstimatorSettings, known: GivenReference, times: Iterable[str] = (), otherwise: str = ""
) -> tuple[Reference | None, tuple[str, ...]]:
    """
    Return the reference from options and settings, and remarks for the user; None: no reference is given.

    times: times of the stations, as text; the first valid time gives the day of the field if no date is set. otherwise:
    day to use, with a remark, if there is neither a date nor a time; "": a missing day is an error.

    Raises
    ------
    ValueError
        A field model has no day, or the day is outside the range of every model.
    """
    from mwd_estimation.core.reference_field import Reference
    from mwd_estimation.settings.place import reference_of
    from mwd_surface.surveys.recorded_settings import with_a_model

    figures = known.figures()
    if settings.place.field == "none":
        return (Reference(**figures, source="given") if figures else None), ()
    stamp_ns = 0
    remarks = []
    if settings.place.model and not settings.place.date:
        day = next(filter(None, map(_moment, times)), None)
        if day is None and otherwise:
            day = _moment(otherwise)
            remarks.append(
                f"no day is given: the field model is used for {otherwise}; the field changes slowly, so set the day "
                "with --date"
            )
        if day is None:
            raise ValueError("--lat and --lon: the table has no times; give the day of the field with --date")
        stamp_ns = round(day.timestamp() * 1e9)
    settings, remark = with_a_model(settings, stamp_ns)
    remarks += [remark] if remark else []
    reference = reference_of(settings.place, stamp_ns)
    if reference is None:
        return None, tuple(remarks)
    return dataclasses.replace(reference, **figures), tuple(remarks)


def _moment(text: str) -> dt.datetime | None:
    from mwd_sensors.core import utc

    try:
        return utc.moment(text)
    except ValueError:
        return None
