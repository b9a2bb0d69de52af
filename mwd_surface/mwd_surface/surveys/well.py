# SPDX-License-Identifier: Apache-2.0
"""The well of a survey list: names, place and datums, as printed at the head of every report."""

from __future__ import annotations

import dataclasses
import math

from mwd_sensors.core.angle_convention import CONVENTIONS, AngleConvention
from mwd_sensors.core.settings import setting
from mwd_surface.signals.table import Display
from mwd_surface.signals.units import FIELD, METRIC

NORTHS = ("magnetic", "true", "grid")


@dataclasses.dataclass(frozen=True)
class Mine:
    """Facts of a hole drilled in a mine, as the report of the hole prints them."""

    name: str = setting("", "Name of the mine.")
    working_face: str = setting("", "Working face from which the hole is drilled.")
    drill_site: str = setting("", "Drill site, such as the number of the niche or chamber.")
    probe: str = setting("", "Type of the probe and its serial number.")
    calibration_date: str = setting("", "Date of the probe's calibration.")
    opening_x: float | None = setting(
        None, "Mine coordinate x (north) of the hole's opening. nan if not given.", unit="m"
    )
    opening_y: float | None = setting(
        None, "Mine coordinate y (east) of the hole's opening. nan if not given.", unit="m"
    )
    opening_z: float | None = setting(
        None, "Mine coordinate z (height, positive up) of the hole's opening. nan if not given.", unit="m"
    )
    closure_x: float | None = setting(
        None,
        "Mine coordinate x (north) of a surveyed point of the hole, such as its breakthrough. The path is compared "
        "with this point. nan if there is none.",
        unit="m",
    )
    closure_y: float | None = setting(
        None, "Mine coordinate y (east) of the surveyed point. nan if there is none.", unit="m"
    )
    closure_z: float | None = setting(
        None, "Mine coordinate z (height, positive up) of the surveyed point. nan if there is none.", unit="m"
    )
    closure_depth: float | None = setting(
        None,
        "Measured depth of the hole at the surveyed point. nan: the point is at the end of the hole.",
        unit="m",
        low=0.0,
    )
    closure_sigma: float = setting(
        0.05,
        "1 sigma of each coordinate of the surveyed point. Raising it accepts a larger distance between point and "
        "path.",
        unit="m",
        low=1e-3,
        high=100.0,
    )
    closure_leg: str = setting(
        "", "Leg that reaches the surveyed point (closure_x, closure_y, closure_z). Empty: the present leg."
    )

    @property
    def closure_point(self) -> tuple[float, float, float]:
        """Mine coordinates of the surveyed point, m: x north, y east, z up; NaN for an axis that is not given."""
        x, y, z = (math.nan if one is None else one for one in (self.closure_x, self.closure_y, self.closure_z))
        return x, y, z

    @property
    def opening(self) -> tuple[float, float, float]:
        """Mine coordinates of the opening, m: x north, y east, z up; NaN for an axis that is not given."""
        x, y, z = (math.nan if one is None else one for one in (self.opening_x, self.opening_y, self.opening_z))
        return x, y, z


@dataclasses.dataclass(frozen=True)
class Well:
    """Description of the well for lists, exports and reports; angles are in degrees because people set them."""

    name: str = setting("well", "Name of the well.")
    wellbore: str = setting("", "Name of the wellbore. Empty: the name of the well.")
    company: str = setting("", "Name of the operating company.")
    field: str = setting("", "Name of the oil or gas field, or of the site.")
    rig: str = setting("", "Name of the drilling rig.")
    service_company: str = setting("", "Name of the company that runs the surveys.")
    job_number: str = setting("", "Number of the job, printed in reports.")
    revision: str = setting("", "Revision of the survey report, such as 2 or B, printed in its head.")
    logo: str = setting("", "Picture for the head of reports, a PNG or JPEG file.")
    units: str = setting(
        METRIC,
        "Units of the report and of exports (csv, las, witsml): metric (m, deg/30 m, degC) or field (ft, deg/100 "
        "ft, degF).",
        choices=(METRIC, FIELD),
    )
    language: str = setting("en", "Language of the report: en, zh_CN, or the code of another catalogue.")
    latitude_deg: float | None = setting(
        None, "Latitude of the wellhead, WGS 84, north positive. nan if not given.", low=-90.0, high=90.0
    )
    longitude_deg: float | None = setting(
        None, "Longitude of the wellhead, WGS 84, east positive. nan if not given.", low=-180.0, high=360.0
    )
    grid: str = setting(
        "",
        "Map grid of reports: utm (the zone of the wellhead) or an EPSG code such as EPSG:23031. Empty: no map "
        "coordinates.",
    )
    depth_datum: str = setting(
        "", "Name of the datum of measured and vertical depth, such as RKB, printed in reports. Empty if not given."
    )
    datum_elevation: float | None = setting(
        None, "Height of the depth datum above mean sea level. nan if not given.", unit="m"
    )
    north_reference: str = setting(
        "true", "North reference of azimuths and map axes. It must be the same as that of the plan.", choices=NORTHS
    )
    convention: str = setting(
        AngleConvention.INCLINATION.value,
        "Vertical angle that people of this well read and write: inclination (from the vertical), dip_up (from the "
        "horizontal, positive where the hole rises) or dip_down (positive where it falls). The page, lists, "
        "reports, the plan and exports for people follow it; settings and protocols whose name contains "
        "inclination do not.",
        choices=CONVENTIONS,
    )
    mine: Mine = setting(Mine, "Facts of a hole drilled in a mine.")
    section_azimuth_deg: float | None = setting(
        None,
        "Azimuth of the vertical section, from the north reference. nan: along the plan or, without a plan, "
        "towards the last survey in use; the section then turns slightly with each survey.",
        low=0.0,
        high=360.0,
    )
    sensor_to_bit: float | None = setting(
        None,
        "Distance along the hole from the directional sensor to the bit. The depth of a survey is the bit depth minus "
        "this distance. nan if not given: surveys then get the bit depth.",
        unit="m",
        low=0.0,
    )
    geomagnetic_model: str = setting(
        "", "Source of the reference field, printed in reports. Empty: the source that each survey names."
    )
    error_model: str = setting(
        "MWD+SRGM",
        "ISCWSA / OWSG tool code from which the position uncertainty of the whole well is computed. Empty: none is "
        "computed.",
    )
    programme: str = setting(
        "",
        "YAML file of the survey programme (tool codes by interval, and the tie-on). If given, it replaces "
        "error_model.",
    )
    offset_wells: str = setting(
        "",
        "YAML file of the offset wells: their lists, wellheads and hole sizes, and the separation rule.",
    )

    @property
    def angles(self) -> AngleConvention:
        """Convention of the vertical angle for people."""
        return AngleConvention(self.convention)

    @property
    def display(self) -> Display:
        """Units and angle convention of lists, exports and report."""
        return Display(self.units, self.angles)

    @property
    def sensor_offset(self) -> float:
        """Distance from sensor to bit used to compute depths, m; 0 if it is not given."""
        return self.sensor_to_bit or 0.0

    @property
    def wellbore_name(self) -> str:
        """Name of the wellbore; the name of the well if the wellbore has none."""
        return self.wellbore or self.name
