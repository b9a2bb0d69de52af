# SPDX-License-Identifier: Apache-2.0
"""Which addresses are of this machine alone."""

import pytest

from mwd_surface.loopback import is_loopback


@pytest.mark.parametrize(
    ("host", "own"),
    [
        ("127.0.0.1", True),
        ("127.8.9.1", True),
        ("::1", True),
        ("localhost", True),
        ("LocalHost", True),
        ("::", False),
        ("10.0.0.5", False),
        ("rig.example", False),
        ("localhost.example", False),
        ("", False),
    ],
)
def test_only_addresses_no_other_machine_can_reach_are_loopback(host, own):
    assert is_loopback(host) is own
