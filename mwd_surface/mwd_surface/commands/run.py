"""`mwd run`: the whole graph of one well, from simulated sonde to live page and recording."""

from __future__ import annotations

import dataclasses
import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mwd_surface.commands.run_options import (
    Hold,
    Params,
    Plan,
    Set,
    Token,
    page_secret,
    parameter_file,
    set_parameters,
)

if TYPE_CHECKING:
    from rich.console import Console

    from mwd_sensors.simulator.scenario import Scenario
    from mwd_surface.runs.supervise import Supervisor
    from mwd_surface.surveys.score import Scored

_READY_WITHIN = 120.0  # s from the start, or from when the filters were ready
_PREPARED_WITHIN = 900.0  # s for the filters, which the first start on a machine compiles: minutes on a busy one
_SETTLE = 1.5  # s between the last sample and the end, for what is still on its way
_POLL = 0.1


def run(
    scenario: Annotated[str, typer.Argument(help="Name (see `mwd scenario list`) or YAML file.")] = "demo",
    well: Annotated[str, typer.Option(help="Name of the well: the namespace of its topics.")] = "well_1",
    port: Annotated[int | None, typer.Option(help="Port of the live page; by default 8080 or a free one.")] = None,
    rate: Annotated[float, typer.Option(help="Seconds of the run in a second; 0: as fast as possible.")] = 1.0,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for recording, surveys and logs; else out/TIME_WELL.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Replaces the scenario's seed.")] = None,
    method: Annotated[str | None, typer.Option(help="Gravity extraction of the estimator.")] = None,
    no_record: Annotated[
        bool, typer.Option("--no-record", help="Record nothing; there is no table at the end.")
    ] = False,
    no_rig: Annotated[
        bool, typer.Option("--no-rig", help="No interfaces to the rig; otherwise WITS, OPC UA, Modbus on this machine.")
    ] = False,
    hold: Hold = False,
    token: Token = None,
    plan: Plan = None,
    changes: Set = None,
    params: Params = None,
) -> None:
    """
    Play a scenario through the whole graph: sonde, estimator, surface, live page and recording.

    Ends with the scenario or with Ctrl-C, and then compares each survey with the truth. Several runs can go on side by
    side: each has a middleware domain, a port and a folder of its own.

    \b
    Examples:
      mwd run
      mwd run horizontal_east_west --rate 5
      mwd run --well pad_7/well_2 --port 8082 -o logs/well_2
      mwd run --hold --token new --plan plan.csv --set survey.duration_s=12
    """
    from mwd_sensors.simulator import scenario_files
    from mwd_sensors.simulator.scenario import read
    from mwd_surface.bags.recorder.folder import recordings_named
    from mwd_surface.commands import node, terminal
    from mwd_surface.runs import launch_plan

    with node.without_ros():
        importlib.import_module("mwd_msgs")
    namespace = launch_plan.checked_well(well)
    path = scenario_files.find(scenario).resolve()
    story = read(path, {} if seed is None else {"seed": seed})
    if not 0.0 <= rate <= 1000.0:
        raise ValueError(f"--rate {rate:g}: must be from 0 to 1000")
    if story.telemetry is not None and rate == 0.0:
        raise ValueError("--rate 0: a scenario with telemetry needs a pace; try --rate 5")
    folder = _new_folder(output, namespace)
    (folder / "logs").mkdir(parents=True, exist_ok=True)
    console = terminal.output()
    if story.rig.time_lapse > 1.0:
        console.print(f"compressed time: hole is made {story.rig.time_lapse:g} times as fast as its rate says")
    name = folder.name if output is None else f"{namespace.replace('/', '_')}_{_now_text()}"
    parameters = _parameters(story, path, method=method, rate=rate, seed=seed)
    if story.well.plan:
        parameters["surface"]["plan.file"] = str(_written_plan(story, folder).resolve())
    parameters["surface"] |= {
        "folder": str(folder.resolve()),
        "record.enabled": not no_record,
        "record.name": name,
        "well.name": namespace,
    }
    if story.telemetry is not None:
        _add_link(parameters, story, folder.resolve())
    if plan is not None:
        parameters["surface"]["plan.file"] = str(plan.resolve(strict=True))
    parameters["surface"] |= page_secret(token, folder)
    set_parameters(parameters, changes)
    plans = _Plans(port, not no_rig, hold, parameter_file(params))
    _run_graph(story.name, namespace, parameters, folder, plans)
    truth = folder / "truth.csv" if story.telemetry is not None else None
    for bag in recordings_named(folder / namespace.replace("/", "_") / "bags", name):
        _conclude(console, bag, truth)
    console.print(f"surveys and logs: {folder}", markup=False)


def _written_plan(story: Scenario, folder: Path) -> Path:
    """Write the planned path of a scenario as the file that the surface node reads."""
    lines = [f"{md},{inclination},{azimuth}" for md, inclination, azimuth in story.well.plan]
    file = folder / f"{story.name}.csv"
    file.write_text("\n".join(["# north: true", "md_m,inc_deg,azi_deg", *lines, ""]), encoding="utf-8")
    return file


