# SPDX-License-Identifier: Apache-2.0
"""
The signal table: every quantity that goes to a rig, once, with its name in each protocol.

WITS items, Modbus registers, OPC UA variables, the D-WIS manifest and the page of signals in the documents are made
from it. The D-WIS nouns are those of the DDHub vocabulary (definition sets DrillingDataSemantics, PhysicalLocation and
Uncertainty); it has no noun for a toolface, for gravity or for a magnetic field, and those rows name only what kind of
data they are.
"""

from __future__ import annotations

import dataclasses

TOOL, RIG, BIT, PLAN, SURVEY = "tool", "rig", "bit", "plan", "survey"  # sources
CONTROL, ADVICE, INPUT = "control", "advice", "input"
_MEASURED, _DERIVED, _CORRECTED = "Measurement", "DerivedMeasurement", "CorrectedMeasurement"
_SET_POINT, _LIMIT = "SetPoint", "Limit"
_COMPUTED, _ADVISED, _SIGMA = "ComputedData", "RecommendedTarget", "GaussianUncertainty"


@dataclasses.dataclass(frozen=True)
class Signal:
    """
    One quantity.

    Attributes
    ----------
    name : str
        In our own values.
    unit : str
        SI; angles in rad, 1 for a ratio.
    meaning : str
        In words.
    source : str
        TOOL, RIG, BIT (the path projected to it), PLAN (against it), SURVEY (the last accepted one), CONTROL (what the
        owner of the lease asks of the rig), ADVICE (how to drill the next interval) or INPUT (of the surface: clocks
        and the source of depth).
    opcua : str
        Variable.
    dwis : tuple of str
        Nouns that classify it.
    modbus : int, optional
        Address of its first register.
    wits : int, optional
        Item, of the survey, tool or rig record.
    circle : bool
        Its values go round a full circle.
    """

    name: str
    unit: str
    meaning: str
    source: str
    opcua: str
    dwis: tuple[str, ...]
    modbus: int | None = None
    wits: int | None = None
    circle: bool = False


