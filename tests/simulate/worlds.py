"""Small worlds to record, without a task."""

from __future__ import annotations

from typing import Any

import numpy as np

from safestage_eval.episode import Episode, Header
from simulate.arm import droid
from simulate.catalogue.objects import ObjectModel, catalogue
from simulate.record.recorder import Recorder
from simulate.world.world import FRAME_RATE, World

STILL = np.append(droid.HOME, 0.0)


def world_of(*names: str, substeps: int = 1, more: dict[str, ObjectModel] | None = None) -> World:
    """A world with objects of the catalogue, under their own names, and some of one's own."""
    return World({n: catalogue()[n] for n in names} | (more or {}), substeps=substeps)


def put(world: World, **positions: Any) -> None:
    """Reset, with upright objects at these positions (m)."""
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    world.reset({n: (np.asarray(p, float), upright) for n, p in positions.items()})


def recorder_of(world: World) -> Recorder:
    """A recorder of the world as it is now."""
    return Recorder(
        world,
        Header(
            episode_id="test",
            physics_dt=1 / (FRAME_RATE * world.substeps),
            frame_dt=1 / FRAME_RATE,
            force_source="recorded",
        ),
    )


def recording(world: World, actions: int, action: Any = STILL) -> Episode:
    """Frames of so many actions from now on."""
    recorder = recorder_of(world)
    for _ in range(actions):
        world.act(action, lambda substep: recorder.step(substep, action))
    return recorder.writer.episode()


def force_on(episode: Episode, name: str) -> Any:
    """(T, 3) N, sum of all contact forces on a body, world."""
    body, contacts = episode.body_index[name], episode.contacts
    out = np.zeros((len(episode), 3))
    np.add.at(out, contacts.frame[contacts.body2 == body], contacts.force[contacts.body2 == body])
    np.add.at(out, contacts.frame[contacts.body1 == body], -contacts.force[contacts.body1 == body])
    return out
