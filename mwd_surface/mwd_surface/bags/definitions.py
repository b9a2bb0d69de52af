# SPDX-License-Identifier: Apache-2.0
"""
Message definitions without middleware: schema text and type hash of every type that a node or a bag uses.

The common ROS 2 types come from the table of Jazzy inside `rosbags`. All others, such as `mwd_msgs`, come from the
``.msg`` files of installed packages (``<prefix>/share/<package>/msg``) or of the source tree.
"""

from __future__ import annotations

import dataclasses
import functools
import os
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.base import TypesysError
from rosbags.typesys.store import Typestore

# Line between the definitions of two types in a ``ros2msg`` schema.
_RULE = "=" * 80


class DefinitionError(LookupError):
    """Raised if a message type has no definition here; the message names the searched folders and what to install."""


@dataclasses.dataclass(frozen=True)
class Definition:
    """Definition of one message type for a recording."""

    type_name: str  #: ``package/msg/Name``
    text: str  #: the ``ros2msg`` schema: the definition of the type, then the definitions of all types that it uses
    type_hash: str  #: RIHS01 hash (REP-2016)


def share_folders() -> list[Path]:
    """
    Return the existing folders that contain packages.

    They are ``share`` in each prefix of AMENT_PREFIX_PATH and in the prefix of this Python, and the root of the source
    tree.
    """
    prefixes = [Path(part) for part in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if part]
    folders = [prefix / "share" for prefix in (*prefixes, Path(sys.prefix))]
    # In a source tree, this file is <root>/mwd_surface/mwd_surface/bags/definitions.py, and mwd_msgs/msg is in <root>.
    folders.append(Path(__file__).resolve().parents[3])
    return list(dict.fromkeys(folder for folder in folders if folder.is_dir()))


