"""What the estimator found as the graph's messages: unknown becomes what the message says unknown is."""

from __future__ import annotations

from mwd_msgs.msg import AzimuthEstimate
from mwd_msgs.msg import Survey as SurveyMessage

from mwd_estimation.survey.survey import Survey
from mwd_estimation.survey.survey_message import known, survey_fields
from mwd_sensors.ros.time_stamps import stamp

__all__ = ["known", "stamp", "survey_message"]


def survey_message(survey: Survey, frame_id: str, status: int) -> SurveyMessage:
    """Survey as mwd_msgs/msg/Survey."""
    fields = survey_fields(survey, status)
    azimuths = [AzimuthEstimate(**one) for one in fields.pop("azimuths")]
    message = SurveyMessage(azimuths=azimuths, **fields)
    message.header.stamp = stamp(survey.stamp_ns)
    message.header.frame_id = frame_id
    return message
