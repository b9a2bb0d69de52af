"""What a station is worth whose magnetic azimuth the gyro has not confirmed."""

from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.survey.gyro_evidence import unconfirmed

SHORT = Reason(ReasonCode.SEEK_TOO_SHORT, 5.0, 30.0)
ALARM = Reason(ReasonCode.DISAGREES_EXTERNAL_INTERFERENCE, -0.4, 3.0, (8.0,), ("raw", "gyro"))


def test_a_station_the_gyro_has_not_compared_is_doubtful_only_after_an_alarm() -> None:
    doubt, remark = unconfirmed(SHORT, (ALARM,))
    assert doubt == Reason(ReasonCode.NOT_CONFIRMED_BY_GYRO, causes=(SHORT, ALARM))
    assert remark is None
    doubt, remark = unconfirmed(SHORT, ())
    assert doubt is None
    assert remark == Reason(ReasonCode.NOT_COMPARED_WITH_GYRO, causes=(SHORT,))
    assert unconfirmed(None, (ALARM,)) == (None, None)
