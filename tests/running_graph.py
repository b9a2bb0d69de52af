# SPDX-License-Identifier: Apache-2.0
"""
The graph's nodes as processes, for tests.

Each graph runs on a middleware domain that no other run on this machine uses (a lock file holds it), in a folder of its
own, and its nodes take free ports (port 0). Several test workers can therefore run real nodes at the same time.
"""

from __future__ import annotations

import contextlib
import functools
import json
import os
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from mwd_surface.bags.bag_reader import Bag
from mwd_surface.rig.status import FILE_NAME, read_status
from mwd_surface.runs import launch_plan

EXECUTABLES = {
    "sonde": "mwd_sensors",
    "estimator": "mwd_estimation",
    "surface": "mwd_surface",
    "receiver": "mwd_surface",
    "well": "mwd_surface",
    "replay": "mwd_surface",
    "probe": "mwd_sensors",
}
MWD = (sys.executable, "-P", "-m", "mwd_surface.cli")
# Limits in seconds are those of an idle machine; they end what hangs, and are no claim on speed.
PATIENCE = 4.0
# Seconds between two looks at a page: a page with all its tables costs the surface some milliseconds.
LOOK = 0.25
PLACE = {"place.field": "model", "place.lat_deg": 38.3, "place.lon_deg": 109.6}

# For scripts that tests run as a node of their own, since a process has one middleware domain for good.
CALL = """
import rclpy
def call(node, kind, name, /, **fields):
    client = node.create_client(kind, name)
    assert client.wait_for_service(120.0), name
    # An answer is lost where the server knows the client's questions before its ears: asked again, then.
    for _ in range(5):
        future = client.call_async(kind.Request(**fields))
        rclpy.spin_until_future_complete(node, future, timeout_sec=20.0)
        if future.done(): return future.result()
    raise AssertionError(f"{name} does not answer")
"""


# Runs commands of `mwd` one after the other in one process, which imports them once; prints status and output of each.
COMMANDS = """
import contextlib, io, json, sys
from mwd_surface.cli import main
said = []
for words in json.loads(sys.argv[1]):
    sys.argv, printed, status = ["mwd", *words], io.StringIO(), 0
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        try:
            main()
        except SystemExit as end:
            status = end.code or 0
    said.append([status, printed.getvalue()])
print(json.dumps(said))
"""


class Graph:
    """Running nodes; their logs are in `folder`."""

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self.folder = folder
        self.environment = environment
        self.running: dict[str, subprocess.Popen[bytes]] = {}

    def start(
        self,
        node: str,
        namespace: str = "",
        *,
        arguments: Sequence[str] = (),
        **parameters: Any,
    ) -> str:
        """
        Start a node as `ros2 run` would; its name in this graph comes back.

        arguments: more of ROS.
        """
        program = str(Path(sys.prefix) / "lib" / EXECUTABLES[node] / node)
        return self._start([program, "--ros-args", *arguments], node, namespace, parameters)

    def _start(self, words: list[str], node: str, namespace: str, parameters: dict[str, Any]) -> str:
        words += ["-r", f"__ns:=/{namespace}"] if namespace else []
        for key, value in parameters.items():
            text = str(value).lower() if isinstance(value, bool) else str(value)
            words += ["-p", f"{key.replace('__', '.')}:={text}"]
        return self.begin(f"{namespace}/{node}", *words)

    def begin(self, name: str, *words: Any) -> str:
        """Start a program in the background, under a name by which it is ended and its log is found."""
        with (self.folder / f"{name.replace('/', '_')}.log").open("ab") as log:
            self.running[name] = subprocess.Popen(
                list(map(str, words)),
                env=self.environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        return name

    def run(self, *words: Any) -> subprocess.CompletedProcess[str]:
        """Run a program to its end in the environment of the graph."""
        return subprocess.run(
            list(map(str, words)), env=self.environment, capture_output=True, text=True, timeout=900.0, check=False
        )

    def report(self, script: str, *words: Any) -> Any:
        """Run a Python program, a node of its own, and return the JSON of the last line that it prints."""
        done = self.run(sys.executable, "-c", script, *words)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout.splitlines()[-1])

    def commands(self, *commands: str) -> list[tuple[int, str]]:
        """Run commands of `mwd` one after the other; return the exit status and the output of each."""
        words = json.dumps([command.split() for command in commands])
        return [(status, printed) for status, printed in self.report(COMMANDS, words)]

    def active(self, *names: str) -> None:
        """Wait until nodes are active."""
        for name in names:
            until(lambda name=name: ": active" in self.log(name), 120.0, f"{name} is active")

    def log(self, name: str) -> str:
        """Output of a node so far."""
        return (self.folder / f"{name.replace('/', '_')}.log").read_text()

    def end(self, name: str, number: signal.Signals = signal.SIGINT, within: float = 20.0) -> tuple[int, float]:
        """Send a signal; exit status and seconds until the end."""
        process, began = self.running.pop(name), time.monotonic()
        process.send_signal(number)
        return process.wait(PATIENCE * within), time.monotonic() - began

    def wait(self, name: str, within: float) -> int:
        """Exit status of a node that ends by itself."""
        return self.running.pop(name).wait(PATIENCE * within)


@functools.cache
def _compiled() -> None:
    """Compile the nodes' filters into the cache, so that no test waits for the compiler."""
    from mwd_estimation.nodes.warm_up import warm_up
    from mwd_estimation.settings.estimator import EstimatorSettings
    from mwd_sensors.core.settings import changed

    warm_up(changed(EstimatorSettings(), PLACE))


@contextlib.contextmanager
def graph(folder: Path) -> Iterator[Graph]:
    """Start a graph on a domain of its own; nodes that still run at the end are killed."""
    _compiled()
    with launch_plan.own_domain({}) as domain:
        environment = launch_plan.graph_environment(dict(os.environ), domain, folder)
        made = Graph(folder, environment)
        try:
            yield made
        finally:
            for process in made.running.values():
                process.kill()
                process.wait()


def until(true: Callable[[], Any], within: float, what: str, every: float = 0.05) -> Any:
    """Evaluate a condition every so many seconds until it is true; after a time-out, fail with its description."""
    end = time.monotonic() + PATIENCE * within
    while time.monotonic() < end:
        value = true()
        if value:
            return value
        time.sleep(every)
    raise AssertionError(f"not within {PATIENCE * within} s: {what}")


def samples_of(path: Path, topic: str) -> Any:
    """All samples of a fixed-layout topic of a bag, joined."""
    import numpy as np

    with Bag(path) as bag:
        return np.concatenate([block[topic][1] for block in bag.blocks([topic]) if topic in block])


def messages_of(path: Path, topic: str) -> list[Any]:
    """Return all messages of a topic of a bag."""
    with Bag(path) as bag:
        return [bag.decode(topic, data) for _, _, _, data in bag.messages([topic])]


def sections(page: str) -> dict[str, Any]:
    """Return the tables of a page; none while it does not answer, or before its first state."""
    try:
        with urllib.request.urlopen(f"{page}state.json", timeout=30.0) as answer:  # noqa: S310  (loopback)
            return dict(json.load(answer)["sections"])
    except (OSError, ValueError, KeyError):
        return {}


def rig_addresses(well: Path) -> dict[str, str]:
    """Wait until the rig interfaces of a well listen; return their addresses by name. well: its folder."""

    def found() -> dict[str, str]:
        with contextlib.suppress(OSError):
            addresses = {one.name: one.address for one in read_status(well / FILE_NAME).interfaces}
            return addresses if all(addresses.values()) else {}
        return {}

    return dict(until(found, 60.0, "the rig interfaces listen"))
