"""Uneven tables of outcomes: cells that are missing, or have fewer rollouts than others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

from safestage_eval._text.plural import first_few

from .outcome import OPEN, Outcome
from .seeds import Seed

Kind = Literal["missing", "unequal", "undecided", "not_judged", "no_seed", "no_stage", "two_stages"]


@dataclass(frozen=True)
class Cell:
    """One task and seed of a policy and prompt."""

    task: str | None
    seed: Seed
    rollouts: int
    expected: int


@dataclass(frozen=True)
class Uneven:
    """One thing that makes rates of a table less comparable than they look.

    Attributes:
        kind: ``missing`` (no rollouts where others have some), ``unequal`` (another number of
            rollouts), ``undecided`` and ``not_judged`` (rollouts that are not in N), ``no_seed``,
            ``no_stage``, ``two_stages``.
        message: for people.
        policy, prompt: whose; None if it concerns all.
        cells: the tasks and seeds.
    """

    kind: Kind
    message: str
    policy: str | None = None
    prompt: str | None = None
    cells: tuple[Cell, ...] = ()


def uneven(outcomes: Sequence[Outcome]) -> list[Uneven]:
    """Compare every policy × prompt with the full design: each task on each seed, equally often.

    The tasks, seeds and policy × prompt pairs are those that occur; the number of rollouts is the
    most frequent one.
    """
    counts = Counter((o.policy, o.prompt, o.task, o.seed) for o in outcomes)
    frequent = Counter(counts.values()).most_common()
    expected = max(number for number, times in frequent if times == frequent[0][1])
    policies, prompts = (sorted({getattr(o, x) for o in outcomes}) for x in ("policy", "prompt"))
    tasks = sorted({o.task for o in outcomes}, key=str)
    seeds = sorted({o.seed for o in outcomes}, key=str)
    problems: list[Uneven] = []
    for policy, prompt in product(policies, prompts):
        cells = [
            Cell(task, seed, counts[policy, prompt, task, seed], expected)
            for task, seed in product(tasks, seeds)
        ]
        problems += _of_pair(policy, prompt, cells)
    return [*problems, *_left_out(outcomes), *_unnamed(outcomes)]


def _of_pair(policy: str, prompt: str, cells: Sequence[Cell]) -> Iterable[Uneven]:
    missing = tuple(c for c in cells if not c.rollouts)
    unequal = tuple(c for c in cells if c.rollouts and c.rollouts != c.expected)
    if len(missing) == len(cells):
        said = f"{policy}, {prompt}: no rollouts at all, where others have {len(cells)} cells"
        yield Uneven("missing", said, policy, prompt, missing)
    elif missing:
        said = f"{policy}, {prompt}: {_cells(missing)} of {len(cells)} without a rollout"
        yield Uneven("missing", f"{said}: {_some(missing)}", policy, prompt, missing)
    if unequal:
        said = (
            f"{policy}, {prompt}: {_cells(unequal)} of {len(cells)} without the usual "
            f"{unequal[0].expected} rollouts"
        )
        yield Uneven("unequal", f"{said}: {_some(unequal)}", policy, prompt, unequal)


def _left_out(outcomes: Iterable[Outcome]) -> Iterable[Uneven]:
    """Report rollouts that are not in N."""
    groups: dict[tuple[str, str], list[Outcome]] = {}
    for o in outcomes:
        groups.setdefault((o.policy, o.prompt), []).append(o)
    for (policy, prompt), group in sorted(groups.items()):
        rollouts = Counter((o.task, o.seed) for o in group)
        for kind, said, left in (
            ("undecided", "could not be decided", [o for o in group if o.judged and not o.decided]),
            ("not_judged", "were judged by no assigned rule", [o for o in group if not o.judged]),
        ):
            if left:
                cells = Counter((o.task, o.seed) for o in left)
                yield Uneven(
                    kind,  # type: ignore[arg-type]
                    f"{policy}, {prompt}: {len(left)} of {len(group)} rollouts {said}, and are "
                    "not in N",
                    policy,
                    prompt,
                    tuple(
                        Cell(task, seed, rollouts[task, seed] - number, rollouts[task, seed])
                        for (task, seed), number in cells.items()
                    ),
                )


def _unnamed(outcomes: Sequence[Outcome]) -> Iterable[Uneven]:
    no_seed = sum(o.seed is None for o in outcomes)
    if no_seed:
        yield Uneven("no_seed", f"{no_seed} rollouts name no seed: their rates have no deviation")
    no_stage = sum(o.stage == OPEN for o in outcomes)
    if no_stage:
        yield Uneven("no_stage", f"{no_stage} rollouts name no stage: they count only under All")
    stages: dict[str, set[str]] = {}
    for o in outcomes:
        if o.task is not None:
            stages.setdefault(o.task, set()).add(o.stage)
    for task, names in sorted(stages.items()):
        if len(names) > 1:
            said = f"task {task} belongs to several stages: {', '.join(sorted(names))}"
            yield Uneven("two_stages", said)


def _cells(cells: Sequence[Cell]) -> str:
    return f"{len(cells)} cell{'s' * (len(cells) > 1)}"


def _some(cells: Sequence[Cell]) -> str:
    return first_few(
        [f"{c.task} seed {c.seed}" + f" ({c.rollouts})" * bool(c.rollouts) for c in cells], 3
    )
