# SPDX-License-Identifier: Apache-2.0
"""`mwd run`: run the whole graph of one well, from simulated sonde to live page and recording."""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import importlib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mwd_sensors.core.angle_convention import AngleConvention
from mwd_surface.commands import terminal
from mwd_surface.commands.run_graph import RunOptions, run_graph
from mwd_surface.commands.run_options import (
    give_parameters,
    page_secret,
    parameter_file,
)
from mwd_surface.commands.scenario import Seed, scenario_names
from mwd_surface.commands.shared_options import PlanSet, assigned

if TYPE_CHECKING:
    from mwd_sensors.simulator.scenario import Scenario
    from mwd_surface.surveys.score import Scored

_SETTINGS = "Settings"


def run(
    scenario: Annotated[
        str,
        typer.Argument(
            help="Scenario: a name (see `mwd scenario list`) or a YAML file.", autocompletion=scenario_names
        ),
    ] = "demo",
    well: Annotated[str, typer.Option(help="Name of the well: the namespace of its topics.")] = "well_1",
    port: Annotated[int | None, typer.Option(help="Port of the live page; by default 8080 or a free one.")] = None,
    rate: Annotated[float, typer.Option(help="Speed relative to real time; 0: as fast as possible.")] = 1.0,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder for recording, surveys and logs; by default out/TIME_WELL."),
    ] = None,
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Continue the survey list of an earlier run of this well in the folder of -o."),
    ] = False,
    seed: Seed = None,
    method: Annotated[
        str | None, typer.Option(help="Method that estimates gravity; `mwd doctor` lists the methods.")
    ] = None,
    no_record: Annotated[
        bool, typer.Option("--no-record", help="Do not record; surveys are then not compared with the truth.")
    ] = False,
    no_rig: Annotated[
        bool, typer.Option("--no-rig", help="Do not start the rig interfaces (WITS, OPC UA, Modbus) on this machine.")
    ] = False,
    single_process: Annotated[
        bool,
        typer.Option(
            "--single-process",
            help="Run sonde, estimator and surface in one process: less CPU time, but a crash ends all three.",
        ),
    ] = False,
    hold: Annotated[bool, typer.Option("--hold", help="Keep running after the scenario, until Ctrl-C.")] = False,
    token: Annotated[
        str | None,
        typer.Option(
            help="Secret for the operator controls of the page, 8 characters or more; `new` creates and prints one.",
            rich_help_panel=_SETTINGS,
        ),
    ] = None,
    plan: Annotated[
        Path | None,
        typer.Option(help="File of the planned path, in any format that `mwd path` reads.", rich_help_panel=_SETTINGS),
    ] = None,
    plan_set: PlanSet = None,
    changes: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="Set one parameter, e.g. estimator.survey.duration_s=12. The name of the node may be omitted if only "
            "one node has the parameter. May be repeated.",
            metavar="NAME=VALUE",
            rich_help_panel=_SETTINGS,
        ),
    ] = None,
    params: Annotated[
        Path | None,
        typer.Option(help="ROS parameter file for the nodes named in it.", rich_help_panel=_SETTINGS),
    ] = None,
) -> None:
    """
    Play a scenario through the whole graph: sonde, estimator, surface, live page and recording.

    The command ends with the scenario or with Ctrl-C, and then compares each survey with the simulated truth. Several
    runs can be active at the same time: each has its own ROS domain, port and folder.

    \b
    Examples:
      mwd run
      mwd run horizontal_east_west --rate 5
      mwd run --well pad_7/well_2 --port 8082 -o logs/well_2
      mwd run --hold --token new --plan plan.csv --set survey.duration_s=12
    """
    from mwd_sensors.simulator import scenario_files
    from mwd_sensors.simulator.scenario import read
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
        raise ValueError("--rate 0: a scenario with telemetry needs a finite rate; try --rate 5")
    folder = _new_folder(output, namespace, resume=resume)
    (folder / "logs").mkdir(parents=True, exist_ok=True)
    if story.rig.time_lapse > 1.0:
        terminal.tell(
            f"compressed time: the depth grows {story.rig.time_lapse:g} times as fast as by the rate of penetration"
        )
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
    _add_link(parameters, story, folder.resolve())
    parameters["surface"] |= _given_plan(plan, plan_set) | page_secret(token, folder)
    parameters["sonde"]["exit_at_end"] = not (single_process and hold)
    from_true_north = dict(parameters["surface"])
    words = parameter_file(params)
    given: dict[str, Any] = {"--port": port, "--method": method, "--seed": seed, "--plan": plan and str(plan.resolve())}
    given |= {"--rate": None if rate == 1.0 else rate, "--no-record": False if no_record else None}
    given |= {"--token": parameters["surface"].get("page.token_file")}
    asked = {option: value for option, value in given.items() if value is not None}
    give_parameters(parameters, namespace, changes=changes, params=params, options=asked)
    wanted_port = parameters["surface"].pop("page.port", 0) or port
    _drop_tie_on_from_true_north(parameters["surface"], from_true_north)
    options = RunOptions(wanted_port, not no_rig, hold, words, single_process)
    run_graph(story.name, namespace, parameters, folder, options)
    truth = Path(parameters["sonde"]["truth_file"]) if story.telemetry is not None else None
    recorded_in, recorded = folder / namespace.replace("/", "_") / "bags", parameters["surface"]["record.enabled"]
    # Import the recorder only now: its libraries would delay the start of the run.
    from mwd_surface.bags.recorder.recorder import recordings_named

    if recorded:
        bags = recordings_named(recorded_in, parameters["surface"]["record.name"])
        _conclude(bags, truth, AngleConvention(parameters["surface"].get("well.convention", "inclination")))
    terminal.tell(f"surveys and logs: {folder}")


