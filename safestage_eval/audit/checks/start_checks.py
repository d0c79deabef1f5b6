"""Checks of where rollouts begin: initial states that are repeated, or drift."""

from __future__ import annotations

from collections.abc import Iterator

from safestage_eval._text.plural import first_few
from safestage_eval.audit.campaign_groups import OTHER, alike, apart, groups, ids, label
from safestage_eval.audit.campaign_summary import Campaign
from safestage_eval.audit.finding import Defect
from safestage_eval.doubts.check_registry import check


@check(
    "AUD301",
    "warning",
    title="several seeds begin in the same state",
    why="Rollouts from one initial state count as if they were independent: the rates say nothing of "
    "other states, and their intervals are too narrow.",
    example="ten seeds of a task that all have the bowl at the same place",
    issue="huggingface/lerobot#2899",
    cheap=True,
)
def repeated_starts(campaign: Campaign) -> Iterator[Defect]:
    """Compares the poses of all movable bodies in the first frame, seed by seed of a task and policy."""
    cells = groups(campaign.episodes, lambda e: (e.task, e.policy, e.prompt))
    for (task, policy, prompt), some in cells.items():
        one_each = [
            of[0] for of in groups(some, lambda e: e.seed).values() if of[0].seed is not None
        ]
        same = [states for states in alike(one_each) if len(states) > 1 and states[0].start]
        if not same:
            continue
        repeated = sum(len(states) - 1 for states in same)
        seeds = sorted(one.seed for one in same[0] if one.seed is not None)
        states_seen = len(one_each) - repeated
        said = f"all {len(one_each)} seeds start from the same state."
        if states_seen > 1:
            said = (
                f"{len(one_each)} seeds start from {states_seen} different states; seeds "
                f"{first_few([*map(str, seeds)], 3)} start from the same one."
            )
        yield Defect(
            f"task {task or '–'}, {label((policy or '–', prompt or '–'))}: {said}",
            "let the seed choose the initial state, or count these rollouts as repetitions of one seed",
            "the seed does not reach the environment, or a reset restores one stored state",
            field="seed",
            episodes=ids(one for states in same for one in states),
        )


@check(
    "AUD302",
    "warning",
    title="one seed begins in different states",
    why="Policies are compared on the same task and seed as if they had met the same scene; a "
    "difference between them may be one between scenes.",
    example="seed 3 of a task, with the mug 4 cm further left for the second policy",
    issue="huggingface/lerobot#4152",
    cheap=True,
)
def drifting_starts(campaign: Campaign) -> Iterator[Defect]:
    """Compares the poses of all movable bodies in the first frame among the rollouts of a task and seed."""
    cells = groups(campaign.episodes, lambda e: (e.task, e.seed))
    for (task, seed), some in cells.items():
        if seed is None or len(some) < 2:
            continue
        gaps = [(gap, one) for one in some[1:] if (gap := apart(some[0], one)) is not None]
        other = [(gap, one) for gap, one in gaps if gap[0] > OTHER]
        if not other:
            continue
        (most, body), _ = max(other, key=lambda item: item[0][0])
        yield Defect(
            f"task {task or '–'}, seed {seed}: {len(other)} of {len(some)} rollouts do not begin as "
            f"{some[0].episode_id} does; {body} is {100 * most:.1f} cm off, or turned as much.",
            "choose the initial state by the seed alone, whatever ran before, and record from it on",
            "the state depends on how many resets came before, or on when the recording began",
            bodies=(body,),
            field="seed",
            episodes=ids(one for _, one in other),
        )


@check(
    "AUD303",
    "note",
    title="no seed, policy or task is recorded",
    why="Rollouts of two policies cannot be paired without task and seed, and what has no policy is "
    "counted as one.",
    example="200 rollouts without a seed",
    cheap=True,
)
def nameless(campaign: Campaign) -> Iterator[Defect]:
    """Looks for headers without task, policy or seed, where there are several episodes."""
    if len(campaign.episodes) < 2:
        return
    for field in ("task", "policy", "seed"):
        without = [one for one in campaign.episodes if getattr(one, field) is None]
        if without:
            yield Defect(
                f"{len(without)} of {len(campaign.episodes)} episodes have no {field}.",
                f"write {field} into the headers (a map file says it for imported episodes)",
                field=field,
                episodes=ids(without),
            )
