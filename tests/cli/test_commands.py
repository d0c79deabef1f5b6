"""The group: help, version, and the commands that need the simulator."""

import importlib.util
import os
import re
import subprocess
import sys
import types

import pytest
from studio import run

import safestage_eval
from safestage_eval.cli import COMMANDS, FROM_SIMULATE, HELP, RENAMED, SHELVES

HEAVY = ("numpy", "polars", "pandas", "pyarrow", "scipy", "trimesh", "fcl", "mcap")


@pytest.mark.parametrize(
    "arguments",
    [["--help"], *([*name.split(), "-h"] for name in (*COMMANDS, "rules show", "rules test"))],
    ids=" ".join,
)
def test_help_imports_nothing_heavy(arguments):
    code = f"""
import sys
sys.argv = ["safestage", *{arguments!r}]
from safestage_eval.cli import main
try:
    main()
except SystemExit as end:
    print("EXIT", end.code)
print("HEAVY", *[name for name in {HEAVY!r} + ("mujoco",) if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "Usage" in done.stdout
    assert [line.split() for line in done.stdout.splitlines()[-2:]] == [["EXIT", "0"], ["HEAVY"]]


def test_help_lists_twelve_commands_on_shelves():
    text = run("--help").text
    shelves = re.findall(r"^([A-Z][\w, ]*):\n((?:  .*\n)+)", text, re.MULTILINE)
    listed = {name: re.findall(r"^  (\w+)", rows, re.MULTILINE) for name, rows in shelves}
    assert [name for name in listed if name != "Options"] == [*SHELVES]
    names = [name for shelf in [*SHELVES][:-1] for name in listed[shelf]]
    assert len(names) == 12
    assert all(word in text for path in HELP for word in path.split())


@pytest.mark.parametrize("name", RENAMED)
def test_an_old_name_runs_the_new_command_and_says_so(name):
    done = run(name, "--help")
    assert f"safestage {RENAMED[name]} " in done.text
    assert done.err == f"note: safestage {name} is now safestage {RENAMED[name]}\n"


def test_score_shows_few_options_and_all_on_request():
    few, every = (
        re.findall(r"^  (?:-\w, )?(--[\w-]+)", run("score", flag).text, re.MULTILINE)
        for flag in ("--help", "--help-all")
    )
    assert len(few) <= 15
    assert {*few} | {"--strict", "--resume", "--limits", "--engine"} <= {*every}


RULES = ("check", "show", "signals", "schema", "diff", "test")


@pytest.mark.parametrize("name", [*COMMANDS, *(f"rules {name}" for name in RULES)])
def test_every_help_shows_an_example_and_fits_a_terminal(name):
    done = run(*name.split(), "--help")
    assert done.code == 0
    lines = done.text.splitlines()
    assert any(line.strip().startswith("safestage") for line in lines)
    assert [line for line in lines if len(line) > 80] == []


def test_version():
    assert safestage_eval.__version__ in run("--version").text


def test_an_unknown_command():
    done = run("scoer")
    assert (done.code, done.out) == (2, b"")
    assert "scoer" in done.err


@pytest.mark.parametrize(
    ("arguments", "instead"),
    [
        ("rules lsp", "schemas/rules.schema.json"),
        ("verify rows.csv traces/", "--golden FILE"),
        ("score traces/ --cache kept", "--resume DIR"),
        ("score traces/ --clearance-backend fcl", "certified bounds"),
        ("score traces/ --no-cache", "--resume DIR"),
        ("score traces/ --manifest m.json", "--output FILE"),
        ("compare verdicts a b --format csv", "--format json"),
        ("compare a b --resamples 100", "--random-seed"),
    ],
)
def test_what_is_gone_names_its_replacement_in_one_line(arguments, instead):
    done = run(*arguments.split())
    assert (done.code, done.out) == (2, b"")
    (line,) = done.err.splitlines()
    assert line.startswith("error: ")
    assert re.search(
        r"safestage (rules lsp|verify|(score|rules test|compare|compare verdicts) --[a-z -]+) is gone: ",
        line,
    )
    assert instead in line


@pytest.fixture
def no_mujoco(monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util,
        "find_spec",
        lambda name, package=None: None if name == "mujoco" else find(name, package),
    )


@pytest.mark.parametrize("name", FROM_SIMULATE)
@pytest.mark.parametrize("arguments", [[], ["list"], ["--seeds", "0..3"]])
def test_without_mujoco_the_extra_is_named(no_mujoco, name, arguments):
    done = run(*name.split(), *arguments)
    assert (done.code, done.out) == (2, b"")
    assert "pip install 'safestage[simulate]'" in done.err


@pytest.mark.parametrize("name", FROM_SIMULATE)
def test_help_needs_no_extra(no_mujoco, name):
    done = run(*name.split(), "--help")
    assert (done.code, done.err) == (0, "")
    assert len(done.text.splitlines()) > 8


@pytest.mark.parametrize("name", FROM_SIMULATE)
def test_a_foreign_package_in_its_place_is_named(monkeypatch, tmp_path, name):
    foreign = tmp_path / "simulate.py"
    foreign.write_text("")
    spec = importlib.util.spec_from_file_location("simulate", foreign)
    module = types.ModuleType("simulate")
    module.__spec__ = spec
    monkeypatch.setitem(sys.modules, "simulate", module)
    done = run(*name.split())
    assert (done.code, done.out) == (2, b"")
    assert "another package named 'simulate'" in done.err
    assert str(foreign) in done.err


def test_the_simulator_missing_altogether(monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util,
        "find_spec",
        lambda name, package=None: None if name == "simulate" else find(name, package),
    )
    done = run("bench", "record")
    assert done.code == 2
    assert "safestage[simulate]" in done.err


@pytest.mark.parametrize("arguments", [("rules", "show"), ("rules", "signals", "--json")])
def test_a_reader_that_goes_away_is_no_failure(arguments):
    """Close the pipe early, like ``safestage rules show | head -1``."""
    code = "import sys; from safestage_eval.cli import main; sys.argv[0] = 'safestage'; main()"
    arguments = [sys.executable, "-c", code, *arguments]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as command:
        command.stdout.readline()
        command.stdout.close()
        assert command.wait() == 0
        assert command.stderr.read() == b""


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("safestage co", {"convert", "compare"}),
        ("safestage rules sh", {"show"}),
        ("safestage score --form", {"--format"}),
        ("safestage score --format j", {"json", "jsonl", "junit"}),
        ("safestage re", {"report"}),
    ],
)
def test_the_shell_completes_as_help_says(typed, offered):
    text = run("--help").text
    assert "_SAFESTAGE_COMPLETE=bash_source safestage" in text
    words = typed.split()
    asked = {"COMP_WORDS": typed, "COMP_CWORD": str(len(words) - 1)}
    done = subprocess.run(
        [sys.executable, "-c", "import sys; sys.argv[0] = 'safestage'\n"
         "from safestage_eval.cli import main; main()"],
        env={**os.environ, **asked, "_SAFESTAGE_COMPLETE": "bash_complete"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert {line.partition(",")[2] for line in done.stdout.split()} == offered
