"""Pictures of recordings with a room: own ones are dressed, roles keep the palette's colours."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import Scene

from safestage_eval.episode import Episode
from safestage_eval.palette import PAINTS, fractions
from simulate.catalogue.objects import catalogue
from simulate.looks.skins import skin
from simulate.policies.controls import Idle
from simulate.record.rollout import Setting, roll_out
from simulate.render.dressing import modelled, recorded_look
from simulate.render.marks import role_colors
from simulate.render.renderer import EpisodeRenderer, Style
from simulate.tasks.task import task_named

pytestmark = pytest.mark.simulate

TASK = task_named("fsh_orange_on_plate")


@pytest.fixture(scope="module")
def episode() -> Episode:
    return roll_out(Setting(TASK, 2, horizon=0.05), Idle()).episode()


def test_only_own_recordings_have_a_look(episode: Episode) -> None:
    look = recorded_look(episode.header)
    assert look is not None
    assert look.seed == Setting(TASK, 2).look, "the room that cameras of that seed see"
    foreign = Scene(frames=2)
    foreign.fixed("table")
    foreign.fixed("floor")
    assert recorded_look(foreign.episode().header) is None


def test_bodies_of_a_trace_are_found_in_the_catalogue(episode: Episode) -> None:
    found = {body.name: modelled(body) for body in episode.header.bodies}
    for name, place in TASK.objects.items():
        match = found[name]
        assert match is not None
        assert match[0] == (place.model or name)
    assert found["table"] is None


@pytest.mark.parametrize("role", ["target", "protected", "destination"])
def test_a_painted_skin_has_its_role_s_hue(role: str) -> None:
    """Whatever is printed on it, most of a painted thing is of the role's colour."""
    color = np.array(fractions(PAINTS[role]))
    for name in ("cracker_box", "rubiks_cube", "coffee_can", "tumbler", "hardback", "apple"):
        parts = skin(name, catalogue()[name], tuple(color))
        seen = np.concatenate([part.texture.reshape(-1, 3) for part in parts]) / 255
        middle = np.median(seen, axis=0)
        assert np.abs(middle - color).max() < 0.2, (name, middle, color)
        assert min(part.finish.opacity for part in parts) >= 0.7, name


@pytest.mark.slow
def test_a_dressed_picture_shows_the_same_bodies(episode: Episode) -> None:
    """Skins cover about the pixels of the shapes that they stand about, in a lit room."""
    colors = role_colors(episode.header)
    with EpisodeRenderer(episode, 160, 120, style=Style(colors)) as plain:
        before = plain.shown(0)
    look = recorded_look(episode.header)
    with EpisodeRenderer(episode, 160, 120, style=Style(colors, look=look)) as dressed:
        after, picture = dressed.shown(0), dressed.frame(0)
    for name in TASK.objects:
        assert after[name] == pytest.approx(before[name], rel=0.15, abs=8), name
    assert (picture.max(axis=2) > 20).mean() > 0.95, "nothing black about the scene"
