# SPDX-License-Identifier: Apache-2.0
"""Each command that README, documents and help texts print exists as it is printed; none is run."""

import itertools
import re
import shlex

import pytest
import typer

from mwd_surface.cli import app
from mwd_surface.commands.node import MODULES
from project import ROOT, SCENARIOS

PAGES = sorted(
    page
    for page in (*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("mwd_*/README.md"), *ROOT.glob("bags/*.md"))
    if not page.is_relative_to(ROOT / "docs" / "_build") and page.name not in ("CHANGELOG.md", "benchmarks.md")
)
TOP = typer.main.get_command(app)
# Commands that take the name of a scenario, or a file.
OF_SCENARIOS = ("run", "simulate")


def _below(command):
    """Commands of a group; none of a command. Newer versions of typer carry a click of their own."""
    return getattr(command, "commands", {})


def _leaves(command, *names):
    if _below(command):
        for name, below in command.commands.items():
            yield from _leaves(below, *names, name)
    else:
        yield names, command


def fenced(text):
    """Commands of the blocks that a reader copies, lines that go on joined, remarks and prompts taken off."""
    for block in re.findall(r"^```(?:sh|bash|console|text)?\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            words = line.removeprefix("$ ")
            if re.match(r"(mwd|ros2 run) [a-z]", words):
                yield words


def inline(text):
    """Commands within a sentence."""
    prose = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    for words in re.findall(r"`((?:mwd|ros2 run) [a-z][^`]*)`", prose):
        yield " ".join(words.split())


def examples():
    """Commands of the help texts."""
    for names, command in _leaves(TOP):
        for line in (command.help or "").splitlines():
            if line.strip().startswith("mwd "):
                yield " ".join(names), line.strip()


def wrong(line, *, whole):
    """
    Say what is wrong with a command line; empty where nothing is.

    whole: the reader copies it as it stands; else words may be left out of it or stand for others.
    """
    first, *more = re.split(r" && |; ", line)
    words = [word for word in shlex.split(first, comments=True) if word not in ("&", "...", "…")]
    words = words[: next((k for k, word in enumerate(words) if word in (">", "|")), None)]
    for one in more:
        if one.startswith("mwd ") and (reason := wrong(one, whole=whole)):
            return reason
    if words[0] == "ros2":
        node = words[3] if len(words) > 3 else ""
        return "" if words[2] not in _packages() or node in _packages()[words[2]] else f"no node {node}"
    try:
        return _parsed(words[1:], whole=whole)
    except Exception as error:
        if not hasattr(error, "format_message"):
            raise
        reason = str(error.format_message())
        # A sentence may name an option without a value.
        return "" if reason.endswith("requires an argument.") and not whole else reason


def _packages():
    nodes = {name.value: module.partition(".")[0] for name, module in MODULES.items()} | {"replay": "mwd_surface"}
    return {package: [n for n, of in nodes.items() if of == package] for package in set(nodes.values())}


def _parsed(words, *, whole):
    command, context = TOP, TOP.context_class(TOP, info_name="mwd")
    while _below(command) and words:
        name, command, words = command.resolve_command(context, words)
        context = command.context_class(command, info_name=name, parent=context, **command.context_settings)
    if _below(command):
        return ""
    if not whole:
        command.make_parser(context).parse_args(list(words))
        return ""
    with command.make_context(context.info_name, list(words), parent=context.parent) as made:
        asked = made.params.get("scenario") or ""
    named = str(asked) if context.info_name in OF_SCENARIOS else ""
    known = not named or "." in named or (SCENARIOS / f"{named}.yaml").is_file()
    return "" if known else f"no scenario {named}"


def test_the_commands_of_every_page_exist_as_they_are_printed():
    found, faults = 0, []
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for line, whole in [*((one, True) for one in fenced(text)), *((one, False) for one in inline(text))]:
            found += 1
            if reason := wrong(line, whole=whole):
                faults.append(f"{page.relative_to(ROOT)}: {line}: {reason}")
    assert not faults, "\n".join(faults)
    assert found > 150


def test_the_examples_of_the_help_texts_are_commands():
    lines = list(examples())
    faults = [f"{names}: {line}: {reason}" for names, line in lines if (reason := wrong(line, whole=True))]
    assert not faults, "\n".join(faults)
    assert len(lines) > 40


TUTORIALS = sorted(ROOT.glob("docs/tutorials/*.md"))


def test_files_that_the_commands_of_a_tutorial_read_are_there():
    """A file is in the repository, or an earlier command writes it, or the page says what it is."""
    missing, read = [], 0
    for page in TUTORIALS:
        text = page.read_text(encoding="utf-8")
        described, written = set(re.findall(r"`([\w./-]+)`", text)), []
        for line in fenced(text):
            words = shlex.split(line, comments=True)
            for before, word in itertools.pairwise(words):
                name = word.rpartition(":=")[2]
                if before in ("-o", "--output", ">"):
                    written.append(word)
                elif re.search(r"[a-z]\.(csv|yaml|json|las|mcap)$", name):
                    read += 1
                    known = name in described or (ROOT / name).exists() or name.startswith(tuple(written))
                    missing += [] if known else [f"{page.name}: {line}: {name}"]
    assert not missing, "\n".join(missing)
    assert read > 10


def test_parameters_and_types_that_are_printed_exist():
    files = [file.read_text(encoding="utf-8") for file in ROOT.glob("mwd_*/config/*.yaml")]
    parameters = {key for text in files for key in re.findall(r"^[ #]*(\w+):", text, re.MULTILINE)}
    # The example of a controller is a node of its own.
    example = (ROOT / "tests" / "graph" / "toolface_hold_node.py").read_text(encoding="utf-8")
    parameters |= set(re.findall(r'declare_parameter\("(\w+)"', example))
    types = {f"{path.suffix[1:]}/{path.stem}" for path in ROOT.glob("mwd_msgs/*/*.*")}
    printed, named = set(), set()
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        printed |= set(re.findall(r"-p ([\w.]+):=", text))
        named |= set(re.findall(r"mwd_msgs/((?:msg|srv|action)/\w+)", text))
    assert {name for name in printed if name.rpartition(".")[2] not in parameters} == set()
    assert named - types == set()
    assert len(printed) > 8
    assert len(named) > 2


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("mwd proces bag -o out", "No such command"),
        ("mwd process bag --lattitude 3", "No such option"),
        ("mwd process bag --lat north", "--lat"),
        ("mwd process -o out", "Missing argument"),
        ("mwd run no_such_scenario", "no scenario"),
        ("mwd node estimtor", "is not one of"),
        ("ros2 run mwd_sensors estimator", "no node estimator"),
    ],
)
def test_a_command_that_does_not_exist_is_found(line, said):
    assert said in wrong(line, whole=True)