SIGNALS: tuple[Signal, ...] = (
    Signal(
        "survey_inclination",
        "rad",
        "inclination of the last accepted survey",
        SURVEY,
        "Inclination",
        ("Inclination", _DERIVED),
        modbus=10,
        wits=713,
    ),
    Signal(
        "survey_azimuth",
        "rad",
        "azimuth of the last accepted survey, from the north of the well",
        SURVEY,
        "Azimuth",
        ("Azimuth", _CORRECTED),
        modbus=12,
        wits=715,
        circle=True,
    ),
    Signal(
        "survey_depth",
        "m",
        "measured depth of the last accepted survey",
        SURVEY,
        "SurveyMeasuredDepth",
        ("MeasuredDepth", _DERIVED),
        modbus=14,
        wits=708,
    ),
    Signal(
        "survey_vertical_depth",
        "m",
        "vertical depth of the last accepted survey",
        SURVEY,
        "SurveyTrueVerticalDepth",
        (_COMPUTED, "NorthEastTVDFrame"),
        wits=709,
    ),
    Signal(
        "survey_north",
        "m",
        "north of the last accepted survey",
        SURVEY,
        "SurveyNorth",
        (_COMPUTED, "NorthEastTVDFrame"),
        wits=718,
    ),
    Signal(
        "survey_east",
        "m",
        "east of the last accepted survey",
        SURVEY,
        "SurveyEast",
        (_COMPUTED, "NorthEastTVDFrame"),
        wits=719,
    ),
    Signal(
        "survey_dogleg",
        "rad/m",
        "dogleg severity above the last accepted survey",
        SURVEY,
        "DogLegSeverity",
        (_COMPUTED,),
        wits=720,
    ),
    Signal(
        "survey_gravity",
        "m/s^2",
        "total gravity of the last accepted survey",
        SURVEY,
        "TotalGravity",
        (_DERIVED,),
        modbus=16,
        wits=722,
    ),
    Signal(
        "survey_field",
        "T",
        "total field of the last accepted survey",
        SURVEY,
        "TotalMagneticField",
        (_DERIVED,),
        modbus=18,
        wits=723,
    ),
    Signal(
        "survey_dip",
        "rad",
        "dip of the field of the last accepted survey",
        SURVEY,
        "MagneticDip",
        (_DERIVED,),
        modbus=20,
        wits=724,
    ),
    Signal(
        "survey_sigma_inclination",
        "rad",
        "1 sigma of its inclination",
        SURVEY,
        "InclinationSigma",
        (_SIGMA,),
        modbus=22,
    ),
    Signal("survey_sigma_azimuth", "rad", "1 sigma of its azimuth", SURVEY, "AzimuthSigma", (_SIGMA,), modbus=24),
    Signal(
        "survey_interference",
        "T",
        "axial interference of the last accepted survey",
        SURVEY,
        "AxialInterference",
        (_COMPUTED,),
        modbus=28,
    ),
    Signal(
        "survey_gyro_share",
        "1",
        "share of the gyro in its azimuth, 0 to 1",
        SURVEY,
        "SurveyGyroShare",
        (_COMPUTED,),
    ),
    Signal(
        "gravity_toolface",
        "rad",
        "toolface from the high side",
        TOOL,
        "GravityToolface",
        (_DERIVED,),
        modbus=4,
        wits=717,
        circle=True,
    ),
    Signal(
        "magnetic_toolface",
        "rad",
        "toolface from north",
        TOOL,
        "MagneticToolface",
        (_DERIVED,),
        modbus=6,
        wits=716,
        circle=True,
    ),
    Signal(
        "inclination",
        "rad",
        "continuous inclination from the vertical",
        TOOL,
        "ContinuousInclination",
        ("Inclination", _DERIVED),
        modbus=26,
    ),
    Signal("azimuth", "rad", "continuous azimuth", TOOL, "ContinuousAzimuth", ("Azimuth", _DERIVED), circle=True),
    Signal(
        "rotary_speed",
        "rad/s",
        "rotary speed down-hole",
        TOOL,
        "DownholeRotarySpeed",
        ("DownholeRPM", _MEASURED),
        modbus=30,
        wits=919,
    ),
    Signal("vibration", "m/s^2", "acceleration other than gravity", TOOL, "Vibration", (_DERIVED,)),
    Signal(
        "temperature",
        "degC",
        "temperature of the tool",
        TOOL,
        "ToolTemperature",
        ("DownholeTemperature", _MEASURED),
        modbus=32,
    ),
    Signal("axial_interference", "T", "axial field of the string", TOOL, "ContinuousAxialInterference", (_COMPUTED,)),
    Signal("bit_depth", "m", "measured depth of the bit", RIG, "BitMeasuredDepth", ("BitDepth", _MEASURED), wits=810),
    Signal(
        "hole_depth", "m", "measured depth of the hole", RIG, "HoleMeasuredDepth", ("HoleDepth", _MEASURED), wits=808
    ),
    Signal(
        "projected_inclination",
        "rad",
        "inclination projected to the bit",
        BIT,
        "ProjectedInclination",
        ("Inclination", _COMPUTED, "BitReferenceLocation"),
    ),
    Signal(
        "projected_azimuth",
        "rad",
        "azimuth projected to the bit",
        BIT,
        "ProjectedAzimuth",
        ("Azimuth", _COMPUTED, "BitReferenceLocation"),
        circle=True,
    ),
    Signal("plan_distance", "m", "distance from the plan", PLAN, "DistanceToPlan", (_COMPUTED,)),
    Signal("plan_up", "m", "above the plan, across it", PLAN, "AbovePlan", (_COMPUTED,)),
    Signal("plan_right", "m", "right of the plan, across it", PLAN, "RightOfPlan", (_COMPUTED,)),
    Signal(
        "plan_toolface",
        "rad",
        "toolface that steers back to the plan",
        PLAN,
        "ToolfaceToPlan",
        (_ADVISED,),
        circle=True,
    ),
    Signal(
        "target_dogleg",
        "rad/m",
        "dogleg severity of the arc that hits the target",
        PLAN,
        "DogLegSeverityToTarget",
        (_ADVISED,),
    ),
    Signal(
        "top_drive_speed",
        "rad/s",
        "achieved speed of the top drive",
        RIG,
        "TopDriveSpeed",
        ("SurfaceRPM", _MEASURED),
        modbus=46,
    ),
    Signal(
        "top_drive_torque",
        "N m",
        "torque at the top drive",
        RIG,
        "TopDriveTorque",
        ("SurfaceTorque", _MEASURED),
        modbus=48,
    ),
    Signal("flow", "m^3/s", "achieved flow into the string", RIG, "FlowRateIn", ("FlowRateIn", _MEASURED), modbus=50),
    Signal(
        "set_speed",
        "rad/s",
        "speed asked of the top drive now, on its ramp",
        CONTROL,
        "TopDriveSpeedSetPoint",
        (_SET_POINT,),
        modbus=52,
    ),
    Signal("set_turn", "rad", "turn of the last set-point", CONTROL, "TurnSetPoint", (_SET_POINT,), modbus=54),
    Signal("set_flow", "m^3/s", "flow asked of the pumps", CONTROL, "FlowRateSetPoint", (_SET_POINT,), modbus=56),
    Signal(
        "speed_limit", "rad/s", "limit of the top drive's speed", CONTROL, "TopDriveSpeedLimit", (_LIMIT,), modbus=58
    ),
    Signal("flow_limit", "m^3/s", "limit of the flow", CONTROL, "FlowRateLimit", (_LIMIT,), modbus=60),
    Signal(
        "advised_toolface",
        "rad",
        "toolface advised for the next slide",
        ADVICE,
        "AdvisedToolface",
        (_ADVISED,),
        modbus=62,
        circle=True,
    ),
    Signal(
        "advised_from",
        "m",
        "measured depth at which the advice begins",
        ADVICE,
        "AdvisedFromDepth",
        (_ADVISED,),
        modbus=64,
    ),
    Signal(
        "advised_slide_to",
        "m",
        "measured depth to which to slide; its beginning where to rotate",
        ADVICE,
        "AdvisedSlideToDepth",
        (_ADVISED,),
        modbus=66,
    ),
    Signal(
        "advised_to", "m", "measured depth at which the advice ends", ADVICE, "AdvisedToDepth", (_ADVISED,), modbus=68
    ),
    Signal("depth_age", "s", "age of the bit depth in force", INPUT, "DepthAge", (_DERIVED,), modbus=70),
    Signal(
        "depth_difference",
        "m",
        "largest difference of another source's bit depth from the one in force",
        INPUT,
        "DepthDifference",
        (_DERIVED,),
        modbus=72,
    ),
    Signal(
        "sonde_clock_offset",
        "s",
        "clock of the sonde minus that of the surface",
        INPUT,
        "SondeClockOffset",
        (_DERIVED,),
        modbus=74,
    ),
    Signal(
        "rig_clock_offset",
        "s",
        "clock of the rig data in force minus that of the surface",
        INPUT,
        "RigClockOffset",
        (_DERIVED,),
        modbus=76,
    ),
)
BY_NAME = {signal.name: signal for signal in SIGNALS}
OF_SURVEY = tuple(signal.name for signal in SIGNALS if signal.source == SURVEY)
LIVE = tuple(signal.name for signal in SIGNALS if signal.source != SURVEY)
FROM_TOOL = tuple(signal.name for signal in SIGNALS if signal.source == TOOL)
FROM_PLAN = tuple(signal.name for signal in SIGNALS if signal.source == PLAN)
FROM_ADVICE = tuple(signal.name for signal in SIGNALS if signal.source == ADVICE)
