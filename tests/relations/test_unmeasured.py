"""Relations that are known although some forces are missing hold for whatever the forces were."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from scenes import G, Scene
from told import doubt_of, holds

from safestage_eval.episode import ContactTable, Episode
from safestage_eval.evidence.measure import Signals
from safestage_eval.formats import discover, load
from safestage_eval.relations.relations import Relations

TRACES = Path(__file__).parents[2] / "traces"
ONE = ("held", "supported", "carried", "caused", "leaned_on")
TWO = ("supports", "exposed_to")


def hidden(episode: Episode, rng: np.random.Generator, *, partly: bool) -> Episode:
    """The forces of some pairs at some frames are unknown, or known from below."""
    table = ContactTable(
        **{f.name: np.asarray(getattr(episode.contacts, f.name)) for f in fields(ContactTable)}
    )
    pair = table.body1.astype(np.int64) * 1000 + table.body2
    chosen = rng.choice(np.unique(pair), size=3)
    begin, length = rng.integers(len(episode)), rng.integers(1, len(episode) // 3)
    off = np.isin(pair, chosen) & (table.frame >= begin) & (table.frame < begin + length)
    if not off.any():
        return episode
    force, peak = table.force.copy(), table.peak_force.copy()
    force[off], peak[off] = (0.1 if partly else np.nan) * force[off], np.nan
    if not partly:
        return replace(episode, _contacts=replace(table, force=force, peak_force=peak))
    order = np.argsort(np.concatenate([table.frame, table.frame[off]]), kind="stable")
    columns = {
        name: np.concatenate([values, values[off]])[order]
        for name, values in vars(replace(table, force=force, peak_force=peak)).items()
        if isinstance(values, np.ndarray) and len(values) == len(table)
    }
    extra = order >= len(table)
    columns["force"][extra], columns["peak_force"][extra] = np.nan, np.nan
    return replace(episode, _contacts=replace(table, **columns))


def answers(episode: Episode) -> dict[tuple[str, ...], tuple[np.ndarray, np.ndarray]]:
    """Relation or signal and bodies → (T,) the least that it may be at each frame, and the most."""
    relations, found = Relations(Signals(episode)), {}
    movable = [b.name for b in episode.header.bodies if b.movable and b.kind == "object"]
    asked = [(name, body) for name in ONE for body in movable]
    asked += [(name, a, b) for name in TWO for a in movable for b in movable if a != b]
    asked += [("exposed_to", body, "robot") for body in movable]
    for name, *bodies in asked:
        truth, doubt = holds(relations, name, bodies), doubt_of(relations, name, bodies)
        if truth is not None:
            open_ = np.zeros(len(truth), np.bool_) if doubt is None else doubt[0]
            found[name, *bodies] = truth & ~open_, truth | open_
    measured = [(name, body, "robot") for name in ("moved_by", "tipped_by") for body in movable]
    for name, *bodies in measured + [("fall", body) for body in movable]:
        series = relations.signal(name, bodies)
        found[name, *bodies] = series.lower, series.upper
    return found


@pytest.mark.parametrize("partly", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_what_is_known_without_some_forces_is_so_with_them(seed: int, partly: bool) -> None:
    rng = np.random.default_rng(seed)
    ref = [*discover([TRACES])][seed]
    episode = load(ref.path, episode=ref.episode_id)
    whole, part = answers(episode), answers(hidden(episode, rng, partly=partly))
    assert whole.keys() == part.keys()
    for asked, (least, most) in part.items():
        low, high = whole[asked]
        trembling = (
            1e-3 if asked[0] == "fall" else 1e-9
        )  # m, of what comes down after a doubtful frame
        assert (least <= low + trembling).all(), (ref, asked)
        assert (most >= high - 1e-9).all(), (ref, asked)


def grip(certain: float | None, normal: tuple[float, float, float] = (-1, 0, 0)) -> Relations:
    """A hand squeezes box a in the air, while b stands by itself; in frames 10–19 its forces are unknown.

    ``certain``: of the 5 N of each finger, what is known at these frames all the same; None: they do
    not even touch for certain. ``normal``: of the right finger's contact, into the box.
    """
    scene = Scene(40).fixed("table").box("a", 0.05, (0, 0, 0.3)).box("b", 0.05, (0.3, 0, 0.05))
    scene.rests("b", "table", 0.05, (0.3, 0, 0), G)
    for side, x, into in (("left", -0.06, (1, 0, 0)), ("right", 0.06, normal)):
        scene.box(side, 0.01, (x, 0, 0.3), kind="gripper", finger=side)
        force = 5 * np.array(into) + (0, 0, G / 2)
        for frames in (slice(0, 10), slice(20, None)):
            scene.contact(side, "a", (x, 0, 0.3), force, normal=into, frames=frames)
        if certain is not None:
            scene.contact(side, "a", (x, 0, 0.3), certain * np.array(into), into, slice(10, 20))
        scene.contact(side, "a", (x, 0, 0.3), (np.nan,) * 3, into, slice(10, 20))
    return Relations(Signals(scene.episode()))


def open_at(relations: Relations, name: str, *bodies: str) -> list[int]:
    holds(relations, name, bodies)
    doubt = doubt_of(relations, name, bodies)
    return [] if doubt is None else np.flatnonzero(doubt[0]).tolist()


LOST = [*range(10, 20)]


def test_what_a_hand_squeezes_with_does_not_matter_to_what_stands_elsewhere() -> None:
    relations = grip(None)
    for name in ("supported", "carried", "held"):
        assert open_at(relations, name, "b") == []
    assert open_at(relations, "held", "a") == open_at(relations, "carried", "a") == LOST


def test_fingers_that_certainly_press_from_both_sides_hold() -> None:
    assert open_at(grip(0.5), "held", "a") == []
    assert open_at(grip(0.1), "held", "a") == LOST  # too little for a grip
    both = grip(0.5, normal=(1, 0, 0))  # on one side: whatever they press with is no grip
    assert open_at(both, "held", "a") == []
    assert not holds(both, "held", ["a"]).any()
    assert open_at(grip(0.5), "carried", "a") == LOST
