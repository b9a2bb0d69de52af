"""What the estimator found as the graph's messages: unknown becomes what the message says unknown is."""

from __future__ import annotations

import math

import numpy as np
from mwd_msgs.msg import AzimuthEstimate
from mwd_msgs.msg import Survey as SurveyMessage

from mwd_estimation.pipeline import NORTH_CODES
from mwd_estimation.survey import ROTARY, Survey
from mwd_sensors.nodes.stamps import stamp

_VERDICTS = {"accept": SurveyMessage.ACCEPT, "doubtful": SurveyMessage.DOUBTFUL, "reject": SurveyMessage.REJECT}


def known(value: float | None, otherwise: float) -> float:
    """The value, or the stand-in that the message defines for unknown."""
    return otherwise if value is None or not math.isfinite(value) else float(value)


def survey_message(survey: Survey, frame_id: str, status: int) -> SurveyMessage:
    """Survey as mwd_msgs/msg/Survey."""
    station, reference = survey.station, survey.station.reference
    message = SurveyMessage()
    message.header.stamp = stamp(survey.stamp_ns)
    message.header.frame_id = frame_id
    message.uuid = survey.uuid
    message.sequence = survey.sequence
    message.kind = SurveyMessage.ROTARY if survey.kind == ROTARY else SurveyMessage.STATIC
    message.requested = survey.requested
    message.duration = survey.duration
    message.samples = survey.samples
    has_mag = bool(np.isfinite(station.b_t).all())
    message.specific_force = np.nan_to_num(station.f_t)
    message.specific_force_covariance = survey.covariance_f.ravel()
    message.magnetic_field = np.nan_to_num(station.b_t)
    message.magnetic_field_covariance = survey.covariance_b.ravel() if has_mag else np.array([-1.0] + [0.0] * 8)
    message.angular_rate = survey.rate_t
    message.temperature = known(survey.temperature, -300.0)
    message.inclination = known(station.inclination, 0.0)
    message.azimuth = known(station.azimuth, 0.0)
    message.gravity_toolface = known(station.gravity_toolface, 0.0)
    message.magnetic_toolface = known(station.magnetic_toolface, 0.0)
    covariance = np.nan_to_num(station.covariance)
    if not math.isfinite(station.azimuth):
        covariance[1, :], covariance[:, 1] = 0.0, 0.0
        covariance[1, 1] = -1.0
    message.covariance = covariance.ravel()
    message.north = NORTH_CODES[station.north]
    message.azimuth_method = station.method
    message.azimuths = [
        AzimuthEstimate(
            method=one.method,
            north=NORTH_CODES[station.north],
            azimuth=known(one.azimuth, 0.0),
            sigma=known(one.sigma, -1.0),
            weight=survey.weights.get(one.method, 0.0),
            reason=survey.azimuth_reasons.get(one.method, one.refused),
        )
        for one in station.azimuths
    ]
    message.g_total = known(station.g_total, 0.0)
    message.b_total = known(station.b_total, -1.0)
    message.dip = known(station.dip, 0.0)
    message.g_reference = known(reference.gravity if reference else None, -1.0)
    message.b_reference = known(reference.total if reference else None, -1.0)
    message.dip_reference = known(reference.dip if reference else None, 0.0)
    message.declination = known(reference.declination if reference else None, 0.0)
    message.convergence = known(reference.convergence if reference else None, 0.0)
    message.axial_interference = known(station.interference, 0.0)
    message.sigma_axial_interference = known(station.sigma_interference, -1.0)
    message.verdict = _VERDICTS[station.verdict]
    message.reasons = list(station.reasons)
    message.status = status
    return message
