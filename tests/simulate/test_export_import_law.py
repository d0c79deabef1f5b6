"""A rollout that goes out as stored states and comes back: the same motion, and no verdict made up."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from foreign_demos import imported
from robosuite_layout import ours, rolled_out

from safestage_eval.episode import Episode
from safestage_eval.importers import MapFile
from safestage_eval.importers.map_tables import BodyTable
from safestage_eval.rules.load import load_rules
from safestage_eval.verdicts import EpisodeResult
from safestage_eval.verdicts.judging import judge
from simulate.arm import droid

pytestmark = pytest.mark.simulate

RULES = load_rules(["ish", "ets", "fsh", "goals"])
LEFT = ("task", "stage", "roles", "goal", "rules", "parameters", "success", "success_time",
        "termination", "post_success_hold", "horizon")  # fmt: skip
"""Facts of the header that states lack, given back as by ``--map`` and ``--bind``."""


def there_and_back(task: str, reference: str, folder: Path) -> tuple[Episode, Episode]:
    """The episode, and its import with the materials and tags that a map file can tell."""
    episode, file = rolled_out(task, f"reference:{reference}", folder / "demo.hdf5")
    tables = {
        body.name: BodyTable(material=body.material, tags=body.tags)
        for body in episode.header.bodies
        if body.kind == "object"
    }
    back, _ = imported(
        file, map_=MapFile(body=tables), assets=(droid.default_mjcf().parent,), dt=episode.dt
    )
    header = episode.header
    kept = back.header.model_copy(
        update={"episode_id": "back"} | {key: getattr(header, key) for key in LEFT}
    )
    return episode, replace(back, header=kept, _contacts=back.contacts, _frames=back.frames)


@pytest.fixture(scope="module", params=["unsafe", pytest.param("safe", marks=pytest.mark.slow)])
def pair(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Episode, Episode]:
    return there_and_back("ets_lemon_past_candle", request.param, tmp_path_factory.mktemp("law"))


def test_poses_come_back_to_float_precision(pair: tuple[Episode, Episode]) -> None:
    episode, back = pair
    assert len(back) == len(episode)
    assert back.t == pytest.approx(episode.t, abs=1e-9)
    for body in back.header.bodies:
        before = episode.track(ours(body.name))
        after = back.track(body.name)
        assert np.abs(after.position - before.position).max() <= 1e-6
        assert np.abs(np.abs((after.orientation * before.orientation).sum(1)) - 1).max() < 1e-6
        assert np.abs(after.linear_velocity - before.linear_velocity).max() < 1e-4
        was = episode.bodies[ours(body.name)]
        assert (body.kind, body.finger) == (was.kind, was.finger)
        assert len(body.geoms) == len(was.geoms)
        for geom, as_it_was in zip(body.geoms, was.geoms, strict=True):
            assert geom.friction == pytest.approx(as_it_was.friction, rel=1e-9)  # XML rounds
            assert geom.model_copy(update={"friction": as_it_was.friction}) == as_it_was


def test_the_same_bodies_touch(pair: tuple[Episode, Episode]) -> None:
    episode, back = pair

    def touching(e: Episode) -> set[tuple[int, frozenset[str]]]:
        names, table = [ours(b.name) for b in e.header.bodies], e.contacts
        near = table.depth >= 0
        return {
            (int(f), frozenset((names[a], names[b])))
            for f, a, b in zip(table.frame[near], table.body1[near], table.body2[near], strict=True)
        }

    assert touching(back) == touching(episode)


def verdicts(result: EpisodeResult) -> dict[str, str]:
    return {verdict.rule: verdict.verdict for verdict in result.verdicts}


def test_no_verdict_is_made_up(pair: tuple[Episode, Episode]) -> None:
    episode, back = pair
    before, after = verdicts(judge(episode, RULES)), verdicts(judge(back, RULES))
    changed = {rule: (before[rule], after[rule]) for rule in before if before[rule] != after[rule]}
    assert {to for _, to in changed.values()} <= {"inconclusive"}
    # what is asked of tilts alone is open: up axes were lost
    assert changed.keys() <= {"ETS102", "ETS103", "FSH101"}
    assert "FSH101" in changed
