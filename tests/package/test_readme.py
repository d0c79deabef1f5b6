"""What the README shows works as it stands there."""

import re

import pytest
from click.testing import CliRunner

from safestage_eval.cli import group
from safestage_eval.formats import load
from safestage_eval.rules.load import load_rules


@pytest.fixture(scope="module")
def readme(checkout):
    return (checkout / "README.md").read_text("utf-8")


def blocks(readme, language):
    return re.findall(rf"^```{language}\n(.*?)^```$", readme, re.MULTILINE | re.DOTALL)


def test_the_recorder_writes_a_trace(readme, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (code,) = (block for block in blocks(readme, "python") if "TraceWriter" in block)
    exec(compile(code, "README.md", "exec"), {})
    episode = load("mine.mcap")
    assert episode.header.roles["target"] == ("cube",)
    run = CliRunner().invoke(group, ["score", "mine.mcap"])
    assert "Violations: 1 of 1" in run.stdout, run.output
    assert "edge_margin(cube) was 1.0 cm" in " ".join(run.stdout.split())


def test_the_notebook_runs(readme, checkout, monkeypatch):
    pytest.importorskip("matplotlib").use("Agg")
    monkeypatch.chdir(checkout)
    (code,) = (block for block in blocks(readme, "python") if "sse.load" in block)
    names = {}
    exec(compile(code, "README.md", "exec"), names)
    assert len(names["rows"]) > 0


@pytest.mark.parametrize("command", ["score", "explain"])
def test_the_tour_shows_what_is_printed(readme, checkout, monkeypatch, command):
    monkeypatch.chdir(checkout)
    (shown,) = (
        block
        for block in blocks(readme, "")
        if ("Violations: 6" in block if command == "score" else "$ safestage explain" in block)
    )
    arguments = "score traces/ --rules rules/"
    if command == "explain":
        first, shown = shown.split("\n", 1)
        arguments = first.removeprefix("$ safestage ")
    printed = CliRunner().invoke(group, arguments.split()).stdout.splitlines()
    assert [line for line in shown.splitlines() if line not in printed and "…" not in line] == []


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
