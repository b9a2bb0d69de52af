"""The law of the rooms: kernels know no ROS, dependencies run one way, every kernel has its test."""

import ast
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LINE = ("mwd_msgs", "mwd_sensors", "mwd_estimation", "mwd_surface")
ROS = {
    "rclpy", "rosidl_runtime_py", "launch", "launch_ros", "builtin_interfaces", "std_msgs", "sensor_msgs", "nav_msgs",
    "geometry_msgs", "diagnostic_msgs", "rcl_interfaces", "lifecycle_msgs", "std_srvs", "tf2_msgs", "rosgraph_msgs",
    "mwd_msgs",
}  # fmt: skip
MODULES = [path for package in LINE[1:] for path in sorted((ROOT / package / package).rglob("*.py")) if path.is_file()]
KERNELS = [path for path in MODULES if not {"nodes", "ros"} & set(path.parts)]


def _imports(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module


def _name(path):
    return str(path.relative_to(ROOT))


def test_the_tree_is_there_to_be_checked():
    assert len(KERNELS) > 30


@pytest.mark.parametrize("path", KERNELS, ids=_name)
def test_a_kernel_imports_no_ros(path):
    found = {name for name in _imports(path) if name.split(".")[0] in ROS or {"nodes", "ros"} & set(name.split("."))}
    # The command's door may start a node, as `ros2 run` would.
    if path.parent.name == "commands":
        found = {name for name in found if not {"nodes", "ros"} & set(name.split("."))}
    assert not found


@pytest.mark.parametrize("path", MODULES, ids=_name)
def test_dependencies_run_one_way(path):
    own = LINE.index(path.relative_to(ROOT).parts[0])
    assert not {name for name in _imports(path) if name.split(".")[0] in LINE[own + 1 :]}


@pytest.mark.parametrize("path", MODULES, ids=_name)
def test_every_module_says_what_it_is_for(path):
    assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize("package", LINE)
def test_package_xml_names_what_the_code_imports(package):
    tree = ElementTree.parse(ROOT / package / "package.xml")  # noqa: S314
    declared = {e.text for e in tree.getroot() if e.tag.endswith("depend")}
    imported = {
        name.split(".")[0] for path in MODULES if _name(path).startswith(package + "/") for name in _imports(path)
    }
    assert (imported & (ROS | set(LINE))) - {package} <= declared


def test_test_files_have_unique_names():
    names = [path.name for path in ROOT.glob("*/test/test_*.py")] + [p.name for p in (ROOT / "tests").glob("test_*.py")]
    assert len(names) == len(set(names))
