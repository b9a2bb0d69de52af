# SPDX-License-Identifier: Apache-2.0
"""
Take the pictures of the live page: play the demonstration, wait for each scene, photograph it in a browser.

`python docs/pictures.py` writes the pictures of README and docs to docs/images; with `--all FOLDER`, every scene in
every size. It needs Chromium and chromedriver (apt install chromium chromium-driver) and the packages of the tests.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

from PIL import Image
from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service

IMAGES = Path(__file__).parent / "images"
DEMO = Path(__file__).parents[1] / "bags" / "scenarios" / "demo.yaml"
SIZES = ((1920, 1080), (1280, 800), (1024, 768), (390, 844), (844, 390))
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run")
# Pictures of README and docs: file, scene, size, and whether only the dial is shown.
USED = (
    ("page.png", "sliding", (1280, 800), False),
    ("page_dial.png", "sliding", (1280, 800), True),
    ("page_alarm.png", "alarm", (1024, 768), False),
    ("page_phone.png", "drilling", (390, 844), False),
)
# A moving picture of the whole run: one frame every `every_s` seconds, shown in a sixth of the time.
FILM = {"size": (1280, 800), "every_s": 3.5, "quality": 60}
COLOURS = 128
_LONGEST_S = 600.0

Sections = dict[str, Any]
_SLIDES_S = 5.0  # time from the start of a slide to its picture, s


def _surveyed(s: Sections) -> bool:
    return bool(s["survey_progress"] and s["survey_progress"]["active"])


def _rotating(s: Sections) -> bool:
    return bool(s["toolface"]["rotating"]) and len(s["surveys"]["rows"]) > 0


def _sliding(s: Sections) -> bool:
    slid = [row for row in s["steering"]["rows"] if row["mode"] == "slide"]
    return "sliding" in s["attitude"]["status"] and bool(slid) and len(s["surveys"]["rows"]) > 1


def _alarmed(s: Sections) -> bool:
    return any(a["active"] and a["severity"] > 0 for a in s["alarms"]["rows"])


def _recovered(s: Sections) -> bool:
    return not _alarmed(s)


def _last_survey(s: Sections) -> bool:
    return "still" in s["attitude"]["status"] and _surveyed(s)


# Scenes in the order of the run: name, condition for the picture, and (process, signal) sent before the picture.
SCENES: tuple[tuple[str, Callable[[Sections], bool], tuple[str, int] | None], ...] = (
    ("survey", _surveyed, None),
    ("drilling", _rotating, None),
    ("sliding", _sliding, None),
    ("alarm", _alarmed, None),
    ("killed_estimator", _recovered, ("estimator", signal.SIGKILL)),
    ("silent_link", _last_survey, ("sonde", signal.SIGSTOP)),
)


def sections(address: str) -> Sections | None:
    """Return the sections of the page's state; None while the page does not answer."""
    try:
        with urllib.request.urlopen(f"{address}state.json", timeout=2.0) as answer:  # noqa: S310
            return dict(json.load(answer)["sections"])
    except (OSError, ValueError, KeyError):
        return None


def node_process(parent: int, name: str) -> int:
    """Return the process id of a node that `mwd run` has started."""
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            is_child = f"\nPPid:\t{parent}\n" in (entry / "status").read_text()
            words = (entry / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if is_child and any(name.encode() in word for word in words):
            return int(entry.name)
    raise RuntimeError(f"{name}: `mwd run` has no such process")


class Camera:
    """A browser with the page open."""

    def __init__(self, folder: Path, address: str) -> None:
        options = Options()
        options.binary_location = next(
            found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))
        )
        for flag in (*FLAGS, f"--user-data-dir={folder}"):
            options.add_argument(flag)
        self._driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
        self._driver.get(address)

    def take(self, size: tuple[int, int], *, dial: bool) -> Image.Image:
        """Photograph the page."""
        width, height = size
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self._driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        # Set the attribute that the button sets, because an address with `?view=toolface` would reload the page.
        self._driver.execute_script("document.body.dataset.view = arguments[0]", "toolface" if dial else "all")
        self._driver.execute_script("document.getElementById('select-surveys')?.click()")
        self._driver.execute_script("document.activeElement.blur(); window.scrollTo(0, 0)")
        time.sleep(0.3)
        return Image.open(io.BytesIO(self._driver.get_screenshot_as_png())).convert("RGB")

    def close(self) -> None:
        """End the browser."""
        self._driver.quit()


