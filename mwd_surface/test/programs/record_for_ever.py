# SPDX-License-Identifier: Apache-2.0
"""Record numbered messages until the process is killed; print the time of every fiftieth. Argument: the folder."""

import sys
import time

from mwd_surface.bags.recorder.recorder import Recorder
from mwd_surface.bags.recorder.settings import RecorderSettings

recorder = Recorder(sys.argv[1], RecorderSettings(min_free_bytes=0))
recorder.start("run")
k = 0
while True:
    now = time.time_ns()
    recorder.put("/a", "std_msgs/msg/String", k.to_bytes(8, "little") + bytes(300), now)
    k += 1
    if k % 50 == 0:
        print(now, flush=True)
    time.sleep(0.0005)
