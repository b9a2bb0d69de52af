# SPDX-License-Identifier: Apache-2.0
"""Golden folders: what makes one, how its answers are compared and how new ones are accepted."""

import pytest
from typer.testing import CliRunner

from mwd_surface.cli import app
from mwd_surface.processing import compare
from project import ROOT

GOLDEN = sorted(path for path in (ROOT / "bags" / "golden").iterdir() if path.is_dir())


def copied(tmp_path, names=("config.yaml", "limits.yaml")):
    """A golden folder without answers, over the shortest of the golden bags."""
    folder = tmp_path / "golden"
    folder.mkdir()
    (folder / "bag").symlink_to(GOLDEN[0] / "bag")
    for name in names:
        (folder / name).write_text((GOLDEN[0] / name).read_text())
    return folder


@pytest.mark.parametrize("folder", GOLDEN, ids=lambda path: path.name)
def test_a_golden_recording_gives_its_answers(folder):
    assert compare.is_golden(folder)
    assert sum(file.stat().st_size for file in folder.rglob("*") if file.is_file()) < 1_100_000
    with compare.processed(folder / "bag", folder) as run:
        found = compare.compare(run, folder, compare.limits_of(folder))
    assert found.failures == ()
    assert found.rows > 20
    assert found.stations


@pytest.mark.slow
def test_accepted_answers_agree_and_another_method_does_not(tmp_path):
    folder = copied(tmp_path)
    compare.accept_golden(folder)
    with compare.processed(folder / "bag", folder) as run:
        assert compare.compare(run, folder, compare.limits_of(folder)).agree
    rows = (folder / "attitude.csv").read_text().splitlines()
    assert len(rows) < 60
    config = folder / "config.yaml"
    config.write_text("gravity: {method: raw}\n" + config.read_text())
    result = CliRunner().invoke(app, ["compare", str(folder)])
    assert result.exit_code == 1
    assert "differs: inclination differs by up to" in result.output


def test_a_run_without_answers_or_limits_is_refused(tmp_path):
    folder = copied(tmp_path, names=("config.yaml",))
    with pytest.raises(ValueError, match="not a golden recording"):
        compare.accept_golden(folder)
    result = CliRunner().invoke(app, ["compare", str(folder)])
    assert isinstance(result.exception, ValueError)


def test_a_recording_is_distinguished_from_the_results_of_one():
    assert compare.is_recording(GOLDEN[0] / "bag")
    assert compare.is_recording(next((GOLDEN[0] / "bag").glob("*.mcap")))
    assert not compare.is_recording(GOLDEN[0])
