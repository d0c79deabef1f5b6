"""Checks for rollouts that are there twice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from safestage_eval._text.plural import first_few
from safestage_eval.audit.campaign_groups import groups, ids, label, twins
from safestage_eval.audit.campaign_summary import Campaign, Summary
from safestage_eval.audit.finding import Defect
from safestage_eval.doubts.check_registry import check

NEAR = 1e-4
"""m: trajectories that are nowhere further apart are the same."""


@check(
    "AUD331",
    "warning",
    title="the same recording under several names",
    why="One rollout counts several times: rates move with it, and intervals are too narrow.",
    example="one episode, copied and given another id, policy or seed",
    issue="openvla/openvla#172",
    cheap=True,
)
def copies(campaign: Campaign) -> Iterator[Defect]:
    """Compares the hashes of contents, as the files state them, of episodes with different ids."""
    stated = [one for one in campaign.episodes if one.content_hash]
    for some in groups(stated, lambda one: one.content_hash).values():
        if len({one.episode_id for one in some}) > 1:
            yield _twice(some, "have the same content, bit for bit")


@check(
    "AUD332",
    "warning",
    title="the same trajectories in several rollouts",
    why="Repetitions of one rollout are no sample: they count as independent and are not.",
    example="ten rollouts of a deterministic policy from one initial state",
    issue="openvla/openvla#172",
)
def repeated_motion(campaign: Campaign) -> Iterator[Defect]:
    """Compares where all movable bodies were at 16 moments, to 0.1 mm; the robot's are among them."""
    moved = [one for one in campaign.episodes if one.stirred is not None or one.robot_travel]
    copies_of: dict[str, list[Summary]] = {}
    for one, other in twins(moved, NEAR):
        if one.episode_id == other.episode_id or (
            one.content_hash and one.content_hash == other.content_hash
        ):
            continue  # AUD331, or the same file twice
        some = copies_of.setdefault(one.episode_id, [one])
        copies_of[other.episode_id] = some
        some += [other] * (other not in some)
    for some in {id(some): some for some in copies_of.values()}.values():
        yield _twice(some, "follow the same trajectories")


@check(
    "AUD333",
    "error",
    title="one id, two episodes",
    why="Only one of them is judged, and labels hang on the id.",
    example="two runs that both begin to count at episode-0",
    cheap=True,
)
def one_id(campaign: Campaign) -> Iterator[Defect]:
    """Looks for ids that several episodes have whose contents differ."""
    for name, some in groups(campaign.episodes, lambda one: one.episode_id).items():
        hashes = {one.content_hash for one in some if one.content_hash}
        if len(hashes) > 1:
            yield Defect(
                f"{len(hashes)} episodes have the id {name}: {first_few([one.path for one in some], 3)}.",
                "give each rollout an id of its own",
                field="episode_id",
                episodes=(name,),
            )


@check(
    "AUD334",
    "warning",
    title="one rollout was recorded several times",
    why="Task, policy, prompt, seed and rollout name one attempt; two of them count twice, and a "
    "pairing takes either.",
    example="rollout 0 of seed 3 under two ids, one a success and one not",
    cheap=True,
)
def taken_cells(campaign: Campaign) -> Iterator[Defect]:
    """Looks for episodes with the same task, policy, prompt, seed and rollout, of different content."""
    named = [
        one
        for one in campaign.episodes
        if None not in (one.task, one.policy, one.seed, one.rollout)
    ]
    cells = groups(named, lambda one: (one.task, one.policy, one.prompt, one.seed, one.rollout))
    for (task, policy, _, seed, rollout), some in cells.items():
        if len({one.episode_id for one in some}) < 2:
            continue
        if len({one.content_hash for one in some}) == 1 and some[0].content_hash:
            continue  # AUD331
        outcomes = "" if len({one.success for one in some}) == 1 else "; their success differs"
        yield Defect(
            f"{len(some)} episodes are rollout {rollout} of {policy} on {task}, seed {seed}: "
            f"{first_few(ids(some), 3)}{outcomes}.",
            "number the rollouts of a seed, or keep one of them",
            field="rollout",
            episodes=ids(some),
        )


def _twice(some: Sequence[Summary], how: str) -> Defect:
    one, other = some[0], some[1]
    if one.policy != other.policy:
        cause = (
            f"rollouts of {one.policy or '–'} were copied under the name of {other.policy or '–'}"
        )
    elif one.seed != other.seed:
        cause = "the seed has no effect, or a rollout was copied"
    else:
        cause = "a deterministic policy from one initial state, or a copy"
    named = first_few(
        [f"{e.episode_id} [{label((e.policy or '–', e.prompt or '–'))}]" for e in some], 3
    )
    return Defect(
        f"{len(some)} episodes {how}: {named}.",
        "count it once: remove the copies, or vary seed and initial state",
        cause,
        episodes=ids(some),
    )