@dataclasses.dataclass(frozen=True)
class _Plans:
    """How the graph is run: port of the page, rig interfaces, staying after the scenario, words of every node."""

    port: int | None
    rig: bool
    hold: bool
    words: list[str]


def _run_graph(story: str, namespace: str, parameters: dict[str, dict[str, Any]], folder: Path, plans: _Plans) -> None:
    """Start the nodes, play the scenario to its end or until somebody interrupts, and stop them."""
    import contextlib
    import os

    from mwd_surface.commands import terminal
    from mwd_surface.runs import launch_plan
    from mwd_surface.runs.supervise import Order, Supervisor

    console, logs = terminal.output(), folder / "logs"
    own_domain, page_port = launch_plan.own_domain(os.environ), launch_plan.page_port(plans.port)
    with own_domain as domain, page_port as page, contextlib.ExitStack() as held, _Interrupts() as interrupts:
        interfaces = {} if not plans.rig else held.enter_context(launch_plan.rig_parameters())
        parameters["surface"] |= {**interfaces, "page.port": page}
        orders = {
            node: Order(node, launch_plan.node_words(node, namespace, given, plans.words), logs / f"{node}.log")
            for node, given in parameters.items()
        }
        address = f"http://127.0.0.1:{page}/"
        environment = launch_plan.graph_environment(os.environ, domain, logs)
        supervisor = Supervisor(environment, terminal.warn)
        try:
            for node in (name for name in orders if name != "sonde"):
                supervisor.start(orders[node])
            if _wait_until_ready(supervisor, interrupts, address, logs):
                console.print(f"{story}: page at {address} (well /{namespace}, domain {domain})", markup=False)
                if plans.rig:
                    where = ", ".join(launch_plan.rig_addresses(interfaces))
                    console.print(f"rig: {where} (`mwd rig status {folder}`)", markup=False)
                supervisor.start(orders["sonde"])
                _run_to_end(supervisor, interrupts, address, story, plans.hold)
        except _StartError as error:
            terminal.warn(f"{error}; logs in {logs}")
            raise typer.Exit(1) from error
        finally:
            killed = supervisor.stop((("sonde", "estimator"), ("receiver",), ("surface",)))
    for node in killed:
        terminal.warn(f"{node} did not end by itself and was killed")


def _parameters(
    story: Scenario, path: Path, *, method: str | None, rate: float, seed: int | None
) -> dict[str, dict[str, Any]]:
    """Return the parameters of the nodes that follow from the scenario."""
    from mwd_surface.runs import launch_plan

    sonde: dict[str, Any] = {
        "scenario": str(path),
        "rate": rate,
        "exit_at_end": True,
        "fault_injection": True,
        "wait_for_listener_s": 10.0,
    }
    return {
        "surface": {
            **story.surface,
            "strict": True,
            "well.sensor_to_bit": story.well.sensor_to_bit_m,
            "well.latitude_deg": float(story.place.latitude_deg),
            "well.longitude_deg": float(story.place.longitude_deg),
        },
        "estimator": launch_plan.reference_parameters(story) | ({"gravity.method": method} if method else {}),
        "sonde": sonde | ({"seed": seed} if seed is not None else {}),
    }


class _StartError(RuntimeError):
    """The graph did not start; the message says which node and why."""


def _add_link(parameters: dict[str, dict[str, Any]], story: Scenario, folder: Path) -> None:
    """Let the surface hear the tool through the scenario's link alone: one tool configuration for both ends."""
    from mwd_sensors.telemetry import tool_configuration
    from mwd_surface.runs import launch_plan

    if story.telemetry is None:
        return
    tool_file = folder / "tool.yaml"
    tool_file.write_text(tool_configuration.text(story.telemetry.tool), encoding="utf-8")
    # The truth goes past the surface, which subscribes to nothing of the tool.
    parameters["sonde"]["truth_file"] = str(folder / "truth.csv")
    parameters["estimator"]["transmit.tool_file"] = str(tool_file)
    parameters["surface"]["link.source"] = "mud_pulse"
    parameters["receiver"] = {"tool_file": str(tool_file), **launch_plan.reference_parameters(story)}


class _Interrupts:
    """Counts SIGINT and SIGTERM while the block runs."""

    def __init__(self) -> None:
        self.count = 0

    def __enter__(self) -> _Interrupts:
        import signal

        def note(_number: int, _frame: Any) -> None:
            self.count += 1

        self._before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *_: object) -> None:
        import signal

        for number, handler in self._before.items():
            signal.signal(number, handler)


def _now_text() -> str:
    import datetime

    return f"{datetime.datetime.now(tz=datetime.UTC):%Y%m%d_%H%M%S}"


