# SPDX-License-Identifier: Apache-2.0
"""Table of the telemetry link for the page: state, words of the last survey, passes, and pictures of the pressure."""

from __future__ import annotations

from typing import Any

from mwd_surface.live.link_state import (
    STATE_WORDS,
    STATUS_WORDS,
    SURVEY,
    LinkFrameState,
    LinkStatus,
    LinkWordState,
)
from mwd_surface.live.pressure_picture import LINE_HZ, STEP_S
from mwd_surface.page.plain import number

_MAX_FRAMES = 12


def link_table(link: LinkStatus | None) -> dict[str, Any]:
    """Return the link in use and the other links as a plain table; only known: False if there is none."""
    if link is None:
        return {"known": False}
    others = [_table(one) for one in link.others]
    return {"known": True, **_table(link), "picture": _picture(link), "others": others}


def _table(link: LinkStatus) -> dict[str, Any]:
    return {
        "name": link.link.replace("_", " "),
        "state": STATE_WORDS[link.state],
        "reason": link.reason,
        "margin_db": number(link.margin_db),
        "ebn0_db": number(link.ebn0_db),
        "clock_error": number(link.clock_error),
        "word_error": number(link.word_error),
        "goodput": number(link.goodput),
        "mode": link.mode,
        "words_done": link.words_done,
        "words_expected": link.words_expected,
        "toolface_age": number(link.toolface_age),
        "survey_age": number(link.survey_age),
        "inclination_age": number(link.inclination_age),
        "azimuth_age": number(link.azimuth_age),
        "stamp_ns": link.stamp_ns,
        "pumps_hz": [number(rate) for rate in link.pump_lines],
        "survey": [_word(word) for word in link.survey],
        "words": [_word(word) for word in link.words],
        "frames": [_frame(frame) for frame in link.frames[-_MAX_FRAMES:]],
    }


def _word(word: LinkWordState) -> dict[str, Any]:
    return {
        "name": word.name,
        "value": number(word.value),
        "sigma": number(word.sigma),
        "unit": word.unit,
        "confidence": number(word.confidence),
        "status": STATUS_WORDS[word.status],
        "final": word.revision > 0,
        "start_ns": word.start_ns,
        "end_ns": word.end_ns,
        "pulses": [number(at) for at in word.pulses],
    }


def _frame(frame: LinkFrameState) -> dict[str, Any]:
    return {
        "kind": "survey" if frame.kind == SURVEY else "toolface",
        "frame": frame.frame,
        "words": frame.words,
        "believed": frame.believed,
        "ebn0_db": number(frame.ebn0_db),
        "start_ns": frame.start_ns,
        "end_ns": frame.end_ns,
        "reason": frame.reason,
    }


def _picture(link: LinkStatus) -> dict[str, Any] | None:
    if link.picture is None:
        return None
    return {
        "end_ns": link.picture.end_ns,
        "line": list(link.picture.line),
        "line_hz": LINE_HZ,
        "spectra": [list(one) for one in link.picture.spectra],
        "bin_hz": number(link.picture.bin_hz),
        "step_s": STEP_S,
    }
