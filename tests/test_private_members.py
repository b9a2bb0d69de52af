# SPDX-License-Identifier: Apache-2.0
"""No file uses a private member of a library: a name with a leading underscore that none of our classes defines."""

import ast

import pytest

from project import ROOT

# Public in spite of their names.
PUBLIC = {"_replace", "_asdict", "_make", "_fields", "_field_defaults", "_exit"}
FOLDERS = (*ROOT.glob("mwd_*"), ROOT / "tests", ROOT / "docs")
FILES = [path for folder in FOLDERS for path in folder.rglob("*.py")]


def is_private(name):
    return name.startswith("_") and not name.startswith("__") and name.strip("_") != "" and name not in PUBLIC


def defined(nodes):
    """Return the names that the nodes of a module or class define, those of instances included."""
    found = set()
    for node in nodes:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            found.add(node.id)
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store) and is_self(node.value):
            found.add(node.attr)
    return found


def is_self(node):
    return isinstance(node, ast.Name) and node.id in ("self", "cls")


def inherited(node, classes, seen=()):
    """Return what a class and those of ours that it inherits from define."""
    names = defined(ast.walk(node))
    for base in node.bases:
        name = ast.unparse(base).partition("[")[0].rpartition(".")[2]
        if name in classes and name not in seen:
            for one in classes[name]:
                names |= inherited(one, classes, (*seen, name))
    return names


def uses(nodes, ours, classes):
    """Yield every use of a private name that is not ours, as (line, text)."""
    for node in nodes:
        if isinstance(node, ast.ClassDef):
            own = inherited(node, classes)
            attributes = [one for one in ast.walk(node) if isinstance(one, ast.Attribute) and is_self(one.value)]
            for one in attributes:
                if is_private(one.attr) and one.attr not in own:
                    yield one.lineno, ast.unparse(one)
        elif isinstance(node, ast.Attribute) and not is_self(node.value):
            if is_private(node.attr) and node.attr not in ours:
                yield node.lineno, ast.unparse(node)
        elif isinstance(node, ast.ImportFrom) and not node.level and not (node.module or "").startswith("mwd_"):
            for name in [*node.module.split("."), *(alias.name for alias in node.names)]:
                if is_private(name) and name not in ours:
                    yield node.lineno, ast.unparse(node)
        elif isinstance(node, ast.Call) and getattr(node.func, "id", None) in ("getattr", "setattr", "hasattr"):
            name = node.args[1]
            if isinstance(name, ast.Constant) and is_private(str(name.value)) and name.value not in ours:
                yield node.lineno, ast.unparse(node)


def found(sources):
    modules = {name: list(ast.walk(ast.parse(text))) for name, text in sources.items()}
    ours = set().union(*map(defined, modules.values()))
    classes = {}
    for nodes in modules.values():
        for node in nodes:
            if isinstance(node, ast.ClassDef):
                classes.setdefault(node.name, []).append(node)
    return [f"{name}:{line}: {text}" for name, nodes in modules.items() for line, text in uses(nodes, ours, classes)]


def test_no_private_member_of_a_library_is_used():
    assert not found({str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in FILES})


@pytest.mark.parametrize(
    "text",
    [
        "import numba\nk = numba.njit(f)\nk._cache = None",
        "getattr(kernel, '_cache')",
        "from aiohttp.web_protocol import _Handler",
        "class Own(Node):\n    def names(self):\n        return self._parameter_overrides",
    ],
)
def test_a_private_member_is_noticed_however_it_is_reached(text):
    assert len(found({"one.py": text})) == 1
