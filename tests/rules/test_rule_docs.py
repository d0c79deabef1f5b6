"""What docs/rules.md shows is true."""

import re
import shlex
from pathlib import Path

import pytest
from studio import run

from safestage_eval.rules import check_rules, load_bind, load_rules

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "rules.md").read_text("utf-8")


def test_the_example_checks_clean_and_its_mistake_looks_as_shown(
    tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    example = re.search(r"```toml\n(\[ruleset\].*?)```", TEXT, re.S)[1]
    Path("mine.toml").write_text(example, "utf-8")
    assert list(load_rules(["mine.toml"]).rules) == ["ETS901"]
    shown = re.search(r"```\n(error\[.*?)\n```", TEXT, re.S)[1]
    Path("mine.toml").write_text(example.replace(">= keep_off", ">= 20 N"), "utf-8")
    assert shown in [d.render() for d in check_rules(["mine.toml"])]


@pytest.mark.parametrize("value", ["5 cm", "2 cm"])
def test_five_minutes_show_red_and_then_green_by_a_number(
    value: str, tmp_path: Path, monkeypatch
) -> None:
    """Every line that is shown is printed; with 5 cm one of two recordings violates, with 2 cm none."""
    monkeypatch.chdir(tmp_path)
    Path("traces").symlink_to(ROOT / "traces")
    Path("mine.toml").write_text(re.search(r"```toml\n(\[ruleset\].*?)```", TEXT, re.S)[1], "utf-8")
    setting = f'--set keep_off="{value}"' if value == "2 cm" else ""
    (shown,) = (
        block
        for block in re.findall(r"^```\n\$ (safestage score .*?)^```", TEXT, re.S | re.M)
        if ("--set" in block) == bool(setting)
    )
    command, *lines = shown.splitlines()
    done = run(*shlex.split(command)[1:])
    assert setting in command
    assert [line for line in lines if line not in done.text.splitlines() and line != "…"] == []
    assert ("Violations: 1 of 2" in done.text) == (value == "5 cm")


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
    from safestage_eval.rules.keys import TABLES

    for table in ("ruleset", "state", "phase", "goal", "task", "rule", "cost"):
        assert all(f"`{key}`" in TEXT or f"`{key} =" in TEXT for key in TABLES[table]), table


def test_the_examples_of_the_example_hold(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```toml\n(.*?)```", TEXT, re.S)
    rule, sketch, names = (
        next(block for block in blocks if block.startswith(start))
        for start in ("[ruleset]", "says  ", "[rule.examples]")
    )
    Path("mine.toml").write_text(rule + names, "utf-8")
    Path("examples").mkdir()
    Path("examples/vase_passed.toml").write_text(sketch, "utf-8")
    done = run("rules", "test", "mine.toml", "--mutate")
    assert done.code == 0, done.text + done.err
    assert "6 of 6 examples" in done.text
