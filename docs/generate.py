# SPDX-License-Identifier: Apache-2.0
"""
Generate pages of the site from the code, so that they are always up to date.

Messages and services come from their definitions in `mwd_msgs`, parameters from the settings of the nodes, the API from
the packages, examples from notebooks that are run, and the two pictures from the lists below.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import json
import sys
from importlib.machinery import SourceFileLoader
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("mwd_sensors", "mwd_estimation", "mwd_surface")
BANNER = "<!-- Made by docs/generate.py; edit what it is made from. -->\n\n"


def interfaces() -> str:
    """Return a page with the definition file of each message, service and action."""
    parts = [BANNER, "# Messages, services and actions\n\n", "Topics, QoS and rates: {doc}`topics`.\n"]
    for folder, title in (("msg", "Messages"), ("srv", "Services"), ("action", "Actions")):
        parts.append(f"\n## {title}\n")
        paths = sorted((ROOT / "mwd_msgs" / folder).glob(f"*.{folder}"))
        parts += [f"\n### mwd_msgs/{folder}/{p.stem}\n\n```text\n{p.read_text().rstrip()}\n```\n" for p in paths]
    return "".join(parts)


def topics() -> str:
    """Return the page of topics, QoS and rates: the README of the message package."""
    text = (ROOT / "mwd_msgs" / "README.md").read_text()
    return BANNER + text.replace("](../docs/reference/", "](").replace("](../docs/", "](../")


def parameters() -> str:
    """Return the page with all parameters of all nodes."""
    path = ROOT / ".ci" / "config"
    loader = SourceFileLoader("ci_config", str(path))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader("ci_config", loader))
    loader.exec_module(module)
    return BANNER + module.reference()


def fault_cases() -> str:
    """Return the table of fault cases, with the tests that cover each case."""
    loader = SourceFileLoader("fault_cases", str(ROOT / "tests" / "fault_cases.py"))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader("fault_cases", loader))
    sys.modules["fault_cases"] = module
    loader.exec_module(module)
    return module.page()


def supervision() -> str:
    """Return the table of the readings that the surface node watches in each node."""
    from mwd_surface.live.supervision import TABLE

    lines = [
        "# Supervision\n",
        "What the surface node watches of each node: a reading above its limit for the time given raises its alarm;",
        "the same time within the limit clears it.\n",
        "| alarm | of | limit | for s | severity | what the graph does | what still works | remedy |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in TABLE:
        cells = (row.alarm, row.node, f"{row.limit:g}", f"{row.persistence_s:g}", row.severity.name.lower())
        lines.append(f"| {' | '.join((*cells, row.action, row.degraded, row.remedy))} |")
    return "\n".join(lines) + "\n"


def signals() -> str:
    """Return the table of all signals, with the page, protocols and files in which each appears."""
    from mwd_surface.signals.table import SIGNALS, SOURCES
    from mwd_surface.signals.units import UNITS

    heads = (
        *("signal", "meaning", "unit, type", "source", "1 sigma", "page", "OPC UA", "Modbus", "WITS", "D-WIS nouns"),
        *("tables of surveys", "LAS", "WITSML", "recording by seconds", "attitude files"),
    )
    lines = [
        "# Signals\n",
        "Every signal and its name on the page and in each protocol and file, from the one table in the code",
        "(`mwd_surface/signals/table.csv`). Page and OPC UA have SI units, Modbus and WITS (metric) those named,",
        "a column of a file that at the end of its name. Tables of surveys: {doc}`surveys_csv`. Conditions, ages and",
        "sigmas: {doc}`../rig/port`.\n",
        f"| {' | '.join(heads)} |",
        "|---" * len(heads) + "|",
    ]
    for s in SIGNALS:
        modbus = f"{s.modbus}, {UNITS[s.unit].modbus.symbol}" if s.modbus is not None else ""
        items = [f"{s.wits.code:04d} {s.wits.name}".rstrip()] if s.wits else []
        items += [f"{s.reads:04d} in"] if s.reads is not None else []
        wits = f"{', '.join(items)}, {UNITS[s.unit].metric.symbol}" if items else ""
        listed = (s.listed.key, s.listed.las, s.listed.witsml) if s.listed else ("", "", "")
        kind = s.unit if s.type == "Double" else s.type
        sigma = "yes" if s.sigma else ""
        columns = [column.key if column else "" for column in (s.series, s.attitude)]
        cells = (s.name, s.meaning, kind, s.source, sigma, ", ".join(s.page), s.opcua, modbus, wits, ", ".join(s.dwis))
        lines.append(f"| {' | '.join((*cells, *listed, *columns))} |")
    lines += [
        "\n## Sources\n",
        "| source | brings it | how often | its values are valid where |",
        "|---|---|---|---|",
        *(f"| {name} | {one.brings} | {one.rate} | {one.validity} |" for name, one in SOURCES.items()),
        "\n`sigma_` before a name of the last two columns is the column of its 1 sigma. Numbers without unit have",
        "unit 1; all numbers are of type Double.",
    ]
    return "\n".join(lines) + "\n"


def survey_columns() -> str:
    """Return the columns of the survey tables, with units."""
    from mwd_surface.signals.table import SURVEY_TABLE
    from mwd_surface.surveys.survey_csv import OF_TABLES

    head = ["| column | unit | meaning |", "|---|---|---|"]
    lines = [
        "# Columns of surveys.csv\n",
        "`mwd process`, `mwd batch`, `mwd survey` and `mwd export` (formats csv and raw_csv) write these columns in",
        "this order; what is unknown is an empty cell. Text and yes or no are in quotes. The definitive survey (csv)",
        "has a line for each station of a leg, with azimuths from the north of the well; the others have a line for",
        "each survey, with azimuths from its own north. Each line names its north. Only a list with a path has",
        "positions, and only one with a plan the place relative to it.",
        "`mwd decode` writes what the tool sent: {doc}`../tutorials/decode_pressure`.\n",
        *head,
    ]
    for signal, listed in SURVEY_TABLE:
        unit = signal.listed_scale.symbol if signal.type == "Double" else {"Int64": "number"}.get(signal.type, "text")
        meaning = signal.meaning.replace("the last accepted survey", "the survey")
        lines.append(f"| `{listed.key}` | {'' if unit == '1' else unit} | {meaning} |")
    lines += ["\n`mwd survey` adds, of the rows of its table:\n", *head]
    lines += [f"| `{name}` | text | {meaning} |" for name, meaning in OF_TABLES.items()]
    return "\n".join(lines) + "\n"


def api() -> dict[str, str]:
    """Return the API pages by name: one page for each subpackage."""
    pages, rooms = {}, {}
    for package in PACKAGES:
        base = ROOT / package / package
        for path in sorted(base.rglob("*.py")):
            names = path.relative_to(ROOT / package).with_suffix("").parts
            if names[-1] == "__init__" or "static" in names:
                continue
            rooms.setdefault(".".join(names[:-1]), []).append(".".join(names))
    for room, modules in rooms.items():
        body = "".join(f"\n## {name}\n\n```{{eval-rst}}\n.. automodule:: {name}\n```\n" for name in modules)
        pages[room] = f"{BANNER}# {room}\n{body}"
    listed = "\n".join(rooms)
    pages["index"] = f"{BANNER}# API\n\nEvery module by its room.\n\n```{{toctree}}\n:maxdepth: 1\n\n{listed}\n```\n"
    return pages


def notebook(path: Path, images: Path) -> str:
    """Return a notebook as a page: run its cells in order, and save the figures as pictures."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    names: dict[str, object] = {}
    parts = [BANNER]
    for number, cell in enumerate(json.loads(path.read_text())["cells"]):
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source + "\n\n")
            continue
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            exec(compile(source, f"{path.name}, cell {number}", "exec"), names)  # noqa: S102  (our own notebooks)
        parts.append(f"```python\n{source}\n```\n\n")
        if printed.getvalue():
            parts.append(f"```text\n{printed.getvalue().rstrip()}\n```\n\n")
        for figure in map(plt.figure, plt.get_fignums()):
            picture = images / f"{path.stem}_{number}.png"
            figure.savefig(picture, dpi=90)
            parts.append(f"![{path.stem}, figure of cell {number}](../images/{picture.name})\n\n")
        plt.close("all")
    return "".join(parts)