def _given_plan(path: Path | None, said: list[str] | None) -> dict[str, Any]:
    """
    Return the parameters of the surface node for the plan of --plan; empty without a plan.

    Raise ValueError if settings for reading a plan are given without a plan.
    """
    if path is None:
        if said:
            raise ValueError("--plan-set: has no effect without --plan")
        return {}
    words = dataclasses.asdict(assigned(said, "--plan-set")).items()
    return {"plan.file": str(path.resolve(strict=True)), **{f"plan.{name}": word for name, word in words if word}}


def _drop_tie_on_from_true_north(surface: dict[str, Any], from_true_north: Mapping[str, Any]) -> None:
    """
    Remove the tie-on of the scenario if the user sets another north for the well.

    The tie-on of a scenario has its azimuth from true north. Without a tie-on, the path reports that its start is
    assumed.
    """
    from mwd_surface.runs import launch_plan

    if surface.get("well.north_reference", "true") != "true":
        for name, value in from_true_north.items():
            if name.startswith(launch_plan.TIE_ON) and surface.get(name) == value:
                del surface[name]


def _written_plan(story: Scenario, folder: Path) -> Path:
    """Write the planned path of a scenario to a file for the surface node; return the path of the file."""
    lines = [f"{md},{angle},{azimuth}" for md, angle, azimuth in story.well.plan]
    column = AngleConvention(story.well.convention).column
    file = folder / f"{story.name}.csv"
    file.write_text("\n".join(["# north: true", f"md_m,{column},azi_deg", *lines, ""]), encoding="utf-8")
    return file


def _parameters(
    story: Scenario, path: Path, *, method: str | None, rate: float, seed: int | None
) -> dict[str, dict[str, Any]]:
    """Return the parameters of each node that follow from the scenario and from method, rate and seed."""
    from mwd_surface.runs import launch_plan

    sonde: dict[str, Any] = {
        "scenario": str(path),
        "rate": rate,
        "exit_at_end": True,
        "fault_injection": True,
        "wait_for_listener_s": 10.0,
    }
    return {
        "surface": {**launch_plan.surface_parameters(story), "strict": True},
        "estimator": launch_plan.estimator_parameters(story) | ({"gravity.method": method} if method else {}),
        "sonde": sonde | ({"seed": seed} if seed is not None else {}),
    }


