"""What follows from the settings before the first sample: the reference field and the latitude."""

import dataclasses
import math

import pytest

from mwd_estimation.gyrocompass.gyro_params import GyroParams
from mwd_estimation.settings import EstimatorSettings, ReferenceSettings, latitude_of, reference_of

START = 1_772_323_200 * 10**9  # 2026-03-01


@pytest.mark.parametrize(
    ("changes", "message"),
    [({"date": "yesterday"}, "YYYY-MM-DD"), ({"date": "1999-01-01"}, "1999|2025")],
)
def test_a_reference_outside_its_model_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        reference_of(ReferenceSettings(source="model", lat_deg=50.0, **changes), START)


def test_the_reference_of_the_model_takes_the_day_of_the_first_sample():
    at = ReferenceSettings(source="model", lat_deg=38.3, lon_deg=109.6)
    assert reference_of(at, START) == reference_of(dataclasses.replace(at, date="2026-03-01"), 0)


def test_without_a_source_there_is_no_reference_and_a_fixed_one_is_as_it_says():
    assert reference_of(ReferenceSettings(), START) is None
    fixed = reference_of(ReferenceSettings(source="fixed", total_nt=48000.0, dip_deg=60.0, declination_deg=3.0), START)
    assert fixed is not None
    assert (fixed.total, fixed.dip) == (pytest.approx(48e-6), pytest.approx(math.radians(60.0)))


def test_only_a_named_grid_gives_the_model_a_convergence():
    place = ReferenceSettings(source="model", lat_deg=50.0, lon_deg=5.0)
    assert reference_of(place, START).convergence is None
    assert reference_of(dataclasses.replace(place, grid="utm"), START).convergence == pytest.approx(0.0268, abs=1e-3)


@pytest.mark.parametrize(
    ("source", "reference", "latitude"),
    [("reference", "model", 50.0), ("reference", "none", None), ("fixed", "none", 30.0), ("unknown", "model", None)],
)
def test_the_latitude_is_the_places_the_settings_or_unknown(source, reference, latitude):
    settings = EstimatorSettings(
        reference=ReferenceSettings(source=reference, lat_deg=50.0),
        gyro=GyroParams(latitude_source=source, latitude_deg=30.0),
    )
    assert latitude_of(settings) == latitude
