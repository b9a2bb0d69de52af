# SPDX-License-Identifier: Apache-2.0
"""One short run of a tool for the tests of recordings, simulated once."""

import awkward_bags as awkward
import pytest


@pytest.fixture(scope="session")
def sent(tmp_path_factory):
    """Streams of the IMU and the magnetometer of a sound tool; nobody may change them."""
    streams = awkward.streams(*awkward.sent(tmp_path_factory.mktemp("sent")))
    for _, _, samples, log_ns in streams:
        samples.flags.writeable = log_ns.flags.writeable = False
    return streams


@pytest.fixture(scope="session")
def expected(sent, tmp_path_factory):
    """The surveys of the plain recording."""
    return awkward.surveys(awkward.written(tmp_path_factory.mktemp("plain") / "bag", sent))
