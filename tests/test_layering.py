# SPDX-License-Identifier: Apache-2.0
"""The dependency rules: kernels import no ROS, packages and rooms depend one way, every module says what it is for."""

import ast
import collections
import functools
import graphlib
import xml.etree.ElementTree as ElementTree

import pytest

from project import ROOT, ROS

LINE = ("mwd_msgs", "mwd_sensors", "mwd_estimation", "mwd_surface")
MODULES = [path for package in LINE[1:] for path in sorted((ROOT / package / package).rglob("*.py")) if path.is_file()]
KERNELS = [path for path in MODULES if not {"nodes", "ros"} & set(path.parts)]
# Rooms by rank: a room imports only rooms of a lower rank, and no module outside rooms. Rooms of mwd_surface that are
# not listed only keep clear of circles.
RANKS = {
    "mwd_estimation": {
        "core": 0,
        "assembly": 0,
        "health": 1,
        "gravity": 2,
        "magnetic": 2,
        "gyrocompass": 2,
        "attitude": 3,
        "survey": 4,
        "downhole": 5,
        "settings": 6,
        "pipeline": 7,
        "nodes": 8,
    },
    "mwd_surface": {
        "bags": 0,
        "control": 0,
        "list_files": 0,
        "signals": 0,
        "trajectory": 1,
        "uncertainty": 2,
        "surveys": 3,
        "logs": 4,
        "clearance": 4,
    },
}
# Rooms that must not import each other, in either direction.
APART = [("mwd_surface.page", "mwd_surface.rig")]
# Modules outside the simulator that may use it: the node that plays it and the tools that record with it.
SIMULATOR = "mwd_sensors.simulator"
SIMULATOR_USERS = (SIMULATOR, "mwd_sensors.nodes", "mwd_surface.commands", "mwd_surface.runs")


@functools.cache
def _tree(path):
    return ast.parse(path.read_text(encoding="utf-8"))


@functools.cache
def _imports(path):
    """Dotted names a file imports, each name of a `from` import also with its module in front."""
    found = []
    for node in ast.walk(_tree(path)):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return found


def _module(path):
    """Dotted name of a file."""
    package = path.relative_to(ROOT).parts[0]
    return ".".join(path.relative_to(ROOT / package).with_suffix("").parts)


def _within(name, room):
    return name == room or name.startswith(room + ".")


def test_the_tree_is_there_to_be_checked():
    assert len(KERNELS) > 30


def test_kernels_import_no_ros():
    # A command may start a node, as `ros2 run` would.
    wrong = [
        f"{_module(path)} imports {name}"
        for path in KERNELS
        for name in _imports(path)
        if name.split(".")[0] in ROS or (path.parent.name != "commands" and {"nodes", "ros"} & set(name.split(".")))
    ]
    assert not wrong, "\n".join(wrong)


def test_packages_depend_one_way():
    wrong = [
        f"{_module(path)} imports {name}"
        for path in MODULES
        for name in _imports(path)
        if name.split(".")[0] in LINE[LINE.index(_module(path).split(".")[0]) + 1 :]
    ]
    assert not wrong, "\n".join(wrong)


@functools.cache
def _room(name):
    """The package of a dotted name and its room, or its module outside rooms; "" for the package itself."""
    package, _, rest = name.partition(".")
    room, folder = rest.partition(".")[0], ROOT / package / package
    return package, room if room and ((folder / room).is_dir() or (folder / f"{room}.py").is_file()) else ""


def test_every_room_of_the_estimator_has_a_rank():
    rooms = {_room(_module(path))[1] for path in MODULES if path.is_relative_to(ROOT / "mwd_estimation")}
    assert rooms - {"__init__"} == set(RANKS["mwd_estimation"])


def test_ranked_rooms_depend_one_way():
    wrong = []
    for path in MODULES:
        package, own = _room(_module(path))
        ranks = RANKS.get(package, {})
        for name in _imports(path) if own in ranks else ():
            into, room = _room(name)
            if into == package and room not in {"", own} and ranks.get(room, 9) >= ranks[own]:
                wrong.append(f"{_module(path)} imports {name}")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("depth", [2, 3])
def test_rooms_import_each_other_in_no_circle(depth):
    """Rooms of a package, and the rooms within a room."""
    rooms = {".".join(_module(path).split(".")[:depth]) for path in MODULES if _module(path).count(".") >= depth}
    imports = {room: set() for room in rooms}
    for path in MODULES:
        own = ".".join(_module(path).split(".")[:depth])
        for name in _imports(path):
            room = ".".join(name.split(".")[:depth])
            if own in rooms and room in rooms - {own}:
                imports[own].add(room)
    list(graphlib.TopologicalSorter(imports).static_order())  # raises with the rooms of a circle


def test_rooms_that_are_apart_do_not_import_each_other():
    pairs = [*APART, *(pair[::-1] for pair in APART)]
    wrong = [
        f"{_module(path)} imports {name}"
        for path in MODULES
        for name in _imports(path)
        if any(_within(_module(path), one) and _within(name, other) for one, other in pairs)
    ]
    assert not wrong, "\n".join(wrong)


def test_only_its_node_and_the_tools_import_the_simulator():
    wrong = [
        f"{_module(path)} imports {name}"
        for path in MODULES
        for name in _imports(path)
        if _within(name, SIMULATOR) and not any(_within(_module(path), user) for user in SIMULATOR_USERS)
    ]
    assert not wrong, "\n".join(wrong)


def test_every_module_says_what_it_is_for():
    wrong = [_module(path) for path in MODULES if not ast.get_docstring(_tree(path))]
    assert not wrong, "\n".join(wrong)


def test_package_xml_names_what_the_code_imports():
    wrong = []
    for package in LINE:
        tree = ElementTree.parse(ROOT / package / "package.xml")  # noqa: S314
        declared = {e.text for e in tree.getroot() if e.tag.endswith("depend")}
        used = {
            name.split(".")[0]
            for path in MODULES
            if path.is_relative_to(ROOT / package / package)
            for name in _imports(path)
        }
        wrong += [f"{package} imports {name}" for name in sorted((used & (ROS | set(LINE))) - {package} - declared)]
    assert not wrong, "\n".join(wrong)


def test_test_files_have_unique_names():
    names = [path.name for path in ROOT.glob("*/test/**/test_*.py")]
    names += [path.name for path in (ROOT / "tests").rglob("test_*.py")]
    assert len(names) == len(set(names)), sorted({name for name in names if names.count(name) > 1})


def test_classes_have_unique_names():
    places = collections.defaultdict(list)
    for path in MODULES:
        for node in ast.walk(_tree(path)):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(_module(path))
    assert {name: modules for name, modules in places.items() if len(modules) > 1} == {}
