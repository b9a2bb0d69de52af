# SPDX-License-Identifier: Apache-2.0
"""Run `mwd` without a package, and print last which packages were imported. Arguments: the package or "", the words."""

import sys

hidden, *sys.argv[1:] = sys.argv[1:]


class Hidden:
    def find_spec(self, name, path=None, target=None):  # noqa: ARG002
        if name.partition(".")[0] == hidden:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


sys.meta_path.insert(0, Hidden())
from mwd_surface.__main__ import main  # noqa: E402

sys.argv[0] = "mwd"
try:
    main()
finally:
    print(*{name.partition(".")[0] for name in sys.modules})
