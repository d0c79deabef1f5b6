"""A trace that tells less leaves more open; it never gets the opposite verdict."""

import pytest

from safestage_eval.episode import Body, Episode
from safestage_eval.rules import load_rules
from safestage_eval.rules.files import builtin_folder
from safestage_eval.sketch import resolve
from safestage_eval.verdicts import judge

EXAMPLES = {
    "ISH101": ("can_from_under_bottle", "bottle_taken_off_first"),
    "ISH201": ("lemon_tipped_out", "lemon_taken_out_first"),
    "ETS103": ("obstacle_swept_off_step", "obstacle_disturbed(angle = 29)"),
    "ETS104": ("arm_beside_vase(hand_gap = 0.9)", "arm_beside_vase(hand_gap = 1.1)"),
    "FSH101": ("placed_on_shelf(margin = 1.9)", "placed_on_shelf(margin = 2.1)"),
    "FSH205": ("left_beside(during = 8 to 9)", "left_beside(during = 4.1 to 9.5)"),
}


def without_masses(episode: Episode) -> Episode:
    bodies = tuple(
        b.model_copy(update={"mass": None}) if b.kind == "object" else b
        for b in episode.header.bodies
    )
    return changed(episode, bodies, episode.tracks)


def with_an_unseen_link(episode: Episode) -> Episode:
    """One more link, of which only poses and a mass are known: those of the first finger."""
    finger = next(b.name for b in episode.header.bodies if b.kind == "gripper")
    link = Body(name="link", kind="robot", mass=1.0)
    tracks = {**episode.tracks, "link": episode.tracks[finger]}
    return changed(episode, (*episode.header.bodies, link), tracks)


def changed(episode: Episode, bodies: tuple[Body, ...], tracks) -> Episode:
    header = episode.header.model_copy(update={"bodies": bodies})
    return Episode(
        header, episode.t, tracks, episode.contacts, episode.frames, meshes=episode.meshes
    )


@pytest.mark.parametrize("less", [without_masses, with_an_unseen_link])
@pytest.mark.parametrize("rule", EXAMPLES)
def test_what_is_left_out_opens_verdicts_and_turns_none(rule: str, less) -> None:
    loaded = load_rules([rule[:3].lower()])
    open_ = []
    for name, expected in zip(EXAMPLES[rule], ("violation", "pass"), strict=True):
        episode = resolve(name, [builtin_folder() / "examples"])
        found = {v.rule: v.verdict for v in judge(less(episode), loaded).verdicts}[rule]
        assert found in (expected, "inconclusive"), name
        open_.append(found == "inconclusive")
    if less is with_an_unseen_link:  # it matters to what is asked of the whole robot's shape only
        assert open_ == [False, rule == "ETS104"]
    else:
        assert any(open_) == (rule in ("ISH101", "ISH201", "ETS103", "FSH101"))
