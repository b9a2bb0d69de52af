# SPDX-License-Identifier: Apache-2.0
"""Compares two states of a well, to show where a viewed recording differs from the live page."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

# What the session of a page has of its own, and nothing else: counts of changes, and when a part last changed, which
# depends on how often the same content was said.
OF_THE_SESSION = ("since", "age")
# What no topic of a recording carries: what a person could send to the tool (downlink.choices).
NOT_RECORDED = ("downlink.choices",)


STRIPS = ("history", "trend", "depth_log")


def exact(value):
    """Return the content of a value as text and tuples, with exact numbers: equal values give equal results."""
    if isinstance(value, float):
        return float(value).hex()
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, Mapping):
        return tuple((str(name), exact(value[name])) for name in sorted(value, key=str))
    if isinstance(value, (tuple, list)):
        return tuple(map(exact, value))
    if dataclasses.is_dataclass(value):
        return tuple((one.name, exact(getattr(value, one.name))) for one in dataclasses.fields(value))
    return repr(value)


def differences(live, viewed, *, except_for=()):
    """
    Return the paths of all members that differ between the sections of two states of the page.

    except_for: paths that are not compared, or their beginnings.
    """
    found = []
    live, viewed = dict(live), dict(viewed)
    # A strip is longer on a page that was up before the recording began.
    for name in STRIPS:
        one, other = live.pop(name)["rows"], viewed.pop(name)["rows"]
        rows = {row[0]: list(row) for row in one}
        found += [f"{name}: {row} and {rows.get(row[0])}" for row in other[1:] if rows.get(row[0]) != list(row)]
    skipped = (*NOT_RECORDED, *except_for)

    def compare(path, one, other):
        last = path.rpartition(".")[2]
        if path.startswith(skipped) or last in OF_THE_SESSION:
            return
        if isinstance(one, Mapping) and isinstance(other, Mapping):
            for name in sorted({*one, *other}):
                here = f"{path}.{name}" if path else name
                if name not in one or name not in other:
                    found.append(f"{here}: only one has it")
                else:
                    compare(here, one[name], other[name])
        elif isinstance(one, (list, tuple)) and isinstance(other, (list, tuple)):
            if len(one) != len(other):
                found.append(f"{path}: {len(one)} and {len(other)} rows")
            for k, (a, b) in enumerate(zip(one, other, strict=False)):
                compare(f"{path}[{k}]", a, b)
        elif one != other and not _near(one, other):
            found.append(f"{path}: {one!r} and {other!r}")

    compare("", live, viewed)
    return found


def _near(one, other):
    numbers = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in (one, other))
    return numbers and math.isclose(one, other, rel_tol=1e-9, abs_tol=1e-12)
