# SPDX-License-Identifier: Apache-2.0
"""
Reasons as data: why a survey, an azimuth or a sensor is doubted, refused or reported.

Code that decides an azimuth, its sigma or a verdict reads the code and the numbers of a reason, never its sentence.
`core.reason_text` turns a reason into a sentence when a message, a table or a log is written.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum, unique

from mwd_estimation.core.sensor_fault import SensorFault


@unique
class ReasonCode(StrEnum):
    """Code of a reason; `reason_text.WORDS` shows which numbers and names belong to each code."""

    # Totals against the reference (survey.totals).
    GRAVITY_OFF = "gravity_off"
    GRAVITY_OFF_STANDARD = "gravity_off_standard"
    FIELD_OFF = "field_off"
    DIP_OFF = "dip_off"
    TOTALS_OFF_TOGETHER = "totals_off_together"
    WITHIN_LIMITS = "within_limits"
    GRAVITY_WITHIN = "gravity_within"
    GRAVITY_WITHIN_STANDARD = "gravity_within_standard"
    FIELD_WITHIN = "field_within"
    DIP_WITHIN = "dip_within"
    GRAVITY_NOT_EARTH = "gravity_not_earth"
    GRAVITY_IN_G = "gravity_in_g"
    FIELD_NOT_EARTH = "field_not_earth"
    FIELD_IN_OTHER_UNIT = "field_in_other_unit"
    DIP_SIGN = "dip_sign"

    # Readings and north of one station (survey.measurement).
    NO_ACCELEROMETER = "no_accelerometer"
    NO_MAGNETOMETER = "no_magnetometer"
    NO_NUMBER = "no_number"
    TABLE_UNIT = "table_unit"
    DEAD_AXIS = "dead_axis"
    WIRING = "wiring"
    NO_HORIZONTAL_FIELD = "no_horizontal_field"
    INCLINATION_ONLY = "inclination_only"
    NORTH_UNKNOWN = "north_unknown"
    NO_REFERENCE_FIELD = "no_reference_field"
    STRING_ROTATED = "string_rotated"
    SAG_CORRECTED = "sag_corrected"

    # External field of an observatory (pipeline.external_field).
    MAGNETIC_STORM = "magnetic_storm"
    EXTERNAL_FIELD_UNKNOWN = "external_field_unknown"

    # The azimuth from its posterior (survey.verdict), and the single-station correction (survey.measurement).
    AZIMUTH_NOT_DETERMINED = "azimuth_not_determined"
    AZIMUTHS_FIT = "azimuths_fit"
    EXTERNAL_FIELD = "external_field"
    FIELD_UNEXPLAINED = "field_unexplained"
    FIELD_OF_ANOTHER_PLACE = "field_of_another_place"
    REFERENCE_SLIP = "reference_slip"
    SENSOR_DEFECT = "sensor_defect"
    MOUNT_MAY_BE_TURNED = "mount_may_be_turned"
    READINGS_REPEATED = "readings_repeated"
    UNCERTAIN_STRING = "uncertain_string"
    UNCERTAIN_COLLAR = "uncertain_collar"
    UNCERTAIN_EXTERNAL = "uncertain_external"
    UNCERTAIN_REFERENCE = "uncertain_reference"
    UNCERTAIN_SENSOR = "uncertain_sensor"
    UNCERTAIN_FOR_ANY_TOOL = "uncertain_for_any_tool"
    GYRO_ONLY_UNCERTAIN = "gyro_only_uncertain"
    GYRO_NORTH_UNKNOWN = "gyro_north_unknown"
    GYRO_DISAGREES = "gyro_disagrees"
    PROPAGATED_DISAGREES = "propagated_disagrees"
    HYPOTHESES = "hypotheses"
    CORRECTION_NEAR_VERTICAL = "correction_near_vertical"
    CROSS_AXIAL_MISFIT = "cross_axial_misfit"
    TWO_AZIMUTHS_FIT_FIELD = "two_azimuths_fit_field"
    CORRECTION_UNCERTAIN = "correction_uncertain"

    # Multi-station analysis. All codes are in one enum, because recordings and tables store them by name.
    STATIONS_DO_NOT_FIT = "stations_do_not_fit"
    STATIONS_IMPROBABLE = "stations_improbable"
    MULTI_STATION_UNCERTAIN = "multi_station_uncertain"
    MULTI_STATION_NO_BETTER = "multi_station_no_better"

    # Faults of sensors during a survey (survey.fault_history) or of the precision unit (health.unit_comparison).
    SENSOR_FAULT = "sensor_fault"
    SENSOR_FAULT_ENDED = "sensor_fault_ended"
    SENSOR_SUSPECT = "sensor_suspect"
    PRECISION_UNIT_FAULT = "precision_unit_fault"
    PRECISION_UNIT_SUSPECT = "precision_unit_suspect"

    # Azimuth of the gyro (gyrocompass).
    LATITUDE_UNKNOWN = "latitude_unknown"
    LATITUDE_POLAR = "latitude_polar"
    NO_PRECISION_UNIT = "no_precision_unit"
    TOOL_NOT_STILL = "tool_not_still"
    SEEK_LEVELLING = "seek_levelling"
    SEEK_TOO_SHORT = "seek_too_short"
    SEEK_IMPROVES = "seek_improves"
    GYRO_CLIPPED = "gyro_clipped"
    TURNED_AT_REST = "turned_at_rest"
    TURNED_TOO_LITTLE = "turned_too_little"
    NO_SECOND_POSITION = "no_second_position"
    TOOL_MOVED = "tool_moved"
    HOLE_AXIS_MOVED = "hole_axis_moved"
    HOLE_AXIS_SWINGS = "hole_axis_swings"
    VERTICAL_HOLE = "vertical_hole"
    EAST_WEST_HOLE = "east_west_hole"
    GYRO_BIAS_EXCESSIVE = "gyro_bias_excessive"
    GYRO_SCALE_EXCESSIVE = "gyro_scale_excessive"
    GYRO_LEAK_EXCESSIVE = "gyro_leak_excessive"
    TWO_AZIMUTHS_FIT_GYRO = "two_azimuths_fit_gyro"
    LATITUDE_MISFIT = "latitude_misfit"
    LATITUDE_OTHER = "latitude_other"
    GYRO_BIAS_UNKNOWN = "gyro_bias_unknown"
    GYRO_BIAS_UNKNOWN_STATIC = "gyro_bias_unknown_static"
    SEEK_UNCERTAIN = "seek_uncertain"

    # Why a survey is not taken (survey.static_survey, survey.rotary_survey, pipeline).
    TOO_FEW_SAMPLES = "too_few_samples"
    SAMPLES_MISSING = "samples_missing"
    TOOL_TURNS = "tool_turns"
    TOOL_MOVES = "tool_moves"
    TOOL_SHAKES = "tool_shakes"
    TOOL_SHIFTS = "tool_shifts"
    FIELD_TURNS = "field_turns"
    STRING_DOES_NOT_TURN = "string_does_not_turn"
    TOO_FEW_WITH_GRAVITY = "too_few_with_gravity"
    TIME_WENT_BACK = "time_went_back"
    NOISE_STATED = "noise_stated"


@dataclass(frozen=True)
class Reason:
    """One reason: a code, and the numbers and names that its sentence states."""

    code: ReasonCode
    #: `value`, `limit`: the value found and the limit with which it was compared, in SI units; None for a code without
    #: value or limit.
    value: float | None = None
    limit: float | None = None
    values: tuple[float, ...] = ()  #: further numbers of this code, SI
    names: tuple[str, ...] = ()  #: names of sensors, methods, norths or units that the sentence mentions
    causes: tuple[Reason, ...] = ()  #: reasons from which this one follows
    fault: SensorFault | None = None  #: the sensor fault that is the reason
