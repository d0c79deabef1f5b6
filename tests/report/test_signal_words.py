"""Signals that are told in words of their own exist: one that is renamed would lose them in silence."""

import re
from pathlib import Path

import pytest

import safestage_eval.viewer
from safestage_eval.report.summary import MEASURES
from safestage_eval.rules import builtin_names, load_rules
from safestage_eval.signals import SIGNALS

DRAWING = Path(safestage_eval.viewer.__file__).parent / "browser" / "witness_drawing.js"


def touched() -> set[str]:
    """The signals of ``TOUCHED`` in the run browser."""
    (table,) = re.findall(r"const TOUCHED = \{(.*?)\}", DRAWING.read_text("utf-8"))
    return set(re.findall(r"(\w+):", table))


@pytest.mark.parametrize("names", [set(MEASURES), touched()], ids=["score", "browser"])
def test_every_signal_that_has_words_is_one(names: set[str]) -> None:
    rules = load_rules(builtin_names())
    assert names
    assert names <= {*SIGNALS, *rules.signals, *rules.derived}
