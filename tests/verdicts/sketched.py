"""Drawn scenes judged by the built-in rules, with their contact forces or without."""

from dataclasses import fields
from pathlib import Path

import pytest
from transforms import rebuilt

from safestage_eval.episode import ContactTable, Episode
from safestage_eval.rules import load_rules
from safestage_eval.sketch import read
from safestage_eval.verdicts import judge
from safestage_eval.verdicts.verdict import Verdict

with_and_without_forces = pytest.mark.parametrize("forces", [True, False])


def drawn(text: str, tmp_path: Path) -> Episode:
    file = tmp_path / "scene.toml"
    file.write_text(text, encoding="utf-8")
    return plain(file)


def plain(file: Path) -> Episode:
    sketch = read(file)
    return Episode(**{field.name: getattr(sketch, field.name) for field in fields(sketch)})


def verdict(episode: Episode, rule: str, forces: bool) -> Verdict:
    if not forces:
        header = episode.header.model_copy(update={"force_source": "none"})
        episode = rebuilt(episode, header=header, contacts=ContactTable.empty())
    found = judge(episode, load_rules(["ish", "ets", "fsh"])).verdicts
    return next(v for v in found if v.rule == rule)
