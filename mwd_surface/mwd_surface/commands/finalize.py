# SPDX-License-Identifier: Apache-2.0
"""`mwd finalize`: signed final survey list of a well, from all its runs, recordings and lists."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mwd_sensors.core import settings
from mwd_surface import __version__
from mwd_surface.commands import terminal
from mwd_surface.commands.export import WellChanges
from mwd_surface.commands.shared_options import assignments
from mwd_surface.commands.sources import survey_list_at
from mwd_surface.exports.export import FORMATS

if TYPE_CHECKING:
    from collections.abc import Callable

    from mwd_surface.surveys.final_list import FinalList, ListSource


def finalize(
    sources: Annotated[
        list[str],
        typer.Argument(
            metavar="SOURCE[=CODE]...",
            help="Folder of a run, recording, or list of stations, each with its ISCWSA tool code unless the source "
            "states the code; the main source first.",
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results; created if missing.")],
    key: Annotated[
        Path | None, typer.Option(help="PEM file of the Ed25519 private key that signs the certificate.")
    ] = None,
    changes: WellChanges = None,
) -> None:
    """
    Write the final survey list of a well from all its runs and lists, with overlaps resolved.

    The first source gives the well, its legs and the decisions of people. The stations of the other sources are
    added to the path of its current leg; above the kick-off depth they belong to the leg that it leaves. Where two
    sources cover an interval, the source with the smaller position uncertainty at the end of the interval is used,
    and the depths at which the sources disagree beyond their errors are listed. Each magnetic run gets a
    multi-station analysis for comparison.
    Writes DIR/surveys.json and programme.yaml (for `mwd path`, `clearance`, `export`), definitive.csv, raw.csv,
    definitive.las, trajectory.xml, report.html, report.pdf, differences.csv (differences from the list as first
    decided), and certificate.json with the SHA-256 of every input and output; with --key also certificate.sig.

    \b
    Examples:
      mwd finalize out/run_7 -o final
      mwd finalize out/run_7=MWD+SRGM gyro.csv=GYRO-NS -o final --key office.pem
    """
    import json

    from mwd_surface.exports.csv_tables import comparison_csv, path_csv
    from mwd_surface.exports.report_final import final_sections
    from mwd_surface.exports.survey_table import survey_table
    from mwd_surface.surveys.final_list import final_list
    from mwd_surface.surveys.survey_store import encoded
    from mwd_surface.trajectory.list_comparison import difference

    sign = None if key is None else _signer(key)
    read = [_source(text) for text in sources]
    for _, _, notes in read:
        terminal.warn(*notes)
    inputs = [(str(file), _hash(file.read_bytes())) for path, _, _ in read for file in _files(path)]
    final = final_list([source for _, source, _ in read])
    surveys = final.surveys
    given = {name.removeprefix("well."): value for name, value in assignments(changes).items()}
    well = dataclasses.replace(surveys.well, programme=str((output / "programme.yaml").resolve()))
    well = settings.changed(well, given)
    output.mkdir(parents=True, exist_ok=True)
    programme = _programme(final)
    (output / "programme.yaml").write_text(programme, encoding="utf-8")
    surveys = surveys.configured(well, surveys.rules)
    now, software = time.time_ns(), f"mwd {__version__}"
    table = survey_table(surveys, now, software=software)
    first = survey_table(read[0][1].surveys.as_first_decided(), now, software=software)
    changed = difference(table.path, first.path, (table.covariance, first.covariance))
    sections = final_sections(dataclasses.replace(final, surveys=surveys), changed, (first, table), inputs)
    files: dict[str, str | bytes] = {
        "surveys.json": encoded(surveys),
        "path.csv": path_csv(table),
        "differences.csv": comparison_csv(changed),
    }
    for name, kind in _EXPORTS.items():
        files[name] = FORMATS[kind].make(dataclasses.replace(table, sections=sections, final=True))
    outputs = {**files, "programme.yaml": programme}
    certificate = {
        "well": well.name,
        "wellbore": well.wellbore,
        "made_ns": now,
        "software": software,
        "inputs": [{"file": file, "sha256": digest} for file, digest in inputs],
        "outputs": [{"file": name, "sha256": _hash(_bytes(data))} for name, data in outputs.items()],
        "overlaps": [dataclasses.asdict(one) for one in final.overlaps],
        "remarks": list(final.remarks),
    }
    content = json.dumps(certificate, indent=2, ensure_ascii=False) + "\n"
    files["certificate.json"] = content
    if sign is not None:
        files["certificate.sig"] = sign(content.encode())
    terminal.warn(*table.left_out, *final.remarks)
    _show(final, float(changed.distance[-1]), float(changed.md[-1]), key)
    terminal.write(output, files)


# Export format of each file that is written for other programs and people.
_EXPORTS = {
    "definitive.csv": "csv",
    "raw.csv": "raw_csv",
    "definitive.las": "las",
    "trajectory.xml": "witsml",
    "report.html": "html",
    "report.pdf": "pdf",
}


def _source(text: str) -> tuple[Path, ListSource, tuple[str, ...]]:
    """
    Return the path of a source PATH[=CODE], its survey list with the tool code, and notes on its origin.

    Raises ValueError if the tool code is unknown or the list has no survey.
    """
    from mwd_surface.surveys.final_list import ListSource
    from mwd_surface.uncertainty.error_terms import check_tool_code

    name, _, code = text.partition("=")
    if code:
        check_tool_code(code)
    path = Path(name)
    surveys, notes = survey_list_at(path)
    if not surveys.records:
        raise ValueError(f"{path}: the list has no survey")
    return path, ListSource(path.name, surveys, code), notes


def _files(path: Path) -> list[Path]:
    """Return the files from which the survey list of a source was read."""
    if path.is_file():
        return [path]
    found = sorted(path.rglob("surveys.json")) or sorted([*path.rglob("*.mcap"), *path.rglob("*.db3")])
    return [file for file in found if file.is_file()]


def _programme(final: FinalList) -> str:
    """Return the survey programme as YAML."""
    import yaml

    table = settings.to_mapping(final.programme)
    table.pop("name")
    return str(yaml.safe_dump(table, sort_keys=False, allow_unicode=True))


def _bytes(data: str | bytes) -> bytes:
    return data.encode() if isinstance(data, str) else data


def _hash(data: bytes) -> str:
    import hashlib

    return hashlib.sha256(data).hexdigest()


def _signer(key: Path) -> Callable[[bytes], bytes]:
    """Return a function that signs with the Ed25519 key in a file; raise ValueError if the file has no such key."""
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    from mwd_sensors.core import budgets
    from mwd_sensors.core.input_files import read_file

    try:
        private: Any = load_pem_private_key(read_file(key, budgets.CERTIFICATE), None)
    except (ValueError, TypeError) as error:
        raise ValueError(f"--key {key}: no private key in PEM without a password: {error}") from error
    if not isinstance(private, Ed25519PrivateKey):
        raise ValueError(  # noqa: TRY004  (the error is in the user's file, not in an argument)
            f"--key {key}: expected an Ed25519 key: make one with openssl genpkey -algorithm ed25519"
        )
    return private.sign


def _show(final: FinalList, distance: float, md: float, key: Path | None) -> None:
    records = final.surveys.records
    revised = sum(record.replaced is not None for record in records)
    lines = [
        (
            "surveys",
            (
                f"{sum(r.in_use for r in records)} in use of {len(records)}; "
                f"{revised} revised with later surveys of the run"
            ),
        ),
        *(
            (
                "overlap",
                (
                    f"{one.from_m:.1f} to {one.to_m:.1f} m: {one.used} is used, 1 sigma {one.sigma_used:.2f} m; "
                    f"{one.left_out} has {one.sigma_left_out:.2f} m; the two differ by more than their errors at "
                    f"{len(one.apart)} depths"
                ),
            )
            for one in final.overlaps
        ),
        ("change", f"{distance:.2f} m at {md:.1f} m against the list as first decided"),
        ("certificate", "signed" if key is not None else "not signed: give --key"),
    ]
    terminal.facts(lines)
