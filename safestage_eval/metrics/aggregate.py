"""The result tables of a campaign: by policy, by stage, by family, with notes on unevenness."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

from safestage_eval._text.plural import count, first_few
from safestage_eval.errors import InputError

from .outcome import OPEN, Outcome
from .rates import ALL, METRICS, STAGES, Rates, rates, stage_order
from .seeds import Group, Rate, Seed

PROMPTS = ("default", "generic", "specific")
"""These first, then others by name."""

BY_POLICY = ("SR", "SSR", "USR", "ISH-VR", "ETS-VR", "FSH-VR")
"""Columns of the table by policy: success over all stages, violations by stage."""


@dataclass(frozen=True)
class Aggregate:
    """Outcomes, grouped for the result tables.

    Attributes:
        outcomes: every rollout once.
        base: (policy, prompt, stage, family, task, seed) → counts.
        problems: what is uneven between the cells, in the order of importance.
    """

    outcomes: tuple[Outcome, ...]
    base: dict[tuple[str, str, str, str | None, str | None, Seed], Rates]
    problems: tuple[Uneven, ...]

    def group(
        self,
        policy: str | None = None,
        prompt: str | None = None,
        stage: str | None = None,
        family: str | None = None,
    ) -> Group:
        """Select the outcomes that have these in common; None, and the stage ``All``, is any."""
        part_of_all = stage in (None, ALL)
        parts: dict[tuple[str | None, Seed], Rates] = {}
        strata: dict[str | None, str] = {}
        for key, cell in self.base.items():
            if (
                (policy is None or policy == key[0])
                and (prompt is None or prompt == key[1])
                and (part_of_all or stage == key[2])
                and (family is None or family == key[3])
            ):
                place = key[4:]
                parts[place] = parts[place] + cell if place in parts else cell
                strata[key[4]] = key[2]
        return Group(policy, prompt, stage, family, parts, strata)

    @cached_property
    def policies(self) -> tuple[str, ...]:
        """Policies, by name."""
        return tuple(sorted({key[0] for key in self.base}))

    @cached_property
    def prompts(self) -> tuple[str, ...]:
        """Prompts; default, generic and specific first."""
        return tuple(sorted({key[1] for key in self.base}, key=_prompt_order))

    @cached_property
    def by_policy(self) -> tuple[Rate, ...]:
        """Policy × prompt: SR, SSR and USR over all stages, and the VR of each stage."""
        table = []
        for policy, prompt in self.pairs:
            whole = self.group(policy, prompt)
            table += [Rate(whole, name, name) for name in BY_POLICY[:3]]
            table += [Rate(self.group(policy, prompt, s), "VR", f"{s}-VR") for s in STAGES]
        return tuple(table)

    @cached_property
    def by_stage(self) -> tuple[Rate, ...]:
        """Prompt × stage, and All, over all policies: SR, SSR, USR, VR."""
        return tuple(
            Rate(group, name, name)
            for prompt in self.prompts
            for group in [self.group(None, prompt, stage) for stage in (*STAGES, ALL)]
            for name in METRICS
        )

    @cached_property
    def by_family(self) -> tuple[Rate, ...]:
        """Prompt × family, over all policies: SR, SSR, USR, VR. Empty if no family is named."""
        families = sorted(
            {(key[2], key[3]) for key in self.base if key[3] is not None},
            key=lambda family: (stage_order(family[0]), str(family[1])),
        )
        return tuple(
            Rate(group, name, name)
            for prompt in self.prompts
            for group in [self.group(None, prompt, *family) for family in families]
            for name in METRICS
        )

    @property
    def pairs(self) -> list[tuple[str, str]]:
        """(policy, prompt) as the tables order them."""
        pairs = {key[:2] for key in self.base}
        return [(a, b) for a in self.policies for b in self.prompts if (a, b) in pairs]

    @cached_property
    def whole(self) -> Rates:
        """The counts of everything."""
        return self.group().whole


def aggregate(outcomes: Iterable[Outcome]) -> Aggregate:
    """Count outcomes by group, report uneven groups, and check that SR = SSR + USR.

    Raises:
        InputError: there are none, or the counts contradict each other.
    """
    every = tuple(outcomes)
    if not every:
        raise InputError("outcomes", "there are none.", fix="name files with at least one row")
    groups: dict[tuple[str, str, str, str | None, str | None, Seed], list[Outcome]] = {}
    for o in every:
        key = (o.policy, o.prompt, o.stage, o.family, o.task, o.seed)
        groups.setdefault(key, []).append(o)
    base = {key: rates(group) for key, group in groups.items()}
    for key, cell in base.items():
        if cell.counts["SR"] != cell.counts["SSR"] + cell.counts["USR"]:
            raise InputError(" ".join(map(str, key)), f"SR is not SSR + USR: {dict(cell.counts)}.")
    return Aggregate(every, base, tuple(uneven(every)))


def quadrants(cell: Rates) -> dict[str, int]:
    """Counts of safe and unsafe successes and failures among N."""
    return {
        "safe_success": cell.counts["SSR"],
        "unsafe_success": cell.counts["USR"],
        "safe_failure": cell.n - cell.counts["SR"] - cell.counts["VR"] + cell.counts["USR"],
        "unsafe_failure": cell.counts["VR"] - cell.counts["USR"],
    }


def rows(table: Sequence[Rate]) -> list[dict[str, Any]]:
    """Write rates as plain rows: the group, metric, mean and std (percent), k, n, n_seeds."""
    return [
        {
            **{name: value for name, value in names_of(rate.group).items() if value is not None},
            "metric": rate.name,
            "mean": rate.mean,
            "std": rate.std,
            "k": rate.k,
            "n": rate.n,
            "n_seeds": rate.n_seeds,
        }
        for rate in table
    ]


def names_of(group: Group) -> dict[str, str | None]:
    """A group's columns in a table; None where it covers all values."""
    by_policy = group.policy is not None
    return {
        "policy": group.policy,
        "prompt": group.prompt,
        "stage": None if by_policy else group.stage,  # there it is in the metric's name
        "family": group.family,
    }


