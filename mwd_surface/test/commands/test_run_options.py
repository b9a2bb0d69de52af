# SPDX-License-Identifier: Apache-2.0
"""What `mwd run` is told of settings, and the secret of the page."""

import stat
from pathlib import Path

import pytest

from mwd_sensors.core.settings import SettingsError
from mwd_surface.commands.run_options import page_secret, parameter_file, set_parameters


def parameters():
    return {"estimator": {}, "surface": {}, "sonde": {}}


def test_a_setting_goes_to_the_node_that_has_it():
    given = parameters()
    set_parameters(given, ["survey.duration_s=12", "surface.leg.tool=T-7", "sonde.seed=4", "tool.mount.imu=z-down"])
    assert given["estimator"] == {"survey.duration_s": 12.0, "tool.mount.imu": "z-down"}
    assert given["surface"] == {"leg.tool": "T-7"}
    assert given["sonde"] == {"seed": 4}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("survey.duraton_s=12", "did you mean survey.duration_s"),
        ("survey.duration_s=0.1", "below the lowest allowed"),
        ("surface.leg.tol=1", "no such setting"),
        ("qqqq.zzzz=1", "no such setting; settings begin with .*survey.*surface"),
    ],
)
def test_a_setting_that_no_node_takes_is_refused(text, words):
    with pytest.raises(SettingsError, match=words):
        set_parameters(parameters(), [text])


def test_the_secret_of_the_page_is_in_a_file_that_its_owner_alone_can_read(tmp_path, capsys):
    assert page_secret(None, tmp_path) == {}
    (path,) = page_secret("a long word", tmp_path).values()
    assert Path(path).read_text() == "a long word\n"
    assert stat.S_IMODE((tmp_path / "page_token").stat().st_mode) == 0o600
    page_secret("new", tmp_path)
    made = (tmp_path / "page_token").read_text().strip()
    assert made in capsys.readouterr().out
    assert len(made) >= 8
    with pytest.raises(ValueError, match="8 characters"):
        page_secret("short", tmp_path)


def test_a_parameter_file_that_is_not_there_is_named(tmp_path):
    assert parameter_file(None) == []
    with pytest.raises(FileNotFoundError, match="parameter file not found"):
        parameter_file(tmp_path / "none.yaml")
