# SPDX-License-Identifier: Apache-2.0
"""`mwd plot` as people call it: a picture on the disk and one line about it, or one sentence why not."""

import plotted_bag
import pytest
import typer
from typer.testing import CliRunner

from mwd_surface.bags.bag_reader import BagError
from mwd_surface.commands.plot import plot

pytestmark = pytest.mark.slow

APP = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
APP.command()(plot)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("plot") / "run"
    plotted_bag.record(path)
    return path


def run(*words):
    done = CliRunner().invoke(APP, [str(word) for word in words])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done


@pytest.mark.parametrize(("kind", "head"), [("png", b"\x89PNG"), ("svg", b"<?xml")])
def test_a_picture_of_the_asked_kind_is_written(bag, tmp_path, kind, head):
    out = tmp_path / "new" / f"run.{kind}"
    done = run(bag, "-o", out)
    assert done.exit_code == 0
    assert out.read_bytes().startswith(head)
    assert f"{out}: sensors, attitude, surveys of run, 37.0 s" in done.stdout


def test_all_is_everything_and_a_span_and_topic_are_less(bag, tmp_path):
    whole = run(bag, "-o", tmp_path / "all.png", "--what", "all").stdout
    assert "sensors, rig, truth, attitude, surveys, spectra, allan of run, 37.0 s" in whole
    one = run(bag, "-o", tmp_path / "one.png", "--what", "sensors", "--topic", "/w1/imu/mag", "--start", 2, "--end", 4)
    assert "one.png: sensors of run, 2.0 s" in one.stdout


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["-o", "run.pdf"], r"--output run.pdf: a plot must be .png or .svg"),
        (["-o", "run.png", "--what", "sensors,spektra"], "use one of sensors"),
        (["-o", "run.png", "--what", ","], "name at least one of"),
        (["-o", "run.png", "--topic", "/other"], "has no topic /other"),
    ],
)
def test_a_mistake_is_one_sentence_and_leaves_no_file(bag, tmp_path, monkeypatch, words, sentence):
    monkeypatch.chdir(tmp_path)
    with pytest.raises((ValueError, BagError), match=sentence):
        run(bag, *words)
    assert not list(tmp_path.iterdir())