def save(image: Image.Image, file: Path) -> None:
    """Write a picture with 128 colours, which suffice for the page; the file is a quarter as large."""
    image.quantize(COLOURS, method=Image.Quantize.FASTOCTREE).save(file, optimize=True)
    print(f"{file} ({file.stat().st_size // 1024} kB)", flush=True)


def shoot(
    run: subprocess.Popen[bytes], address: str, camera: Camera, wanted: dict[str, list[Any]], *, harm: bool
) -> list[Image.Image]:
    """
    Photograph the scenes in turn; return the frames of a film of the whole run.

    wanted: pictures of each scene: (file, size, dial). harm: whether to send the signals of `SCENES` to the processes.
    """
    film: list[Image.Image] = []
    left, filmed, since, end = (
        [(n, when, act if harm else None) for n, when, act in SCENES],
        0.0,
        None,
        time.monotonic() + _LONGEST_S,
    )
    while left and time.monotonic() < end:
        if run.poll() is not None:
            raise RuntimeError(f"the run ended before {left[0][0]}")
        name, condition, signalled = left[0]
        now, state = time.monotonic(), sections(address)
        there = state is not None and (since is not None or condition(state))
        since = since or (now if there else None)
        if since is not None and now - since >= (_SLIDES_S if name == "sliding" else 1.5):
            if signalled is not None:
                os.kill(node_process(run.pid, signalled[0]), signalled[1])
                time.sleep(3.0)
            for file, size, dial in wanted.get(name, []):
                save(camera.take(size, dial=dial), file)
            if signalled == ("sonde", signal.SIGSTOP):
                os.kill(node_process(run.pid, "sonde"), signal.SIGCONT)
            left, since = left[1:], None
        if state is not None and now - filmed >= FILM["every_s"]:
            filmed = now
            film.append(camera.take(FILM["size"], dial=False))
        time.sleep(0.1)
    return film


def main() -> int:
    """Play the demonstration and photograph it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--all", type=Path, help="folder for every scene in every size; else those the docs use")
    asked = parser.parse_args()
    wanted: dict[str, list[Any]] = {}
    if asked.all is None:
        for name, scene, size, dial in USED:
            wanted.setdefault(scene, []).append((IMAGES / name, size, dial))
    else:
        asked.all.mkdir(parents=True, exist_ok=True)
        for scene, _, _ in SCENES:
            for dial in (False, True):
                kind = f"{scene}_dial" if dial else scene
                files = [(asked.all / f"{kind}_{width}x{height}.png", (width, height), dial) for width, height in SIZES]
                wanted.setdefault(scene, []).extend(files)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        words = [sys.executable, "-m", "mwd_surface.cli", "run", str(DEMO), "--port", str(port), "-o", f"{folder}/run"]
        # Pictures in all sizes take long: at half the rate each scene lasts long enough.
        pace = "1" if asked.all is None else "0.5"
        run, address = subprocess.Popen([*words, "--no-rig", "--rate", pace]), f"http://127.0.0.1:{port}/"
        try:
            while sections(address) is None and run.poll() is None:
                time.sleep(0.2)
            camera = Camera(Path(folder) / "browser", address)
            try:
                film = shoot(run, address, camera, wanted, harm=asked.all is not None)
            finally:
                camera.close()
        finally:
            run.send_signal(signal.SIGINT)
            run.wait(timeout=60.0)
    file = (asked.all or IMAGES) / "demo.webp"
    film[0].save(file, save_all=True, append_images=film[1:], duration=600, quality=FILM["quality"], method=6, loop=0)
    print(f"{file} ({file.stat().st_size // 1024} kB)")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
