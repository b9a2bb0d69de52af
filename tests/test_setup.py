# SPDX-License-Identifier: Apache-2.0
"""The set-up of `.venv`: nothing twice, and one process at a time."""

import fcntl
import os
import subprocess
import sys
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

import pytest

FILE = Path(__file__).resolve().parents[1] / ".ci" / "setup"


@pytest.fixture
def setup(tmp_path, monkeypatch):
    """The program as a module, over an environment and a build of the test's own; `setup.done` lists the steps."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    loader = SourceFileLoader("ci_setup", str(FILE))
    module = module_from_spec(spec_from_loader("ci_setup", loader))
    loader.exec_module(module)
    (tmp_path / ".venv").mkdir()
    module.VENV, module.TURN, module.done = tmp_path / ".venv", tmp_path / ".venv.turn", []
    module.check_tools = module.find_python = lambda: ""
    module.make_venv = lambda _python: module.done.append("venv")
    module.install = lambda lock: module.done.append(lock.stem)
    module.build_messages = lambda: module.done.append("messages")
    module.link_packages = lambda: module.done.append("packages")
    module.compile_kernels = lambda: module.done.append("kernels")
    return module


BUILD = {"messages", "packages", "kernels"}


def fail(setup, sentence):
    raise setup.SetupError(sentence)


def test_the_first_call_does_everything_and_the_second_nothing(setup):
    setup.main()
    assert setup.done[0] == "venv"
    assert sorted(setup.done[1:]) == sorted({"ros", "python"} | BUILD)
    before = list(setup.done)
    setup.main()
    assert setup.done == before


def test_messages_wait_for_their_packages_and_kernels_for_all(setup):
    setup.main()
    place = {step: at for at, step in enumerate(setup.done)}
    assert place["ros"] < place["messages"] < place["packages"]
    assert max(place["ros"], place["python"]) < place["kernels"]


def test_one_stale_lock_file_is_installed_alone(setup):
    setup.main()
    setup.done.clear()
    (setup.VENV / ".python").write_text("other packages")
    setup.main()
    assert set(setup.done) == {"venv", "python"} | BUILD


def test_other_sources_are_built_without_installing_again(setup, monkeypatch):
    setup.main()
    monkeypatch.setattr(setup, "sources", lambda: "others")
    setup.done.clear()
    setup.main()
    assert set(setup.done) == BUILD


def test_a_build_that_fails_is_done_again_even_where_the_sources_are_the_old_ones(setup, monkeypatch):
    setup.main()
    with monkeypatch.context() as other:
        other.setattr(setup, "sources", lambda: "others")
        other.setattr(setup, "build_messages", lambda: fail(setup, "the packages did not build"))
        with pytest.raises(SystemExit, match="setup: the packages did not build"):
            setup.main()
    setup.done.clear()
    setup.main()
    assert set(setup.done) == BUILD


def test_the_second_of_two_says_that_it_waits_and_then_has_nothing_to_do(setup, capsys, monkeypatch):
    def wait_for_the_other(file, how):
        """The lock as the system gives it while another process works, which ends well as soon as it is waited for."""
        if how & fcntl.LOCK_NB:
            raise BlockingIOError
        for stamp, wanted in setup.stale().items():
            stamp.write_text(wanted)

    monkeypatch.setattr(setup.fcntl, "flock", wait_for_the_other)
    setup.TURN.write_text("4711\n")
    setup.main()
    assert setup.done == []
    assert capsys.readouterr().out == "setup: another set-up is at work here (process 4711); waiting for it\n"


def test_a_turn_is_held_against_other_processes_and_ends_with_it(setup):
    take = "import fcntl, sys; fcntl.flock(open(sys.argv[1], 'a'), fcntl.LOCK_EX | fcntl.LOCK_NB)"
    attempt = [sys.executable, "-c", take, str(setup.TURN)]
    with setup.turn():
        assert b"BlockingIOError" in subprocess.run(attempt, capture_output=True, check=False).stderr
        assert setup.TURN.read_text() == f"{os.getpid()}\n"
    assert subprocess.run(attempt, capture_output=True, check=False).returncode == 0


def test_an_unknown_option_is_refused_before_anything_is_done():
    done = subprocess.run([sys.executable, str(FILE), "--ubunto"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "setup: '--ubunto' is not known; the only option is --ubuntu.\n"
