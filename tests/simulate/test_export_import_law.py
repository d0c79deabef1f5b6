"""A rollout that goes out as stored states and comes back: the same motion, and no verdict made up."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import h5py
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


def there_and_back(
    task: str, reference: str, folder: Path, *, ctrl: bool
) -> tuple[Episode, Episode]:
    """The episode, and its import with the materials and tags that a map file can tell; with ``ctrl`` or not."""
    episode, file = rolled_out(task, f"reference:{reference}", folder / "demo.hdf5")
    if not ctrl:
        with h5py.File(file, "a") as stored:
            del stored["data/demo_1/ctrl"]
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


TASK = "ets_lemon_past_candle"


@pytest.fixture(scope="module", params=["unsafe"])
def pair(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Episode, Episode]:
    return there_and_back(TASK, request.param, tmp_path_factory.mktemp("law"), ctrl=True)


@pytest.fixture(scope="module", params=["unsafe"])
def uncommanded(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Episode, Episode]:
    return there_and_back(TASK, request.param, tmp_path_factory.mktemp("law"), ctrl=False)


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


def robot_forces(episode: Episode) -> dict[tuple[int, frozenset[str]], np.ndarray]:
    """Frame and pair of bodies of which one is the robot's → (3,) N between the two."""
    names, table = [ours(b.name) for b in episode.header.bodies], episode.contacts
    robot = {i for i, b in enumerate(episode.header.bodies) if b.kind in ("robot", "gripper")}
    found: dict[tuple[int, frozenset[str]], np.ndarray] = {}
    for frame, a, b, force in zip(table.frame, table.body1, table.body2, table.force, strict=True):
        if a in robot or b in robot:
            key = int(frame), frozenset((names[a], names[b]))
            sign = 1 if names[a] < names[b] else -1
            found[key] = found.get(key, np.zeros(3)) + sign * force.astype(np.float64)
    return found


def errors(pair: tuple[Episode, Episode]) -> tuple[np.ndarray, int]:
    """N, by how much known forces between the robot and the world are off; and how many are unknown."""
    true, after = (robot_forces(episode) for episode in pair)
    off = np.array(
        [np.linalg.norm(after[key] - force) for key, force in true.items() if key in after]
    )
    return off[np.isfinite(off)], int(np.isnan(off).sum())


def test_forces_without_commands_are_right_or_unknown(uncommanded: tuple[Episode, Episode]) -> None:
    off, unknown = errors(uncommanded)
    assert len(off) > 0.3 * (len(off) + unknown)
    assert np.median(off) < 0.02
    assert np.mean(off < 0.05) > 0.8
    assert off.max() < 1  # of 80 N


def test_no_verdict_changes_sides_without_commands(uncommanded: tuple[Episode, Episode]) -> None:
    before, after = (verdicts(judge(episode, RULES)) for episode in uncommanded)
    changed = {rule: after[rule] for rule in before if before[rule] != after[rule]}
    assert set(changed.values()) == {"inconclusive"}
    assert changed.keys() <= {"ETS102", "ETS103", "ETS106", "FSH101", "FSH105"}


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
