# SPDX-License-Identifier: Apache-2.0
"""Which of two verdicts is the graver."""

from mwd_estimation.core.verdicts import worse


def test_the_graver_verdict_wins():
    assert worse("accept", "reject") == worse("reject", "doubtful") == "reject"
    assert worse("accept", "doubtful") == "doubtful"
    assert worse("not_determined", "accept") == "accept"