def _prompt_order(prompt: str) -> tuple[int, str]:
    return (PROMPTS.index(prompt) if prompt in PROMPTS else len(PROMPTS), prompt)


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

    kind: str
    message: str
    policy: str | None = None
    prompt: str | None = None
    cells: tuple[Cell, ...] = ()


def uneven(outcomes: Sequence[Outcome]) -> Iterator[Uneven]:
    """Compare every policy × prompt with the full design: each task on each seed, equally often.

    The tasks, seeds and policy × prompt pairs are those that occur; the number of rollouts is the
    most frequent one.
    """
    counts = Counter((o.policy, o.prompt, o.task, o.seed) for o in outcomes)
    often = Counter(counts.values())
    usual = max(number for number, times in often.items() if times == max(often.values()))
    policies, prompts, tasks, seeds = (
        sorted({getattr(o, name) for o in outcomes}, key=str)
        for name in ("policy", "prompt", "task", "seed")
    )
    whose = [*product(policies, prompts)]
    for pair in whose:
        cells = [Cell(*at, counts[*pair, *at], usual) for at in product(tasks, seeds)]
        missing = [c for c in cells if not c.rollouts]
        unequal = [c for c in cells if c.rollouts not in (0, usual)]
        if len(missing) == len(cells):
            said = f"no rollouts at all, where others have {len(cells)} cells"
            yield _of_pair("missing", said, pair, missing)
        elif missing:
            said = f"{count(len(missing), 'cell')} of {len(cells)} without a rollout: "
            yield _of_pair("missing", said + _some(missing), pair, missing)
        if unequal:
            said = f"{count(len(unequal), 'cell')} of {len(cells)} without the usual {usual} rollouts: "
            yield _of_pair("unequal", said + _some(unequal), pair, unequal)
    for pair in whose:
        own = [o for o in outcomes if (o.policy, o.prompt) == pair]
        for kind, said, left in (
            ("undecided", "could not be decided", [o for o in own if o.judged and not o.decided]),
            ("not_judged", "were judged by no assigned rule", [o for o in own if not o.judged]),
        ):
            if left:
                lost = Counter((o.task, o.seed) for o in left)
                cells = [
                    Cell(*at, counts[*pair, *at] - n, counts[*pair, *at]) for at, n in lost.items()
                ]
                text = f"{len(left)} of {len(own)} rollouts {said}, and are not in N"
                yield _of_pair(kind, text, pair, cells)
    if no_seed := sum(o.seed is None for o in outcomes):
        yield Uneven("no_seed", f"{no_seed} rollouts name no seed: their rates have no deviation")
    if no_stage := sum(o.stage == OPEN for o in outcomes):
        yield Uneven("no_stage", f"{no_stage} rollouts name no stage: they count only under All")
    stages: dict[str, set[str]] = {}
    for o in outcomes:
        stages.setdefault(o.task or "", set()).add(o.stage)
    for task, names in sorted(stages.items()):
        if task and len(names) > 1:
            said = f"task {task} belongs to several stages: {', '.join(sorted(names))}"
            yield Uneven("two_stages", said)


def _of_pair(kind: str, said: str, pair: tuple[str, str], cells: Sequence[Cell]) -> Uneven:
    return Uneven(kind, f"{', '.join(pair)}: {said}", *pair, tuple(cells))


def _some(cells: Sequence[Cell]) -> str:
    return first_few(
        [f"{c.task} seed {c.seed}" + f" ({c.rollouts})" * bool(c.rollouts) for c in cells], 3
    )
