# SPDX-License-Identifier: Apache-2.0
"""`mwd view`: live page of a recording, with a time slider."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mwd_surface.commands import terminal
from mwd_surface.commands.shared_options import (
    READING,
    PlanSet,
    Reading,
    given_names,
    input_settings,
    read_plan_option,
    takes,
)
from mwd_surface.commands.sources import estimated

if TYPE_CHECKING:
    from mwd_surface.bags.bag_reader import Bag
    from mwd_surface.page.page_server import PageServer
    from mwd_surface.runs.player import Player, Playing
    from mwd_surface.trajectory.plan import Plan

_PERIOD_S = 0.1  # time between two states of the page, s
_LOOK_S = 0.5  # duration of a seek after which an intermediate state is shown, s


@takes(READING)
def view(
    run: Annotated[Path, typer.Argument(metavar="RUN|BAG", help="Folder of a run, or a recording.")],
    port: Annotated[int | None, typer.Option(help="Port of the page; by default 8080 or a free one.")] = None,
    rate: Annotated[float, typer.Option(help="Speed relative to real time.")] = 1.0,
    paused: Annotated[
        bool, typer.Option("--paused", help="Start paused; the play button starts the playback.")
    ] = False,
    plan: Annotated[
        Path | None, typer.Option(help="File of the planned path; by default the plan that the recording names.")
    ] = None,
    plan_set: PlanSet = None,
    *,
    reading: Reading,
) -> None:
    """
    Show a recording on the live page: play it at any speed, and go to any moment with the slider.

    A recording without estimates is processed first, with the settings in the recording and the input options. If RUN
    is a folder of `mwd process`, its recording is processed with the settings of these results. The command needs no
    ROS, and ends with Ctrl-C.

    \b
    Examples:
      mwd view out/first
      mwd view mine
      mwd view bags/run_7 --rate 10 --start 600
    """
    from mwd_surface.bags.bag_reader import Bag, BagError
    from mwd_surface.page.page_server import PageServer
    from mwd_surface.page.settings import PageSettings
    from mwd_surface.processing.bag_input import worth_saying
    from mwd_surface.processing.run_config import processed_input
    from mwd_surface.runs import launch_plan
    from mwd_surface.runs.bundle import newest_recording
    from mwd_surface.runs.player import Player, Playing, namespace_of, recorded_well

    if not 0.01 <= rate <= 1000.0:
        raise ValueError(f"--rate {rate:g}: must be from 0.01 to 1000")
    if not run.exists():
        raise FileNotFoundError(2, "run or recording not found", str(run))
    recording, read = newest_recording(run), None
    if recording is None:
        read = processed_input(run)
        if read is None:
            raise BagError(
                f"{run} contains no recording", "name a recording, or the folder of `mwd run` or `mwd process`"
            )
        recording = read.recording
    asked = Playing(not paused, rate, reading["start_s"] or 0.0)
    with contextlib.ExitStack() as held:
        bag = held.enter_context(Bag(recording))
        terminal.warn(*worth_saying(bag))
        planned = _plan(bag, plan, plan_set)
        settings = recorded_well(bag, namespace_of(bag))
        if not namespace_of(bag):
            bag = held.enter_context(estimated(bag, input_settings({**reading, "start_s": None}), read))
        elif names := given_names({**reading, "start_s": None}):
            raise ValueError(
                f"{names[0]}: omit this option, because {recording} contains estimates, which are shown as recorded"
            )
        elif read is not None:
            terminal.remark("the estimates in the recording are shown, not those of these results")
        player = Player(bag, namespace_of(bag), settings, planned)
        page_port = held.enter_context(launch_plan.page_port(port))

        def on_replay(given: dict[str, float | bool]) -> None:
            asked.playing = bool(given.get("playing", asked.playing))
            asked.rate = float(given.get("rate", asked.rate))
            asked.seek_s = float(given["seek"]) if "seek" in given else asked.seek_s

        server = PageServer(PageSettings(port=page_port), on_replay=on_replay, now=lambda: player.well.clock.now)
        server.start()
        held.callback(server.stop)
        terminal.tell(f"{recording}: page at {server.address}; Ctrl-C ends")
        with contextlib.suppress(KeyboardInterrupt):
            _play(player, asked, server)


def _play(player: Player, asked: Playing, server: PageServer) -> None:
    """Play the recording on the page until interrupted; show intermediate states during a long seek."""
    from mwd_surface.page.state_json import StateJson

    settings = player.well.live.settings
    shown = StateJson(settings)
    before = time.monotonic()
    while True:
        now = time.monotonic()
        passed, before = now - before, now
        seek_s, asked.seek_s = asked.seek_s, None
        if seek_s is not None:
            if player.seek(seek_s, _LOOK_S):
                shown = StateJson(settings, revised_from=shown)
            if player.at_s < player.clipped(seek_s) and asked.seek_s is None:
                asked.seek_s = seek_s
        elif asked.playing:
            player.advance(passed * asked.rate)
            asked.playing = player.at_s < player.length_s
        seeking = asked.seek_s is not None
        replay = {
            "at": player.at_s,
            "length": player.length_s,
            "playing": asked.playing,
            "rate": asked.rate,
            "seeking": seeking,
        }
        server.push({**shown.snapshot(player.state()), "server": {"replay": replay}})
        time.sleep(0.0 if seeking else max(0.0, _PERIOD_S - (time.monotonic() - now)))


def _plan(bag: Bag, path: Path | None, said: list[str] | None) -> Plan | None:
    """
    Return the plan of a file, or else the plan or design that the recording names; None if there is no plan.

    path, said: values of --plan and --plan-set. A named file that is not on this machine counts as no plan, with a
    remark. Raises ListFileError if the file of the plan cannot be read.
    """
    from mwd_surface.list_files.list_error import ListFileError
    from mwd_surface.list_files.list_settings import asked
    from mwd_surface.live.plan_monitor import PlanMonitor
    from mwd_surface.runs.player import recorded_surface
    from mwd_surface.surveys.recorded_settings import recorded_settings
    from mwd_surface.surveys.well import Well
    from mwd_surface.trajectory.plan import Plan, read_plan

    if path is not None or said:
        return read_plan_option(path, said)
    surface = recorded_surface(bag)
    named = surface.plan
    if not named.file:
        designed = PlanMonitor.read(named, recorded_settings(bag).well(Well()))
        return designed if isinstance(designed, Plan) else None
    file = Path(named.file).expanduser()
    if not file.is_file():
        terminal.remark(f"the plan of this recording, {file}, is not on this machine; give it with --plan")
        return None
    try:
        return read_plan(file, given=named.given().with_dip(surface.well.angles.points))
    except ListFileError as error:
        raise asked(error, "--plan-set {}={}") from error
