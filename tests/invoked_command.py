# SPDX-License-Identifier: Apache-2.0
"""Commands of the terminal within the process of a test."""

from typer.testing import CliRunner


def invoke(app, *words):
    """Run a command that must end well, in a terminal of 140 columns; what it raises is raised here."""
    done = CliRunner(env={"COLUMNS": "140"}).invoke(app, [str(word) for word in words])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert done.exit_code == 0, done.output
    return done
