"""docs/rules.md is true; docs/tutorials is executed by tests/package/test_tutorials.py."""

import re
from pathlib import Path

from safestage_eval.rules import check_rules, load_bind, load_rules

ROOT = Path(__file__).parents[2]
TUTORIAL = (ROOT / "docs" / "tutorials" / "own_rule.md").read_text("utf-8")
TEXT = (ROOT / "docs" / "rules.md").read_text("utf-8")


def test_the_example_checks_clean_and_its_mistake_looks_as_shown(
    tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    example = re.search(r"```toml [^\n]*\n(\[ruleset\].*?)```", TUTORIAL, re.S)[1]
    Path("mine.toml").write_text(example, "utf-8")
    assert list(load_rules(["mine.toml"]).rules) == ["ETS901"]
    shown = re.search(r"```\n(error\[.*?)\n```", TUTORIAL, re.S)[1]
    Path("mine.toml").write_text(example.replace(">= keep_off", ">= 20 N"), "utf-8")
    assert shown in [d.render() for d in check_rules(["mine.toml"])]


def test_the_cost_and_the_bind_file_shown_are_sound(tmp_path: Path) -> None:
    cost = re.search(r"```toml\n(\[\[cost\]\].*?)```", TEXT, re.S)[1]
    head = '[ruleset]\nformat = 1\nname = "mine"\nversion = "1"\nextends = ["defaults"]\n'
    (tmp_path / "cost.toml").write_text(head + cost, "utf-8")
    assert list(load_rules([tmp_path / "cost.toml"]).costs) == ["ETS951"]
    (tmp_path / "labels.toml").write_text(
        re.search(r"```toml\n(\[task\.pour_tea\].*?)```", TEXT, re.S)[1], "utf-8"
    )
    bound = load_bind(tmp_path / "labels.toml", load_rules(["ets", "goals"]))
    assert (list(bound.tasks), list(bound.episodes)) == (["pour_tea"], ["tea-17"])


def test_every_key_is_explained() -> None:
    from safestage_eval.rules.table_keys import TABLES

    for table in ("ruleset", "state", "phase", "goal", "rule", "cost"):
        assert all(f"`{key}`" in TEXT or f"`{key} =" in TEXT for key in TABLES[table]), table


def test_the_grammar_shown_is_the_grammar() -> None:
    from safestage_eval.rules.string_parser import GRAMMAR

    shown = dict(re.findall(r"^([A-Z]+) += (.+)$", TEXT, re.M))
    assert shown == GRAMMAR
