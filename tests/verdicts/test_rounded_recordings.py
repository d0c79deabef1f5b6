"""Recordings whose numbers were stored coarsely are refused by nothing, and judged as before."""

from pathlib import Path

import pytest
from exports import map_text, write_lerobot, write_maniskill, write_robolab
from rounded import ROUNDINGS, in_steps, rounded
from sampled import share
from seeded_defects import BIN, SHELF, sound

from safestage_eval.doubts import contradictions
from safestage_eval.episode.invariants import check
from safestage_eval.formats import discover
from safestage_eval.importers import Settings, import_all, load_map
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import judge

ROOT = Path(__file__).parents[2]
WAYS = {name: lambda e, by=by: rounded(e, by) for name, by in ROUNDINGS.items()}
WAYS["forces in steps of 1/32 N"] = in_steps


def alike(episode, way, rules=None):
    """Nothing is refused, and verdicts are those of before."""
    coarse = WAYS[way](episode)
    assert not [*check(coarse), *contradictions(coarse)]
    if rules is None:
        return
    before, after = (
        {v.rule: (v.verdict, v.margin) for v in judge(e, rules).verdicts} for e in (episode, coarse)
    )
    changed = {c: (before[c], after[c]) for c in before if before[c][0] != after[c][0]}
    assert not changed, (episode.header.episode_id, changed)


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_recordings(way):
    rules = load_rules([ROOT / "rules"])
    for ref in share(discover([ROOT / "traces", ROOT / "traces_learned"]), 16, of=way):
        alike(ref.open(), way, rules)


@pytest.mark.parametrize("layout", ["robolab", "maniskill", "lerobot"])
@pytest.mark.parametrize("name", [one[0] for one in (SHELF, BIN)])
def test_recordings_of_others(tmp_path, name, layout):
    episode = sound(name)
    text = map_text(episode, success=layout == "lerobot")
    source, file = tmp_path / "theirs", tmp_path / "map.toml"
    if layout == "robolab":
        path = write_robolab(source, [episode], boxes=False)
    elif layout == "maniskill":
        path = write_maniskill(source, episode)
    else:
        path, columns = write_lerobot(source, [episode], "v3.0")
        text += columns
    file.write_text(text)
    assert not import_all(path, tmp_path / "data", Settings(map=load_map(file))).failed
    [ref] = discover(tmp_path / "data")
    for way in WAYS:
        alike(ref.open(), way)