def _add_link(parameters: dict[str, dict[str, Any]], story: Scenario, folder: Path) -> None:
    """
    Change the parameters so that the surface receives the tool only over the scenario's telemetry links.

    One tool file per link is written into `folder`. A scenario without telemetry changes nothing.
    """
    from mwd_sensors.telemetry import tool_configuration
    from mwd_surface.runs import launch_plan

    if story.telemetry is None:
        return
    files = {}
    for name, tool in zip(("tool_file", "second_tool_file"), story.telemetry.tools, strict=False):
        files[name] = folder / (name.removesuffix("_file") + ".yaml")
        files[name].write_text(tool_configuration.text(tool), encoding="utf-8")
    # Write the truth to a file, because the surface, which would record it, subscribes to no topic of the tool.
    parameters["sonde"]["truth_file"] = str(folder / "truth.csv")
    parameters["estimator"] |= {f"transmit.{name}": str(file) for name, file in files.items()}
    parameters["surface"]["tool_file"] = str(files["tool_file"])
    if story.telemetry.tool.downlink is not None:
        parameters["surface"]["downlink.tool_file"] = str(files["tool_file"])
    parameters["surface"]["link.source"] = "best" if len(files) > 1 else story.telemetry.tool.link
    parameters["receiver"] = {name: str(file) for name, file in files.items()}
    parameters["receiver"] |= launch_plan.reference_parameters(story)


def _now_text() -> str:
    return f"{datetime.datetime.now(tz=datetime.UTC):%Y%m%d_%H%M%S}"


def _new_folder(output: Path | None, namespace: str, *, resume: bool) -> Path:
    if output is not None:
        if not resume and (output / namespace.replace("/", "_")).exists():
            raise ValueError(
                f"{output} already contains a run of {namespace}; give a new folder with -o, or continue the survey "
                "list of this run with --resume"
            )
        output.mkdir(parents=True, exist_ok=True)
        return output
    base = Path("out") / f"{_now_text()}_{namespace.replace('/', '_')}"
    folder, k = base, 1
    while folder.exists():
        k += 1
        folder = base.with_name(f"{base.name}_{k}")
    folder.mkdir(parents=True)
    return folder


def _conclude(bags: Sequence[Path], truth: Path | None, convention: AngleConvention) -> None:
    """Compare the surveys in the recordings of a run with the truth; the recordings follow each other."""
    from mwd_surface.bags.bag_reader import Bag, BagError
    from mwd_surface.surveys.score import score, unlisted

    with contextlib.ExitStack() as held:
        opened: dict[Path, Bag] = {}
        for bag in bags:
            try:
                opened[bag] = held.enter_context(Bag(bag))
            except BagError as error:
                terminal.warn(str(error))
        try:
            if opened:
                _show_scores(score([*opened.values()], truth=truth), convention)
        except BagError as error:
            terminal.warn(str(error))
        for bag, one in opened.items():
            for lost in unlisted(one) if truth is not None else ():
                flow_on = datetime.datetime.fromtimestamp(lost.start_ns * 1e-9, tz=datetime.UTC)
                terminal.warn(
                    f"not in the list: the survey sent after flow-on at {flow_on:%H:%M:%S} UTC: {lost.reason}"
                )
            terminal.warn(*one.notes)
            terminal.tell(f"recording: {bag} ({one.message_count} messages)")


def _show_scores(scored: list[Scored], convention: AngleConvention) -> None:
    from rich.text import Text

    from mwd_surface.commands.survey_table import COLOURS, narrow_table, show_actions

    if not scored:
        terminal.tell("no survey was recorded")
        return
    angle = convention.heading if convention.points else "incl"
    columns = ("nr", "depth m", angle, "error", "azi", "error", "sigma", "true", "uncorr", "corr", "verdict")
    table = narrow_table("surveys against the truth (deg, azimuth from true north)", columns)

    def deg(value: float | None, sign: str = "") -> str:
        return "-" if value is None else f"{math.degrees(value):{sign}.2f}"

    for row in scored:
        verdict = row.verdict.name.lower()
        table.add_row(
            str(row.sequence),
            f"{row.measured_depth:.1f}",
            deg(convention.shown(row.measured_inclination)),
            deg(convention.sign * row.inclination_error, "+"),
            deg(row.chosen),
            deg(row.azimuth_error, "+"),
            deg(row.sigma_azimuth),
            deg(row.azimuth),
            deg(row.raw),
            deg(row.corrected),
            Text(verdict, style=COLOURS[verdict]),
        )
    terminal.output().print(table, soft_wrap=False)
    show_actions([(row.sequence, row.verdict.name.lower(), row.action) for row in scored])
