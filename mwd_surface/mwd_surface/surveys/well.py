# SPDX-License-Identifier: Apache-2.0
"""The well a survey list belongs to: names, place and datums, as they stand at the head of every report."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting

NORTHS = ("magnetic", "true", "grid")


@dataclasses.dataclass(frozen=True)
class Well:
    """What every list, export and report says about the well; settings of people, so angles are in degrees."""

    name: str = setting("well", "name of the well")
    wellbore: str = setting("", "name of the wellbore; empty: the name of the well")
    company: str = setting("", "operating company")
    field: str = setting("", "oil or gas field, or site")
    rig: str = setting("", "drilling rig")
    service_company: str = setting("", "company that runs the surveys")
    latitude_deg: float | None = setting(
        None, "WGS84 latitude of the wellhead; nan: not given", unit="deg", low=-90.0, high=90.0
    )
    longitude_deg: float | None = setting(
        None, "WGS84 longitude of the wellhead; nan: not given", unit="deg", low=-180.0, high=360.0
    )
    grid: str = setting(
        "", "map grid of reports: utm (the zone of the wellhead) or an EPSG code such as EPSG:23031; empty: none"
    )
    depth_datum: str = setting(
        "", "datum of measured and vertical depth, as printed in reports, such as RKB; empty: not given"
    )
    datum_elevation: float | None = setting(
        None, "height of the depth datum above mean sea level; nan: not given", unit="m"
    )
    north_reference: str = setting(
        "true", "north reference of azimuths and map axes; must be that of the plan", choices=NORTHS
    )
    section_azimuth_deg: float | None = setting(
        None,
        "azimuth of the vertical section, from the same north; nan: along the plan or, without one, towards the last "
        "survey in use, so that the section turns a little with each survey",
        unit="deg",
        low=0.0,
        high=360.0,
    )
    sensor_to_bit: float | None = setting(
        None,
        "distance from the directional sensor to the bit; a survey is this much shallower than the bit. nan: not "
        "given, surveys then get the depth of the bit",
        unit="m",
        low=0.0,
    )
    geomagnetic_model: str = setting("", "source of the reference field, as printed; empty: the one each survey names")
    error_model: str = setting(
        "MWD+SRGM", "ISCWSA / OWSG tool code of the position covariance of the whole well; empty: none is computed"
    )
    programme: str = setting(
        "", "File of the survey programme, YAML: tool codes by interval and the tie-on; it replaces error_model"
    )
    offset_wells: str = setting(
        "",
        "File of the offset wells, YAML: their lists, wellheads and hole sizes, and the separation rule",
    )

    @property
    def sensor_offset(self) -> float:
        """Distance from the sensor to the bit that depths are computed with, m: 0 where it is not given."""
        return self.sensor_to_bit or 0.0

    @property
    def wellbore_name(self) -> str:
        """Name of the wellbore, or of the well where the wellbore has none."""
        return self.wellbore or self.name
