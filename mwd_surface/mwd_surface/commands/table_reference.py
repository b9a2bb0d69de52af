"""Reference field of a table or list, from the options of a command: all of them count, or are refused."""

from __future__ import annotations

import dataclasses
import datetime as dt
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mwd_estimation.core.reference_field import Reference
    from mwd_estimation.pipeline import EstimatorSettings

# Settings of the place that have no meaning beside each source of the field.
_MEANINGLESS = {
    "fixed": ("model", "grid", "date"),
    "model": ("total_nt", "dip_deg", "declination_deg", "convergence_deg", "gravity_mps2"),
}


@dataclasses.dataclass(frozen=True)
class Known:
    """
    Figures of the reference that the caller gives: deg and m/s^2, None where not given.

    field: strength in nT, dip and perhaps declination in deg, as `--field` takes them.
    """

    field: str | None = None
    declination: float | None = None
    convergence: float | None = None
    gravity: float | None = None

    def figures(self) -> dict[str, Any]:
        """
        Fields of `Reference` by name.

        Raises
        ------
        ValueError
            The field is not two or three numbers.
        """
        from mwd_surface.commands.reference_options import field_figures

        declination = self.declination
        named: dict[str, Any] = {}
        if self.field is not None:
            total, dip, given = field_figures(self.field)
            named = {"total": total * 1e-9, "dip": math.radians(dip)}
            declination = given if declination is None else declination
        for name, value in (("declination", declination), ("convergence", self.convergence)):
            if value is not None:
                named[name] = math.radians(value)
        if self.gravity is not None:
            named["gravity"] = self.gravity
        return named


def table_settings(
    config: Path | None,
    changes: Sequence[str] | None,
    lat: float | None,
    lon: float | None,
    date: str | None,
) -> EstimatorSettings:
    """
    Settings for a table by the options of a command.

    Raises
    ------
    ValueError
        Options that contradict each other, or a setting of the place that would not be used.
    """
    from mwd_estimation.settings import Place
    from mwd_surface.commands.reference_options import estimator_settings, place_changes

    settings = estimator_settings(config, place_changes(lat, lon, date, None), changes)
    place, usual = settings.place, Place()
    names = _MEANINGLESS.get(place.field) or tuple(f.name for f in dataclasses.fields(place) if f.name != "field")
    for name in names:
        # As text: a value that is not known is nan, which is not equal to itself.
        if repr(getattr(place, name)) != repr(getattr(usual, name)):
            why = {
                "none": "needs a place (--lat, --lon) or a field (--field)",
                "fixed": "has no meaning beside a field that is given",
                "model": "is overruled by the model; use --declination, --convergence or --gravity",
            }[place.field]
            raise ValueError(f"place.{name}: {why}")
    return settings


def table_reference(
    settings: EstimatorSettings, known: Known, times: Iterable[str] = ()
) -> tuple[Reference | None, tuple[str, ...]]:
    """
    The reference that options and settings give, and what people must know about it; None where they give nothing.

    times: of the stations as written; the first that is a time gives the day of the field where no date is set.

    Raises
    ------
    ValueError
        A model without a day, or a day outside every model.
    """
    from mwd_estimation.core.reference_field import Reference
    from mwd_estimation.pipeline import reference_of
    from mwd_surface.commands.reference_options import with_a_model

    figures = known.figures()
    if known.field is not None and settings.place.field != "none":
        raise ValueError("--field: give it, or a place; a field that is known needs no model")
    if settings.place.field == "none":
        return (Reference(**figures, source="given") if figures else None), ()
    stamp_ns = 0
    remarks = []
    if settings.place.field == "model" and not settings.place.date:
        day = next(filter(None, map(_moment, times)), None)
        if day is None:
            raise ValueError("--lat and --lon: the table has no time, give the day of the field with --date")
        stamp_ns = round(day.timestamp() * 1e9)
    settings, remark = with_a_model(settings, stamp_ns)
    remarks += [remark] if remark else []
    reference = reference_of(settings.place, stamp_ns)
    return (None if reference is None else dataclasses.replace(reference, **figures)), tuple(remarks)


def _moment(text: str) -> dt.datetime | None:
    try:
        moment = dt.datetime.fromisoformat(text.strip())
    except ValueError:
        return None
    return moment.replace(tzinfo=moment.tzinfo or dt.UTC)
