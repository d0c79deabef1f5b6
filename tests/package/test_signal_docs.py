"""docs/signals.md speaks of every signal and relation, and shows each on a scene."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

import pytest

from safestage_eval.relations.vocabulary import RELATIONS
from safestage_eval.rules import string_parser
from safestage_eval.signals import SIGNALS

DOCS = Path(__file__).parents[2] / "docs"
TABLE = tomllib.loads((DOCS / "signals.toml").read_text("utf-8"))


def test_every_signal_and_relation_is_there() -> None:
    assert set(TABLE) == {*SIGNALS, *RELATIONS}


def test_the_page_is_the_one_that_the_table_makes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [str(DOCS), *sys.path])
    import figures

    page = (DOCS / "signals.md").read_text("utf-8")
    assert page == figures.page(TABLE), "run python docs/figures.py --page"


@pytest.mark.parametrize("name", TABLE)
def test_a_picture_shows_what_it_says(name: str) -> None:
    """Labels of the picture are text in the file."""
    entry = TABLE[name]
    picture = (DOCS / "images" / "signals" / f"{name}.svg").read_text("utf-8")
    assert entry["signal"] in picture
    assert string_parser.call(entry["signal"]).name == name
    assert all(f"{time:.1f} s" in picture for time in entry["times"])
    scene = DOCS / "scenes" / f"{entry['scene']}.toml"
    assert scene.is_file()
