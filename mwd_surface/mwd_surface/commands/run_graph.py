# SPDX-License-Identifier: Apache-2.0
"""Processes of `mwd run`: start, supervision until the end of the scenario, and shutdown in order."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from mwd_surface.commands import terminal

if TYPE_CHECKING:
    from mwd_surface.runs.supervise import Supervisor

_SAY_EVERY = 30.0  # time between two messages with the reason why the start waits, s
_SETTLE = 1.5  # time from the last sample to the end of the run, for messages that are still being transmitted, s
_POLL = 0.1  # time between two checks of the processes, s


@dataclasses.dataclass(frozen=True)
class RunOptions:
    """Options for running the graph."""

    port: int | None  #: port of the page; None: a free port
    rig: bool  #: whether rig interfaces are on
    hold: bool  #: whether the graph continues to run after the scenario
    words: list[str]  #: ROS arguments for every node
    single_process: bool  #: whether sonde, estimator and surface share one process


def run_graph(
    story: str, namespace: str, parameters: dict[str, dict[str, Any]], folder: Path, options: RunOptions
) -> None:
    """
    Start the nodes, play the scenario until its end or an interrupt, and stop the nodes.

    story: name of the scenario; namespace: namespace of the well; parameters: by node name; folder: folder of the logs.
    Raises typer.Exit with status 1 if the graph does not start.
    """
    from mwd_surface.runs import launch_plan
    from mwd_surface.runs.supervise import Order, Supervisor

    logs = folder / "logs"
    own_domain, page_port = launch_plan.own_domain(os.environ), launch_plan.page_port(options.port)
    with own_domain as domain, page_port as page, contextlib.ExitStack() as held, _Interrupts() as interrupts:
        given = parameters["surface"]
        interfaces = {} if not options.rig else held.enter_context(launch_plan.rig_parameters(given))
        parameters["surface"] = {**interfaces, "page.port": page, **given}
        last = "sonde"
        if options.single_process:
            parameters, options, last = _in_one_process(parameters, namespace, folder, options)
        words = {
            node: launch_plan.node_words(node, namespace, given, options.words) for node, given in parameters.items()
        }
        orders = {node: Order(node, words[node], logs / f"{node}.log") for node in words}
        address = f"http://127.0.0.1:{page}/"
        environment = launch_plan.graph_environment(os.environ, domain, logs)
        supervisor = Supervisor(environment, terminal.warn)
        try:
            for node, order in orders.items():
                if node != "sonde":
                    supervisor.start(order)
            if _wait_until_ready(supervisor, interrupts, address, logs):
                terminal.tell(f"{story}: page at {address} (well /{namespace}, domain {domain})")
                if options.rig:
                    where = ", ".join(launch_plan.rig_addresses(interfaces))
                    terminal.tell(f"rig: {where} (`mwd rig status {folder}`)")
                if "sonde" in orders:
                    supervisor.start(orders["sonde"])
                _run_to_end(supervisor, interrupts, address, story, last, options.hold)
        except StartError as error:
            terminal.warn(f"{error}; logs in {logs}")
            raise typer.Exit(1) from error
        finally:
            killed = supervisor.stop((("sonde", "estimator"), ("receiver",), ("surface", "well")))
    for node in killed:
        terminal.warn(f"{node} did not end by itself and was killed")


def _in_one_process(
    parameters: dict[str, dict[str, Any]], namespace: str, folder: Path, options: RunOptions
) -> tuple[dict[str, dict[str, Any]], RunOptions, str]:
    """
    Return the parameters, options and process name with which sonde, estimator and surface run in one process.

    The parameters of these nodes are written to a file in `folder`, which the options then name.
    """
    from mwd_surface.runs import launch_plan

    shared = {node: parameters[node] for node in launch_plan.WELL}
    file = folder / "parameters.yaml"
    file.write_text(launch_plan.parameter_yaml(shared, namespace), encoding="utf-8")
    others = {node: given for node, given in parameters.items() if node not in shared}
    words = [*options.words, "--params-file", str(file.resolve())]
    return {"well": {}, **others}, dataclasses.replace(options, words=words), "well"


class StartError(RuntimeError):
    """Raised if the graph did not start; the message names the node and the reason."""


class _Interrupts:
    """Context that counts the signals SIGINT and SIGTERM, which do not end the process in its block."""

    def __init__(self) -> None:
        self.count = 0

    def __enter__(self) -> _Interrupts:

        def note(_number: int, _frame: Any) -> None:
            self.count += 1

        self._before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *_: object) -> None:

        for number, handler in self._before.items():
            signal.signal(number, handler)


def _wait_until_ready(supervisor: Supervisor, interrupts: _Interrupts, address: str, logs: Path) -> bool:
    """
    Wait until the page answers and reports the estimator as active; return False if interrupted.

    A slow start is not an error: the reason for waiting is printed every half minute. StartError: a node fails.
    """
    began = printed = time.monotonic()
    with terminal.waiting("starting the nodes; at the first start, their filters are compiled, which can take minutes"):
        while not interrupts.count:
            supervisor.watch()
            if supervisor.failing:
                raise StartError("; ".join(supervisor.failing))
            words = {log.stem: log.read_text(errors="replace") for log in logs.glob("*.log")}
            missing = waits_for(_state(address), words)
            if not missing:
                return True
            now = time.monotonic()
            if now - printed > _SAY_EVERY:
                printed = now
                terminal.remark(f"not ready after {now - began:.0f} s: {missing}")
            time.sleep(_POLL)
    return False


def waits_for(state: dict[str, Any], logs: dict[str, str]) -> str:
    """
    Return the reason why the scenario cannot be played yet; empty if it can be played.

    state: sections of the page, empty while the page does not answer. logs: log text of each node, by node name.
    Raise StartError if a node reports that it cannot be configured; such a node does not end, but waits for corrected
    parameters.
    """
    for node, words in logs.items():
        _, found, reason = words.partition("cannot configure: ")
        if found:
            raise StartError(f"{node} cannot start: {reason.splitlines()[0]}")
    if any("preparing the filters" in words and "the filters are ready" not in words for words in logs.values()):
        return "a node is compiling its filters"
    if not state:
        return "the surface node is starting, its page does not answer yet"
    rows = state.get("diagnostics", {}).get("rows", [])
    heard = next((row["message"] for row in rows if row["name"].endswith("estimator: lifecycle")), None)
    if heard is None:
        return "the surface node receives nothing from the estimator (`mwd doctor` checks the network between them)"
    return "" if heard == "active" else f"the estimator is {heard}"


def _run_to_end(
    supervisor: Supervisor, interrupts: _Interrupts, address: str, name: str, last: str, hold: bool
) -> None:
    """
    Wait until the scenario is over or the user interrupts it, and show the progress.

    last: process whose end is the end of the scenario. hold: whether to wait for an interrupt after the scenario.
    """
    from mwd_surface.page.summary_line import summary_line

    shown = 0.0
    over: float | None = None
    with terminal.live_line() as show:
        while not interrupts.count:
            supervisor.watch()
            now = time.monotonic()
            if over is None and supervisor.finished(last):
                over = now
                if hold:
                    terminal.remark(f"{name} is over; the graph keeps running until Ctrl-C")
            if over is not None and now - over > _SETTLE and not hold:
                return
            if now - shown > 0.5:
                shown = now
                state = _state(address)
                show(f"{name}{_how_far(state)}: {summary_line(state)}")
            time.sleep(_POLL)


def _how_far(state: dict[str, Any]) -> str:
    """Return the progress of the scenario with a leading space, from the sonde's diagnostics; empty if unknown."""
    rows = state.get("diagnostics", {}).get("rows", [])
    return next((f" {row['message']}" for row in rows if row["name"].endswith("sonde: scenario")), "")


def _state(address: str) -> dict[str, Any]:
    """Return the sections of the live page from its state.json; empty while the page does not answer."""
    import json
    import urllib.request

    # Use no proxy, because the page is on this machine.
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(f"{address}state.json", timeout=1.0) as answer:
            state = json.load(answer)
    except (OSError, ValueError):
        return {}
    return state.get("sections", {}) if isinstance(state, dict) else {}
