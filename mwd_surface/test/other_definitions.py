# SPDX-License-Identifier: Apache-2.0
"""Message definitions that differ from those of this installation."""

import re

from mwd_surface.bags.definitions import Definitions


def other_definitions(folder):
    """Definitions in which a Survey has no field `revision`."""
    package = folder / "mwd_msgs" / "msg"
    package.mkdir(parents=True)
    for name in ("Survey", "AzimuthEstimate"):
        text = Definitions().definition(f"mwd_msgs/msg/{name}").text.split("=" * 80)[0]
        (package / f"{name}.msg").write_text(re.sub(r"(?m)^uint32 revision.*$", "", text))
    return Definitions([folder])
