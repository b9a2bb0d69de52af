# SPDX-License-Identifier: Apache-2.0
"""Settings of the recorder."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting


@dataclasses.dataclass(frozen=True)
class RecorderSettings:
    """Settings of the recorder."""

    compression: str = setting(
        "zstd",
        "Compression of chunks. zstd needs the least disk space; none (no compression) needs the least time.",
        choices=("zstd", "lz4", "none"),
    )
    chunk_bytes: int = setting(
        262_144,
        "Size at which a chunk is written. Smaller chunks lose less data at a power cut and need more disk space.",
        unit="B",
        low=1024,
        high=67_108_864,
    )
    chunk_seconds: float = setting(
        1.0,
        "Time after which a chunk is written. Raising it loses more data at a power cut.",
        unit="s",
        low=0.05,
        high=60.0,
    )
    sync_seconds: float = setting(
        1.0,
        "Time between forced writes to the disk (fsync). Raising it loses more data at a power cut; lowering it "
        "wears a flash disk.",
        unit="s",
        low=0.05,
        high=60.0,
    )
    queue_bytes: int = setting(
        67_108_864,
        "Largest amount of data that waits to be written; beyond it messages are dropped and counted. Raise it for "
        "a disk that stalls.",
        unit="B",
        low=65_536,
    )
    min_free_bytes: int = setting(
        536_870_912,
        "Free disk space below which recording pauses. Raising it keeps more space for other programs.",
        unit="B",
        low=0,
    )
    split_bytes: int = setting(2_147_483_648, "Size at which a new file is started. 0: never.", unit="B", low=0)
    split_seconds: float = setting(3600.0, "Time after which a new file is started. 0: never.", unit="s", low=0.0)
    time_jump_seconds: float = setting(
        60.0, "Jump of the stamps above which a new file is started. 0: never.", unit="s", low=0.0
    )
    snapshot_seconds: float = setting(
        0.0,
        "Length of the history kept in memory for a snapshot. 0: none. Raising it costs memory in proportion.",
        unit="s",
        low=0.0,
    )
    snapshot_bytes: int = setting(
        67_108_864,
        "Largest amount of memory for a snapshot; beyond it the oldest messages are dropped.",
        unit="B",
        low=0,
    )
    retry_seconds: float = setting(
        2.0, "Time between attempts to write after the disk was full or failed.", unit="s", low=0.05, high=3600.0
    )