def _new_folder(output: Path | None, namespace: str) -> Path:
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
        return output
    base = Path("out") / f"{_now_text()}_{namespace.replace('/', '_')}"
    folder, k = base, 1
    while folder.exists():
        k += 1
        folder = base.with_name(f"{base.name}_{k}")
    folder.mkdir(parents=True)
    return folder


def _wait_until_ready(supervisor: Supervisor, interrupts: _Interrupts, address: str, logs: Path) -> bool:
    """Until the page answers and says that the estimator is active; False when interrupted."""
    import time

    from mwd_surface.commands import terminal

    began = last = time.monotonic()
    with terminal.waiting("starting the nodes; the first time their filters are compiled"):
        while not interrupts.count:
            supervisor.watch()
            if supervisor.failing:
                raise _StartError("; ".join(supervisor.failing))
            rows = _state(address).get("findings", {}).get("rows", [])
            if any(row["name"].endswith("estimator: lifecycle") and row["message"] == "active" for row in rows):
                return True
            now = time.monotonic()
            for log in logs.glob("*.log"):
                words = log.read_text(errors="replace")
                # A node that cannot open its topics, files or port lives on, unconfigured, for somebody to mend it.
                _, found, reason = words.partition("cannot configure: ")
                if found:
                    raise _StartError(f"{log.stem} cannot start: {reason.splitlines()[0]}")
                if "preparing the filters" in words and "the filters are ready" not in words:
                    last = now
            if now - last > _READY_WITHIN or now - began > _PREPARED_WITHIN:
                raise _StartError(f"the nodes are not ready after {now - began:.0f} s")
            time.sleep(_POLL)
    return False


def _run_to_end(supervisor: Supervisor, interrupts: _Interrupts, address: str, name: str, hold: bool) -> None:
    """Until the scenario is over, unless the graph is held, or somebody interrupts."""
    import time

    from mwd_surface.commands import terminal
    from mwd_surface.page.summary_line import summary_line

    shown = 0.0
    over: float | None = None
    with terminal.live_line() as show:
        while not interrupts.count:
            supervisor.watch()
            now = time.monotonic()
            if over is None and supervisor.finished("sonde"):
                over = now
                if hold:
                    terminal.remark(f"{name} is over; the graph stays until Ctrl-C")
            if over is not None and now - over > _SETTLE and not hold:
                return
            if now - shown > 0.5:
                shown = now
                state = _state(address)
                show(f"{name}{_how_far(state)}: {summary_line(state)}")
            time.sleep(_POLL)


def _how_far(state: dict[str, Any]) -> str:
    """Say how much of the scenario is over, by the diagnostics of the sonde."""
    rows = state.get("findings", {}).get("rows", [])
    return next((f" {row['message']}" for row in rows if row["name"].endswith("sonde: scenario")), "")


def _state(address: str) -> dict[str, Any]:
    """What the page shows; empty while it does not answer."""
    import json
    import urllib.request

    # Past any proxy: the page is on this machine.
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(f"{address}state.json", timeout=1.0) as answer:
            state = json.load(answer)
    except (OSError, ValueError):
        return {}
    return state.get("sections", {}) if isinstance(state, dict) else {}


def _conclude(console: Console, bag: Path, truth: Path | None) -> None:
    from mwd_surface.bags.bag_reader import Bag, BagError
    from mwd_surface.commands import terminal
    from mwd_surface.surveys.score import score

    try:
        with Bag(bag) as opened:
            _show_scores(console, score(opened, truth=truth))
            for note in opened.notes:
                terminal.warn(note)
            console.print(f"recording: {bag} ({opened.message_count} messages)", markup=False)
    except BagError as error:
        terminal.warn(str(error))


def _show_scores(console: Console, scored: list[Scored]) -> None:
    import math

    from rich.table import Table
    from rich.text import Text

    from mwd_surface.commands.survey_table import COLOURS, show_actions

    if not scored:
        console.print("no survey was taken", markup=False)
        return
    table = Table(
        title="surveys against the truth (deg, azimuth from true north)",
        title_justify="left",
        box=None,
        padding=(0, 1, 0, 0),
        header_style="dim",
    )
    columns = ("no", "depth m", "incl", "error", "azi", "error", "sigma", "true", "uncorr", "corr")
    for column in columns:
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)

    def deg(value: float | None, sign: str = "") -> str:
        return "-" if value is None else f"{math.degrees(value):{sign}.2f}"

    for row in scored:
        verdict = row.verdict.name.lower()
        table.add_row(
            str(row.sequence),
            f"{row.measured_depth:.1f}",
            deg(row.measured_inclination),
            deg(row.inclination_error, "+"),
            deg(row.chosen),
            deg(row.azimuth_error, "+"),
            deg(row.sigma_azimuth),
            deg(row.azimuth),
            deg(row.raw),
            deg(row.corrected),
            Text(verdict, style=COLOURS[verdict]),
        )
    console.print(table, soft_wrap=False)
    show_actions(console, [(row.sequence, row.verdict.name.lower(), row.action) for row in scored])
