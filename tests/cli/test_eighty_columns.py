"""On a terminal of 80 columns no line is longer, and no word is broken."""

from pathlib import Path

import pytest
from click.testing import CliRunner
from rich.cells import cell_len

from safestage_eval._text.line_width import LINE_WIDTH
from safestage_eval.cli import group

ROOT = Path(__file__).parents[2]
EPISODE = "ets_apple_past_cans.reference-unsafe"


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Rows of the recorded episodes, a what-if table beside them."""
    folder = tmp_path_factory.mktemp("r")
    command = ["score", str(ROOT / "traces"), "-f", "parquet", "-o", str(folder / "r.parquet"),
               "--what-if", "all"]  # fmt: skip
    assert CliRunner().invoke(group, command).exit_code == 0
    return folder


def shown(monkeypatch, arguments, width):
    """Output of a command on a terminal of some width, stdout and stderr."""
    monkeypatch.setenv("COLUMNS", str(width))
    token = LINE_WIDTH.set(width)
    try:
        outcome = CliRunner().invoke(group, arguments)
    finally:
        LINE_WIDTH.reset(token)
    assert outcome.exception is None or isinstance(outcome.exception, SystemExit), outcome.output
    return outcome.output


COMMANDS = {
    "score": "score traces",
    "score, everything": "score traces --verbose",
    "score, by roles": "score traces --assign FSH101 --role target=apple",
    "score, by another set": "score traces --rules goals",
    "explain": f"explain traces {EPISODE}",
    "explain, everything": f"explain traces {EPISODE} --all",
    "explain, ambiguous": "explain traces",
    "inspect": f"inspect traces {EPISODE}",
    "audit": "audit traces --select AUD1,AUD3 --verbose",
    "audit --explain": "audit --explain AUD104",
    "validate": "validate traces",
    "rules check": "rules check rules",
    "rules show": "rules show ETS101",
    "rules show, a file": "rules show fsh",
    "rules signals": "rules signals",
    "rules signals, one": "rules signals clearance",
    "rules diff": "rules diff ets fsh",
    "rules test": "rules test rules/goals.toml",
    "aggregate": "aggregate RESULTS/r.parquet",
    "aggregate, intervals": "aggregate RESULTS/r.parquet --intervals",
    "compare": "compare RESULTS/r.parquet --by policy",
    "sweep": "sweep traces --rules fsh --param edge --steps 5",
    "slack": "slack RESULTS/r.parquet",
    "diff": "diff RESULTS/r.parquet RESULTS/r.parquet",
}


@pytest.mark.parametrize("name", COMMANDS)
def test_lines_fit_and_words_are_whole(monkeypatch, results, name):
    monkeypatch.chdir(ROOT)
    arguments = [part.replace("RESULTS", str(results)) for part in COMMANDS[name].split()]
    wide = shown(monkeypatch, arguments, 10_000)
    narrow = shown(monkeypatch, arguments, 80)
    lines = narrow.splitlines()
    assert not [line for line in lines if cell_len(line) > 80 and len(line.split()) > 1]
    assert not {*narrow.replace("─", "").split()} - {*wide.replace("─", "").split()}
    assert {*wide.replace("─", "").split()} - {*narrow.split()} == set()
