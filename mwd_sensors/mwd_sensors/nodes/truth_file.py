# SPDX-License-Identifier: Apache-2.0
"""Write the truth of a run to a small file, for scoring when the surface receives only the tool's telemetry link."""

from __future__ import annotations

import csv
from pathlib import Path

from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.wire import NANOSECONDS

HEADER = ("stamp_ns", "inclination_rad", "azimuth_true_rad", "gravity_toolface_rad", "measured_depth_m")


class TruthFile:
    """
    CSV file with one row for each second of the run.

    Parameters
    ----------
    path : Path
        File to write; an existing file is replaced.

    Raises
    ------
    OSError
        The file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("w", encoding="utf-8", newline="")
        self._table = csv.writer(self._file, lineterminator="\n")
        self._table.writerow(HEADER)
        self._second = -1

    def take(self, samples: Samples) -> None:
        """Write the first sample of `wire.TRUTH` in each second."""
        for k, second in enumerate((samples["stamp_ns"] // NANOSECONDS).tolist()):
            if second != self._second:
                self._second = second
                row = samples[k]
                names = ("inclination", "azimuth", "gravity_toolface", "measured_depth")
                self._table.writerow((int(row["stamp_ns"]), *(f"{float(row[name]):.9g}" for name in names)))

    def close(self) -> None:
        """Close the file."""
        self._file.close()