NODES = {
    "size": (14.0, 5.2),
    "boxes": {
        "sonde": (0.2, 2.4, "sonde or probe\n(mwd_sensors)\nsimulated or real tool"),
        "estimator": (4.7, 2.4, "estimator\n(mwd_estimation)\ngravity, attitude, surveys"),
        "surface": (9.0, 2.4, "surface\n(mwd_surface)\nlists, path, alarms"),
        "receiver": (4.7, 0.3, "receiver\n(mwd_surface)\nonly with a telemetry link"),
        "log": (9.0, 0.3, "MCAP recording"),
        "page": (12.2, 2.4, "driller's page"),
        "rig": (9.0, 4.3, "rig control:\nWITS, OPC UA, Modbus,\nWITSML, ROS"),
    },
    "arrows": (
        ("sonde", "estimator", "imu/data_raw, imu/mag,\ngyro/data_raw"),
        ("estimator", "surface", "attitude, survey,\ninterference"),
        ("estimator", "receiver", "mud pulses, EM, serial"),
        ("receiver", "surface", "link/attitude,\nlink/survey"),
        ("surface", "log", "every message"),
        ("surface", "page", "http, websocket"),
        ("surface", "rig", "toolface, surveys,\nadvice, control"),
    ),
}
FLOW = {
    "size": (12.0, 4.6),
    "boxes": {
        "in": (0.1, 2.0, "samples\n(core)"),
        "health": (2.1, 2.0, "sensor health\n(health)"),
        "gravity": (4.4, 3.3, "gravity\n(gravity)"),
        "magnetic": (4.4, 2.0, "magnetic field\n(magnetic)"),
        "gyro": (4.4, 0.7, "Earth rate\n(gyrocompass)"),
        "attitude": (7.0, 3.3, "attitude of\nevery sample\n(attitude)"),
        "survey": (7.0, 1.2, "survey at rest:\nazimuth, verdict\n(survey)"),
        "out": (9.9, 2.2, "topics, rows,\nmessages"),
    },
    "arrows": (
        ("in", "health", ""),
        ("health", "gravity", ""),
        ("health", "magnetic", ""),
        ("health", "gyro", ""),
        ("gravity", "attitude", ""),
        ("gravity", "survey", ""),
        ("magnetic", "survey", ""),
        ("magnetic", "attitude", ""),
        ("gyro", "survey", ""),
        ("survey", "attitude", "station azimuth"),
        ("attitude", "out", ""),
        ("survey", "out", ""),
    ),
}


