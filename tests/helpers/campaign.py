"""Campaigns made up from a seed: every task on every seed, equally often."""

from __future__ import annotations

from itertools import product

import numpy as np
import pandas as pd

from safestage_eval.metrics import Outcome

TASKS = {"ISH": 4, "ETS": 5, "FSH": 3}
POLICIES, PROMPTS = ("act", "pi0"), ("default", "specific")


def campaign(
    seed: int = 0,
    *,
    seeds: int = 3,
    rollouts: int = 4,
    tasks: dict[str, int] | None = None,
    open_share: float = 0.0,
    spread: float = 0.2,
) -> list[Outcome]:
    """Outcomes whose rates differ by policy, prompt and task; some may be left undecided."""
    random = np.random.default_rng(seed)
    found = []
    for policy, prompt in product(POLICIES, PROMPTS):
        for stage, number in (tasks or TASKS).items():
            for task in range(number):
                p, q = np.clip(random.normal(0.5, spread, 2), 0, 1)
                for env, rollout in product(range(seeds), range(rollouts)):
                    s, v, lost = random.random(3)
                    found.append(
                        Outcome(
                            policy=policy,
                            prompt=prompt,
                            stage=stage,
                            success=bool(s < p),
                            violation=None if lost < open_share else bool(v < q),
                            judged=True,
                            task=f"{stage.lower()}_{task}",
                            family=f"{stage}-{task % 2}",
                            seed=env,
                            rollout=rollout,
                        )
                    )
    return found


def frame(outcomes: list[Outcome]) -> pd.DataFrame:
    """Return them as a table."""
    names = (
        "task", "stage", "family", "policy", "prompt", "seed", "rollout", "success", "violation",
    )  # fmt: skip
    return pd.DataFrame([[getattr(o, n) for n in names] for o in outcomes], columns=list(names))
