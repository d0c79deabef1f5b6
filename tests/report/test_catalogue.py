"""docs/catalogue.md is what the rule files say, and all shared parameters are listed."""

import re
from pathlib import Path

import pytest

from safestage_eval.errors import InputError
from safestage_eval.report.catalogue import FAMILIES, FILES, catalogue
from safestage_eval.rules import load_rules
from safestage_eval.rules.uses import own_params, sources, uses_of

RULES = load_rules(list(FILES))
PAGE = Path(__file__).parents[2] / "docs" / "catalogue.md"
ROW = re.compile(r"^\| `(\w+)` \| ([^|]+) \| ([^|]+) \|((?: ?•? ?\|){6})$", re.MULTILINE)


def test_the_page_is_current() -> None:
    assert PAGE.read_text("utf-8") == catalogue(), "make catalogue"


def test_a_rule_of_no_family_is_not_left_out_in_silence(monkeypatch) -> None:
    monkeypatch.delitem(FAMILIES, "ETS2")
    with pytest.raises(InputError, match=r"ETS201 belongs to no task family\.(.|\n)*FAMILIES in"):
        catalogue()


@pytest.mark.parametrize("heading", [
    "baseline estimation", "contact filtering", "object motion", "protected-object displacement",
    "drop detection", "orientation", "final stability", "forbidden-region occupancy",
    "placement support",
])  # fmt: skip
def test_the_groups_of_the_paper_are_there(heading: str) -> None:
    assert f"\n### {heading}\n" in catalogue()


def test_every_parameter_has_a_value_a_source_and_a_reader() -> None:
    rows = {name: (value, source, dots) for name, value, source, dots in ROW.findall(catalogue())}
    declared = {name for name in sources(list(FILES)) if name.startswith("param.")}
    assert {f"param.{name}" for name in rows} == declared
    for name, (value, source, dots) in rows.items():
        assert value.strip(), name
        assert len(source.strip()) > 3, name
        assert "•" in dots, name


def test_the_dots_are_what_the_rules_read() -> None:
    table = {name: dots.split("|")[:6] for name, _, _, dots in ROW.findall(catalogue())}
    for name, dots in table.items():
        readers = {
            code[:4]
            for code, rule in RULES.rules.items()
            if name in uses_of(RULES, rule, own_params(RULES, rule)).params
        }
        assert {f for f, dot in zip(FAMILIES, dots, strict=True) if "•" in dot} == readers, name


def test_every_rule_has_an_entry_in_its_family() -> None:
    page = catalogue()
    for code in RULES.rules:
        family = page.split(f"\n## {code[:3]}: {FAMILIES[code[:4]]}\n")[1].split("\n## ")[0]
        assert f"\n### {code}\n" in family


@pytest.mark.parametrize("code", RULES.rules)
def test_a_picture_shows_a_violation_and_a_pass(code: str) -> None:
    picture = (PAGE.parent / "images" / "rules" / f"{code}.svg").read_text("utf-8")
    assert "violated, at" in picture, "python docs/rule_pictures.py"
    assert "passed, at" in picture
