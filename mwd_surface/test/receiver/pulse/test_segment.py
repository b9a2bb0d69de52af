# SPDX-License-Identifier: Apache-2.0
"""A stretch of words in white noise: its evidence has the mean that is expected of it."""

import numpy as np
import pytest
from link_runs import TOOLS

from mwd_surface.receiver.pulse import segment, trellis
from mwd_surface.receiver.pulse.channel_estimate import BEFORE, SAMPLES_PER_TU, basis, reconstruct, response_length
from mwd_surface.receiver.pulse.passes import sync_places
from mwd_surface.receiver.whitening import steady_filter
from mwd_surface.receiver.words import packet_rows

TOOL = TOOLS["0.5"]
START = 1600  # first sample of the words; the noise before the sync is long enough for the noise model


def decoded(seed, ebn0_db, hidden=0.0):
    """Return the first decoding of two words whose channel is known from the five pulses of a sync."""
    random = np.random.default_rng(seed)
    rows, length = packet_rows(TOOL.surveys[0][:2])
    groups = np.array([[0, 0, length + 14]])
    places = np.array(sync_places(TOOL, START - SAMPLES_PER_TU * TOOL.sync.length_tu))
    values = np.array([random.integers(count) for count in rows[:, trellis.COUNT]])
    sent = trellis.places_of(rows)[np.arange(len(rows)), values]
    train = np.zeros(START + SAMPLES_PER_TU * groups[0, 2])
    train[[*places[:, 0].astype(int), *(START + SAMPLES_PER_TU * sent)]] = 1.0
    response = np.zeros(response_length(TOOL.tu_s))
    response[BEFORE : BEFORE + 2 * SAMPLES_PER_TU] = 1.0
    pressure = reconstruct(train, response)
    bits = rows[:, trellis.BITS].sum() / len(rows)
    pressure += random.normal(size=len(train)) * np.sqrt(2 * SAMPLES_PER_TU / bits / 2.0 / 10.0 ** (ebn0_db / 10.0))
    known = np.ones(len(train))
    known[START : START + round(hidden * SAMPLES_PER_TU * length)] = 0.0
    taps = steady_filter(pressure[:1200], known[:1200], segment.ORDER, segment.FLOOR)
    channel = segment.ChannelEstimate(response, 1.0, taps, basis(len(response), TOOL.tu_s), 160.0)
    return segment.decode(segment.StretchOnToolClock(pressure, known, places, rows, groups, START, 0), channel)


@pytest.mark.parametrize("hidden", [0.0, 0.5])
@pytest.mark.parametrize("ebn0_db", [8.0, 12.0])
def test_the_evidence_of_a_first_decoding_has_the_mean_that_is_expected_of_it(ebn0_db, hidden):
    """Also if half of the pulses lie in a data gap. A response from five pulses is larger by its error."""
    both = [(one.evidence, one.expected) for one in (decoded(seed, ebn0_db, hidden) for seed in range(24))]
    evidence, expected = np.mean(both, axis=0)
    assert 0.75 * expected < evidence < 1.05 * expected


def test_the_energy_shared_with_other_pulses_is_the_sum_over_each_of_them():
    random = np.random.default_rng(4)
    rows, length = packet_rows(TOOL.surveys[0][:1])
    known = np.array([[START - 40.0, 1.0, 0.0], [START - 8.0, 0.7, 1.0]])
    groups, samples = np.array([[0, 0, length + 14]]), np.zeros(2000)
    stretch = segment.StretchOnToolClock(samples, samples, known, rows, groups, START, 0)
    common, absorbed, places = *random.normal(size=(2, 16)), trellis.places_of(rows)
    pulses = trellis.uniform(rows) * random.uniform(size=places.shape)
    energies, expected = (common, absorbed), segment.expected_pulses(stretch, pulses)
    far, beside = segment.shared_energy(stretch, places, energies, expected)

    def of(at, others, energy):
        return sum(chance * energy[abs(at - int(place))] for place, chance in others if abs(at - place) < len(energy))

    for k, values in enumerate(places):
        packets = [list(zip(places[j], pulses[j], strict=True)) for j in range(len(rows))]
        near = [one for j in (k - 1, k + 1) if 0 <= j < len(rows) for one in packets[j]]
        rest = [one for j, row in enumerate(packets) if abs(j - k) > 1 for one in row]
        rest += [((at - START) / SAMPLES_PER_TU, chance) for at, chance, _ in known]
        # The pump lines contain a part of the expected pulses of the packet and its neighbours, and half of its own.
        taken = [of(at, near + packets[k], absorbed) - 0.5 * absorbed[0] for at in values]
        assert beside[k] == pytest.approx([of(at, near, common - absorbed) for at in values])
        assert far[k] == pytest.approx(np.array([of(at, rest, common) for at in values]) + taken)
