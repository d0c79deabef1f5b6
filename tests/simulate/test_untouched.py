"""A robot that touches nothing is blamed for nothing, whatever settles, drops, slides and tumbles around it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from sampled import share
from still_robots import write_still

from safestage_eval.formats import discover
from safestage_eval.importers import Settings, import_all
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import judge

FOREIGN = Path(__file__).parent / "foreign"
RULES = ["ish", "ets", "fsh"]


@pytest.mark.slow
@pytest.mark.parametrize("name", share(["robosuite", "libero"], 2))
def test_a_robot_that_touches_nothing_is_blamed_for_nothing(tmp_path: Path, name: str) -> None:
    """All free things begin a little higher, turned and pushed; each plays every role."""
    assets = (FOREIGN / "robosuite" / "assets",)
    source = tmp_path / "demo.hdf5"
    count = write_still(FOREIGN / name / "demo.hdf5", source, range(3), assets=assets)
    assert not import_all(source, tmp_path / "data", Settings(assets=assets)).failed
    refs = discover([tmp_path / "data"])
    assert len(refs) == count
    for ref in refs:
        episode = ref.open()
        kinds = [body.kind in ("robot", "gripper") for body in episode.header.bodies]
        assert all(kinds[i] == kinds[j] for i, j in episode.contacts.pairs)
        things = [b.name for b in episode.header.bodies if b.kind == "object" and b.movable]
        for target in things[:3]:
            others = [thing for thing in things if thing != target]
            roles = {"target": [target], "protected": others, "dependent": others}
            header = episode.header.model_copy(update={"roles": roles})
            asked = replace(
                episode, header=header, _contacts=episode.contacts, _frames=episode.frames
            )
            verdicts = judge(asked, load_rules(RULES)).verdicts
            blamed = [f"{v.rule}: {v.explanation}" for v in verdicts if v.verdict == "violation"]
            assert not blamed
