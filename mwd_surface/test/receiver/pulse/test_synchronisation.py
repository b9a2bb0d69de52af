# SPDX-License-Identifier: Apache-2.0
"""Syncs: found through an unknown channel, also without one pulse, and not in noise or in three of five pulses."""

import numpy as np
import pytest

from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.pulse import synchronisation
from mwd_surface.receiver.pulse.synchronisation import search

EDGES = ToolConfiguration().sync.edges_tu
RESPONSE = np.convolve(np.ones(8), [1.0, 0.0, 0.0, 0.0, 0.0, -0.5, 0.3])


def data(edges, seed=1, size=4.0, n=900):
    pressure = np.cumsum(np.random.default_rng(seed).normal(size=n)) * 0.2 + np.random.default_rng(seed + 99).normal(
        size=n
    )
    for edge in edges:
        pressure[edge : edge + len(RESPONSE)] += size * RESPONSE
    return pressure


def searched(pressure, known=None, until=550, **more):
    known = np.ones(len(pressure)) if known is None else known
    return search(pressure, known, ToolConfiguration(), 300, until, **more)


def assert_at(found, at=400, within=4):
    assert found is not None
    assert abs(found.at - at) <= within


SENT = [400 + 4 * edge for edge in EDGES]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_sync_is_found_through_an_unknown_channel(sign):
    found = searched(sign * data(SENT))
    assert_at(found)
    assert found.score > 8.0


@pytest.mark.parametrize("pulse", range(5))
def test_a_sync_without_one_pulse_is_found_and_the_missing_pulse_named(pulse):
    found = searched(data([edge for edge in SENT if edge != SENT[pulse]]))
    assert_at(found)
    assert [k for k, sent in enumerate(found.sent) if not sent] == [pulse]


@pytest.mark.parametrize("edges", [(), (0,), (0, 5, 15)])
def test_noise_and_other_pulses_are_no_sync(edges):
    assert searched(data([400 + 4 * e for e in edges])) is None


def test_a_gauge_that_stands_has_no_sync():
    assert searched(np.full(900, 2.0e7)) is None


def test_weak_syncs_are_found_and_noise_is_not():
    """White noise: 6 dB a bit (the energy of five pulses 50 times the density of the noise) is found each time.

    Noise passes with a probability below exp(-8) at each place; words behind it decide, so a few in 10 000 are no harm.
    """
    passed = 0
    for seed in range(40):
        noise = np.random.default_rng(seed).normal(size=900)
        passed += searched(noise) is not None
        for edge in SENT:
            noise[edge : edge + 8] += np.sqrt(50.0 / (5 * 8) * 2.0)
        assert_at(searched(noise), within=6)
    assert passed <= 3


@pytest.mark.parametrize("pulse", range(5))
def test_a_stall_on_one_pulse_of_a_sync_hides_no_sync(pulse):
    pressure = data(SENT, size=3.0)
    begin = SENT[pulse] - 4
    pressure[begin : begin + 24] += 60.0 * np.sin(np.linspace(0.0, np.pi, 24))
    assert_at(searched(pressure))


def starting(size):
    """Return the pressure of pumps that start at sample 20."""
    return size * (1.0 - np.exp(-np.maximum(np.arange(900) - 20.0, 0.0) / 8.0))


def test_pumps_that_start_spoil_no_search_whose_noise_is_known():
    """Lines of the pumps are averaged over what comes after their start, also behind a sync that was none."""
    pressure = data([500 + 4 * e for e in EDGES]) + 20.0 * np.cos(1.79 * np.arange(900))
    whitener = searched(pressure, until=620).whitener
    assert_at(searched(pressure + starting(5000.0), until=620, whitener=whitener), 500)


@pytest.mark.parametrize("size", [150.0, 5000.0])
def test_pumps_that_start_shortly_before_hide_no_sync(size):
    assert_at(searched(data(SENT, size=2.0) + starting(size)))


def test_no_second_place_is_found_where_the_best_is_no_sync(monkeypatch):
    """Of the places whose pulses are unlike each other, none is passed over for the next best one."""
    places = []

    def alike(whitened, weight, response, edges, at):
        places.append(at)
        return len(places) > 1

    monkeypatch.setattr(synchronisation, "_alike", alike)
    assert searched(data(SENT)) is None
    assert places == [pytest.approx(400, abs=4)]


@pytest.mark.parametrize(("edge", "hidden"), [(400, slice(414, 560)), (520, slice(390, 515)), (480, slice(494, 900))])
def test_one_pulse_beside_a_data_gap_is_no_sync(edge, hidden):
    known = np.ones(900)
    known[hidden] = 0.0
    found = [searched(data([edge], seed, 6.0), known) for seed in range(20)]
    assert found.count(None) >= 19


def test_a_place_that_moves_onto_the_best_sync_is_not_a_second_one():
    """The best place of the rest is often a flank of the sync, whose largest pressure is that of the sync."""
    found = search(
        data([250 + 4 * e for e in EDGES], 17, 4.0, 600), np.ones(600), ToolConfiguration(), 200, 330, least=-50.0
    )
    assert found is not None
    assert found.other is None or np.isfinite(found.other.score)
