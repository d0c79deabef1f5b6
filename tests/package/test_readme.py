"""What the README shows works as it stands there."""

import re

import pytest

from safestage_eval.formats import load
from safestage_eval.rules.load import load_rules


@pytest.fixture(scope="module")
def readme(checkout):
    return (checkout / "README.md").read_text("utf-8")


def blocks(readme, language):
    return re.findall(rf"^```{language}\n(.*?)^```$", readme, re.MULTILINE | re.DOTALL)


def test_the_recorder_writes_a_trace(readme, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (code,) = blocks(readme, "python")
    exec(compile(code, "README.md", "exec"), {})
    episode = load("mine.mcap")
    assert len(episode) == 100
    assert episode.header.roles["target"] == ("cube",)


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
    assert {*re.findall(r"\b(?:ISH|ETS|FSH)\d+\b", readme)} - {"ETS901"} == {
        *load_rules([checkout / "rules"]).rules
    }
