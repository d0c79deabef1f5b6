"""Commands and code of the README work as they stand there."""

import json
import re
import shlex

import pytest
from click.testing import CliRunner

from safestage_eval.cli import group
from safestage_eval.formats import load
from safestage_eval.rules.load import load_rules


@pytest.fixture(scope="module")
def readme(checkout):
    return (checkout / "README.md").read_text("utf-8")


def blocks(readme, language):
    fenced = re.findall(r"^```(\w*)\n(.*?)^```$", readme, re.MULTILINE | re.DOTALL)
    return [text for name, text in fenced if name == language]


def lines_missing(shown):
    """Lines that a command, in the first line, does not print; one with … stands for any."""
    command, *lines = shown.splitlines()
    arguments = shlex.split(command.removeprefix("$ safestage "))
    printed = CliRunner().invoke(group, arguments).stdout.splitlines()
    return [line for line in lines if line not in printed and "…" not in line]


def test_the_recorder_writes_a_trace(readme, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (code,) = (block for block in blocks(readme, "python") if "TraceWriter" in block)
    exec(compile(code, "README.md", "exec"), {})
    episode = load("mine.mcap")
    assert episode.header.roles["target"] == ("cube",)
    (shown,) = (block for block in blocks(readme, "") if block.startswith("$ safestage score mine"))
    assert lines_missing(shown) == []
    assert "1 of 1 violated" in shown
    further = code.replace("0.26", "0.2")
    assert further != code
    exec(compile(further, "README.md", "exec"), {})
    rows = CliRunner().invoke(group, ["score", "mine.mcap", "-f", "jsonl"]).stdout.splitlines()
    (edge,) = (row for row in map(json.loads, rows) if row["rule"] == "FSH101")
    assert edge["verdict"] == "pass"


def test_the_notebook_of_the_results_page_runs(checkout, monkeypatch):
    pytest.importorskip("matplotlib").use("Agg")
    monkeypatch.chdir(checkout)
    (code,) = blocks((checkout / "docs/results.md").read_text("utf-8"), "python")
    names = {}
    exec(compile(code, "results.md", "exec"), names)
    assert len(names["scores"].rows) > 0


def test_the_tour_shows_what_is_printed(readme, checkout, monkeypatch):
    monkeypatch.chdir(checkout)
    (shown,) = (block for block in blocks(readme, "") if "6 of 12 violated" in block)
    assert lines_missing(f"$ safestage score traces/ --rules rules/\n{shown}") == []


def test_the_rule_finds_one_of_two_and_none_with_another_number(
    readme, checkout, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "traces").symlink_to(checkout / "traces")
    (tmp_path / "mine.toml").write_text(*blocks(readme, "toml"), "utf-8")
    (commands,) = (block for block in blocks(readme, "") if "--assign ETS901" in block)
    first, second = (
        CliRunner().invoke(group, shlex.split(command)[1:]).stdout
        for command in commands.splitlines()
    )
    assert "(1 of 2 violated)" in first
    assert "(0 of 2 violated)" in second


def test_the_rule_is_accepted(readme, tmp_path):
    (text,) = blocks(readme, "toml")
    file = tmp_path / "mine.toml"
    file.write_text(text, "utf-8")
    assert [*load_rules([file]).rules] == ["ETS901"]


def test_every_link_leads_somewhere(readme, checkout):
    links = [link for link in re.findall(r"\]\(([^)]+)\)", readme) if "://" not in link]
    assert links
    assert [link for link in links if not (checkout / link.partition("#")[0]).exists()] == []


def test_every_built_in_rule_is_listed(readme, checkout):
    listed = {
        f"{stage}{number}"
        for stage, first, last in re.findall(r"\b(ISH|ETS|FSH)(\d+)(?:–(\d+))?", readme)
        for number in range(int(first), int(last or first) + 1)
    }
    assert {*load_rules([checkout / "rules"]).rules} <= listed
