"""What people may choose of a recorder."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting


@dataclasses.dataclass(frozen=True)
class RecorderSettings:
    """What people may choose of a recorder."""

    compression: str = setting(
        "zstd",
        "Compression of chunks: zstd for the least disk, none for the least work",
        choices=("zstd", "lz4", "none"),
    )
    chunk_bytes: int = setting(262_144, "A chunk is closed at this size", unit="B", low=1024, high=67_108_864)
    chunk_seconds: float = setting(1.0, "A chunk is closed after this time", unit="s", low=0.05, high=60.0)
    sync_seconds: float = setting(1.0, "Data are forced to the disk this often", unit="s", low=0.05, high=60.0)
    queue_bytes: int = setting(67_108_864, "Most that may wait to be written", unit="B", low=65_536)
    min_free_bytes: int = setting(536_870_912, "Recording pauses when less is free on the disk", unit="B", low=0)
    split_bytes: int = setting(2_147_483_648, "A new file is begun at this size; 0 never", unit="B", low=0)
    split_seconds: float = setting(3600.0, "A new file is begun after this time; 0 never", unit="s", low=0.0)
    time_jump_seconds: float = setting(
        60.0, "A new file is begun when the stamps jump by more; 0 never", unit="s", low=0.0
    )
    snapshot_seconds: float = setting(0.0, "The last seconds kept in memory for a snapshot; 0 none", unit="s", low=0.0)
    snapshot_bytes: int = setting(67_108_864, "Most that is kept for a snapshot", unit="B", low=0)
    retry_seconds: float = setting(
        2.0, "After a full or failing disk, writing is tried again this often", unit="s", low=0.05, high=3600.0
    )
