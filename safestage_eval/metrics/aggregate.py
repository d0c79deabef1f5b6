"""The result tables of a campaign: by policy, by stage, by family, with notes on unevenness."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from safestage_eval.errors import InputError

from .evenness import Uneven, uneven
from .outcome import Outcome
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
