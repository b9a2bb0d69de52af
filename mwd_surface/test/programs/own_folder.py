# SPDX-License-Identifier: Apache-2.0
"""Lock a folder, and keep it until the input ends. Argument: the folder."""

import sys
from pathlib import Path

from mwd_surface.bags.folder_lock import FolderLock

lock = FolderLock(Path(sys.argv[1]), ".lock")
print("mine", flush=True)
sys.stdin.read()
