"""Failures of commands are reported in one line, with exit code 2."""

import errno
import os

import click
import pytest

from safestage_eval.cli.failures import run


@pytest.mark.parametrize(
    ("number", "said"),
    [
        (errno.EIO, "the disk fails"),
        (errno.ESTALE, "the disk fails"),
        (errno.ENOSPC, "cannot be written"),
        (errno.EACCES, "cannot be written"),
    ],
)
def test_a_disk_that_fails_is_no_traceback(capsys, number, said):
    @click.command()
    def command():
        raise OSError(number, os.strerror(number), "out/a.mcap")

    with pytest.raises(SystemExit) as end, pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["safestage"])
        run(command)
    assert end.value.code == 2
    assert f"error: out/a.mcap: {said}: {os.strerror(number)}." in capsys.readouterr().err


def test_other_errors_are_bugs_and_stay_visible():
    @click.command()
    def command():
        raise OSError(errno.EBADF, "a bug")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["safestage"])
        with pytest.raises(OSError, match="a bug"):
            run(command)


@pytest.mark.parametrize(
    ("given", "said"),
    [("jsn", "Did you mean 'json'?"), ("parket", "Did you mean 'parquet'?"), ("x", "")],
)
def test_a_misspelt_choice_is_answered_with_the_nearest(capsys, given, said):
    @click.command()
    @click.option("--form", type=click.Choice(["json", "parquet", "table"]))
    def command(form):
        raise AssertionError

    with pytest.raises(SystemExit) as end, pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["safestage", "--form", given])
        run(command)
    printed = capsys.readouterr().err
    assert end.value.code == 2
    assert said in printed
    assert ("Did you mean" in printed) == bool(said)
