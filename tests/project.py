# SPDX-License-Identifier: Apache-2.0
"""Where the repository keeps what tests and benchmarks read."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SCENARIOS = ROOT / "bags" / "scenarios"
GOLDEN = ROOT / "bags" / "golden"
REFERENCE_DATA = ROOT / "bags" / "reference_data"
MESSAGES = ROOT / "mwd_msgs" / "msg"