class Definitions:
    """
    Definitions by type name.

    Parameters
    ----------
    folders : sequence of path, optional
        Folders of packages, searched for ``<package>/msg/<Name>.msg``; by default `share_folders`.
    """

    def __init__(self, folders: Sequence[Path] | None = None) -> None:
        self.folders = list(share_folders() if folders is None else folders)
        self.typestore: Typestore = get_typestore(Stores.ROS2_JAZZY)
        self._known: dict[str, Definition] = {}

    def definition(self, type_name: str) -> Definition:
        """
        Return the schema text and hash of a type.

        Raises
        ------
        DefinitionError
            The type is unknown here, is not of the form package/msg/Name, or its file cannot be parsed.
        """
        if type_name not in self._known:
            self.load(type_name)
            parts = {name: self._own_text(name) for name in self._closure(type_name)}
            text = parts.pop(type_name) + "".join(
                f"{_RULE}\nMSG: {_short(name)}\n{body}" for name, body in parts.items()
            )
            self._known[type_name] = Definition(type_name, text, self.typestore.hash_rihs01(type_name))
        return self._known[type_name]

    def load(self, type_name: str) -> None:
        """Add a type and all types that it uses to `typestore`. Raises DefinitionError as `definition` does."""
        wanted, types = [type_name], {}
        while wanted:
            name = wanted.pop()
            if name in self.typestore.fielddefs or name in types:
                continue
            path = self._file(name)
            try:
                found = get_types_from_msg(path.read_text(encoding="utf-8"), name)
            except (TypesysError, OSError, UnicodeDecodeError) as error:
                raise DefinitionError(f"{path} is not a message definition: {error}") from error
            types.update(found)
            wanted += [used for _, fields in found.values() for _, field in fields for used in _names(field)]
        if types:
            try:
                self.typestore.register(types)
            except TypesysError as error:
                raise DefinitionError(f"{type_name}: {error}") from error

    def size(self, type_name: str, message: object) -> int:
        """
        Return the number of bytes of a message in CDR, with the four bytes of its encapsulation.

        `rclpy.serialization.serialize_message` of Jazzy may return more bytes, with old content of the memory, and
        other readers refuse such a message.

        Raises DefinitionError as `definition` does.
        """
        self.load(type_name)
        return 4 + int(self.typestore.get_msgdef(type_name).getsize_cdr(0, message, self.typestore))

    def make(self, type_name: str, fields: dict[str, Any]) -> Any:
        """
        Return a message of a type with the given fields; all other fields are 0 or empty, as in a new ROS message.

        Raises DefinitionError as `definition` does.
        """
        self.load(type_name)
        values: dict[str, Any] = {}
        described: Any = self.typestore.fielddefs[type_name][1]
        for name, (kind, inner) in described:
            is_list = kind in (Nodetype.ARRAY, Nodetype.SEQUENCE)
            if is_list and inner[0][0] == Nodetype.BASE and inner[0][1][0] != "string":
                values[name] = np.array(fields.get(name, [0] * inner[1]), dtype=inner[0][1][0])
            elif name in fields:
                values[name] = fields[name]
            elif kind == Nodetype.NAME:
                values[name] = self.make(inner, {})
            else:
                values[name] = [] if is_list else "" if inner[0] == "string" else 0
        return self.typestore.types[type_name](**values)

    def learn(self, type_name: str, text: str) -> None:
        """
        Add a type to `typestore` from the schema text of a recording, unless the type is known already.

        Raises
        ------
        DefinitionError
            The text cannot be parsed, or uses a type that neither the text nor `typestore` defines.
        """
        if type_name in self.typestore.fielddefs:
            return
        try:
            found = get_types_from_msg(text, type_name)
            known = found.keys() | self.typestore.fielddefs.keys()
            used = {name for _, fields in found.values() for _, field in fields for name in _names(field)}
            if used - known:
                missing = ", ".join(sorted(used - known))
                raise DefinitionError(
                    f"{type_name}: its definition uses {missing}, which the recording does not define"
                )
            self.typestore.register({name: found[name] for name in found.keys() - self.typestore.fielddefs.keys()})
        except TypesysError as error:
            raise DefinitionError(f"{type_name}: the definition in the recording cannot be used: {error}") from error

    def _closure(self, type_name: str) -> list[str]:
        order, wanted = [type_name], [type_name]
        while wanted:
            for _, field in self.typestore.fielddefs[wanted.pop(0)][1]:
                for used in _names(field):
                    if used not in order:
                        order.append(used)
                        wanted.append(used)
        return order

    def _own_text(self, type_name: str) -> str:
        # Prefer the ``.msg`` file to the table of `rosbags`, which has only the fields: a reader in ten years needs the
        # units and comments of the file.
        path = self._find(type_name) if type_name.startswith("mwd_") else None
        if path is not None:
            body = path.read_text(encoding="utf-8")
            return body if body.endswith("\n") else body + "\n"
        return self.typestore.gendefhash(type_name, {}, ros_version=2)[0]

    def _file(self, type_name: str) -> Path:
        path = self._find(type_name)
        if path is not None:
            return path
        package = type_name.split("/")[0]
        places = ", ".join(str(folder) for folder in self.folders) or "nowhere: no folder is installed"
        if any((folder / package / "msg").is_dir() for folder in self.folders):
            hint = f"the installed {package} has no such message; is its version too old?"
        elif package == "mwd_msgs":
            hint = "mwd_msgs is not installed: build it (`make run` or `colcon build`) or source its install/setup.bash"
        else:
            hint = f"install the ROS package {package}"
        raise DefinitionError(f"no definition of {type_name}; {hint} (looked in {places})")

    def _find(self, type_name: str) -> Path | None:
        parts = type_name.split("/")
        if len(parts) != 3 or parts[1] != "msg" or not all(part.isidentifier() for part in parts):
            raise DefinitionError(f"{type_name!r} is not a message type; write it as package/msg/Name")
        for folder in self.folders:
            path = folder / parts[0] / "msg" / f"{parts[2]}.msg"
            if path.is_file():
                return path
        return None


@functools.lru_cache(maxsize=1)
def installed() -> Definitions:
    """Return the definitions of this installation, read once."""
    return Definitions()


def is_ours(type_name: str, type_hash: str, schema: str) -> bool:
    """
    Return whether a recorded message type has the definition of this installation; true if either is unknown.

    type_hash, schema : RIHS01 hash and definition of the type in the recording; "" if the recording has none.
    """
    try:
        known = installed().definition(type_name).type_hash
        if not type_hash and schema:
            recorded = Definitions([])
            recorded.learn(type_name, schema)
            type_hash = recorded.typestore.hash_rihs01(type_name)
    except DefinitionError:
        return True
    return type_hash in ("", known)


def _names(field: tuple[int, object]) -> Iterable[str]:
    kind, inner = field
    if kind == Nodetype.NAME:
        return [str(inner)]
    if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        element = inner[0]  # type: ignore[index]
        return _names(element)
    return []


def _short(type_name: str) -> str:
    package, _, name = type_name.split("/")
    return f"{package}/{name}"
