# SPDX-License-Identifier: Apache-2.0
"""External field from the observatory file in the settings, which is read again whenever the file has changed."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from mwd_estimation.core.reference_field import Reference
from mwd_estimation.pipeline.external_field import ObservatoryRecord, read_iaga2002, with_external
from mwd_estimation.settings.place import Place
from mwd_sensors.core import budgets
from mwd_sensors.core.foreign_text import contents_hidden
from mwd_sensors.core.input_files import read_file
from mwd_sensors.core.settings import SettingsError


class Observatory:
    """
    External field at the time of each survey.

    place : Place
        If its `observatory_file` is empty, every reference is returned unchanged.

    Raises
    ------
    SettingsError
        If the file cannot be read, or is not an IAGA-2002 record.
    """

    def __init__(self, place: Place) -> None:
        self._place = place
        self._read_at: tuple[int, int] | None = None
        self._record: ObservatoryRecord | None = None
        if place.observatory_file:
            try:
                with contents_hidden(place.observatory_file):
                    self._refresh()
            except SettingsError as error:
                raise SettingsError(f"place.observatory_file: {error}; expected a file of IAGA-2002") from None

    def at(self, reference: Reference | None, stamp_ns: int | None) -> Reference | None:
        """
        Return the reference with the external field at a time, UTC, ns; None: unknown time.

        At an unknown time, or where the record has no data, only the name of the observatory is added. Without a
        record, or if the reference has no field or no declination, the reference is returned unchanged.
        """
        if self._record is None or reference is None or not reference.has_field or reference.declination is None:
            return reference
        try:
            self._refresh()
        except (OSError, ValueError):
            # The file is being written: keep the last record; `survey.verdict` reports a time after its end.
            self._read_at = None
        found = None if stamp_ns is None else self._record.disturbance(stamp_ns)
        asked = dataclasses.replace(reference, observatory=self._record.station)
        if found is None:
            return asked
        return with_external(asked, found, self._place.observatory_share, f"observatory {self._record.station}")

    def _refresh(self) -> None:
        path = Path(self._place.observatory_file)
        status = path.stat()
        now = (status.st_mtime_ns, status.st_size)
        if now != self._read_at:
            self._record = read_iaga2002(read_file(path, budgets.OBSERVATORY).decode(errors="replace"), path.name)
            self._read_at = now
