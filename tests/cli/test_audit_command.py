"""``safestage audit``: what it prints, and its exit codes."""

import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner
from damages import header
from seeded_defects import SHELF, sound

from safestage_eval.cli.audit_command import command
from safestage_eval.formats.parquet.dataset_writer import add_episode

TRACES = Path(__file__).parents[2] / "traces"


@pytest.fixture
def folder(tmp_path):
    """One episode with an error, and one with a note."""
    for name, damage in (
        ("bad", header(episode_id="bad", frame_dt=0.5)),
        ("noted", header(episode_id="noted", rules=(), family=None)),
    ):
        add_episode(damage(sound(SHELF[0]), name), tmp_path)
    return tmp_path


def run(*args):
    return CliRunner().invoke(command, [str(arg) for arg in args])


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ((), 1),
        (("--fail-on", "never"), 0),
        (("--ignore", "AUD103"), 0),
        (("--select", "AUD158"), 0),
        (("--select", "AUD158", "--fail-on", "warning"), 0),
        (("--select", "aud103,AUD158"), 1),
        (("--where", "episode_id=noted"), 0),
    ],
)
def test_exit_codes(folder, options, code):
    assert run(folder, *options).exit_code == code


def test_an_unreadable_trace_gives_2_and_stops_no_other(folder):
    whole = next(TRACES.glob("*.mcap"))
    shutil.copy(whole, folder / "cut.mcap")
    (folder / "cut.mcap").write_bytes(whole.read_bytes()[:5000])
    found = run(folder, "-f", "json")
    assert found.exit_code == 2
    listed = json.loads(found.stdout)
    assert {f["code"] for f in listed["findings"]} >= {"AUD103", "AUD158"}
    assert "cut.mcap" in listed["problems"][0]["path"]


def test_the_terminal_names_field_and_fix(folder):
    text = run(folder).stdout
    assert "bad  frame_dt" in text
    assert "set frame_dt = 0.00833" in text


def test_a_file_appears_whole(folder, tmp_path_factory):
    path = tmp_path_factory.mktemp("out") / "audit.xml"
    assert run(folder, "-f", "junit", "-o", path).exit_code == 1
    assert path.read_text().startswith("<?xml")


@pytest.mark.parametrize("code", ["AUD103", "aud1"])
def test_checks_are_explained(code):
    found = run("--explain", code)
    assert found.exit_code == 0
    assert "frame_dt is not the spacing" in found.stdout


def test_usage():
    assert run().exit_code == 2
    assert "AUD103" in str(run(TRACES, "--select", "AUD1O3").exception)