def picture(what: dict[str, object], path: Path) -> None:
    """Draw boxes and arrows."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=what["size"])
    axes.set(xlim=(0, what["size"][0]), ylim=(0, what["size"][1]))
    axes.axis("off")
    width, boxes = 1.9, {}
    for name, (x, y, text) in what["boxes"].items():
        style = {"boxstyle": "round,pad=0.45", "facecolor": "#eef4fb", "edgecolor": "#2b5c8a"}
        boxes[name] = axes.text(x + width / 2, y + 0.4, text, ha="center", va="center", fontsize=10, bbox=style)
    figure.canvas.draw()  # computes the sizes of the boxes
    for start, end, label in what["arrows"]:
        (x0, y0), (x1, y1) = boxes[start].get_position(), boxes[end].get_position()
        arrow = {"arrowstyle": "-|>", "color": "#555", "shrinkA": 3, "shrinkB": 3}
        arrow |= {"patchA": boxes[start].get_bbox_patch(), "patchB": boxes[end].get_bbox_patch()}
        axes.annotate("", (x1, y1), (x0, y0), arrowprops=arrow)
        style = {"ha": "center", "va": "bottom", "fontsize": 8, "color": "#333", "backgroundcolor": "white"}
        axes.text((x0 + x1) / 2, (y0 + y1) / 2 + 0.1, label, **(style if label else {}))
    figure.savefig(path, bbox_inches="tight")
    plt.close(figure)


def write(path: Path, text: str) -> None:
    """Write a page if its content has changed, so that Sphinx does not build an unchanged page again."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() or path.read_text() != text:
        path.write_text(text)


def write_all(docs: Path) -> None:
    """Write every generated page and picture below `docs`."""
    images = docs / "images"
    images.mkdir(exist_ok=True)
    picture(NODES, images / "nodes.svg")
    picture(FLOW, images / "signal_flow.svg")
    write(docs / "reference" / "interfaces.md", interfaces())
    write(docs / "reference" / "topics.md", topics())
    write(docs / "reference" / "parameters.md", parameters())
    write(docs / "reference" / "fault_cases.md", BANNER + fault_cases())
    write(docs / "reference" / "supervision.md", BANNER + supervision())
    write(docs / "reference" / "signals.md", BANNER + signals())
    write(docs / "reference" / "surveys_csv.md", BANNER + survey_columns())
    write(docs / "reference" / "changelog.md", BANNER + (ROOT / "CHANGELOG.md").read_text())
    for name, text in api().items():
        write(docs / "reference" / "api" / f"{name}.md", text)
    for path in sorted((docs / "examples").glob("*.ipynb")):
        write(path.with_suffix(".md"), notebook(path, images))
