# SPDX-License-Identifier: Apache-2.0
"""Settings of a recorder: the defaults are safe."""

import dataclasses

import pytest

from mwd_sensors.core.settings import from_mapping, rule_of
from mwd_surface.bags.recorder.settings import RecorderSettings


def test_the_defaults_are_allowed_and_lose_at_most_a_second_when_the_supply_fails():
    settings = from_mapping(RecorderSettings, {})
    assert settings == RecorderSettings()
    assert max(settings.chunk_seconds, settings.sync_seconds) <= 1.0


def test_the_defaults_bound_memory_and_keep_half_a_gigabyte_of_the_disk_free():
    settings = RecorderSettings()
    assert settings.queue_bytes + settings.snapshot_bytes <= 128 * 2**20
    assert settings.min_free_bytes == 512 * 2**20
    # A chunk must find room in the queue several times over.
    assert settings.queue_bytes > 10 * settings.chunk_bytes


@pytest.mark.parametrize("name", ["split_bytes", "split_seconds", "time_jump_seconds", "snapshot_seconds"])
def test_what_can_be_switched_off_is_off_at_zero_and_says_so(name):
    kind = type(getattr(RecorderSettings(), name))
    assert getattr(from_mapping(RecorderSettings, {name: kind(0)}), name) == 0
    (field,) = (f for f in dataclasses.fields(RecorderSettings) if f.name == name)
    assert "0: n" in rule_of(field).doc
