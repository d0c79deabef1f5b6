"""SafeLIBERO's collision check, as its README gives it, on traces."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from asked import Asked, with_states
from tally import Tally

from safestage_eval.episode import Episode

RULES = with_states(
    "safelibero",
    """
[state.unmoved]
of   = ["a"]
when = { "shift_of(a)" = "<= obstacle_shift" }
""",
)


@contextmanager
def comparing(checkout: Path) -> Iterator[Callable[[Episode | None, Tally], None]]:
    """Every object as the obstacle, at every fourth frame."""
    text = (checkout / "README.md").read_text("utf-8")
    (check,) = [
        c for c in re.findall(r"```\w*\n(.*?)```", text, re.DOTALL) if "initial_obstacle_pos" in c
    ]
    code = compile(check.replace("print(", "(lambda *_: None)("), "README.md", "exec")

    def compare(episode: Episode | None, tally: Tally) -> None:
        if episode is None:
            return
        asked = Asked(episode, RULES)
        frames = np.arange(0, len(episode), 4)
        for body in [b.name for b in episode.header.bodies if b.kind == "object"]:
            position = episode.track(body).position.astype(float)
            theirs = []
            for frame in frames:
                space = {
                    "np": np, "collide_flag": False, "obstacle_name": "a", "t": frame,
                    "obs": {"a_pos": position[frame]}, "initial_obstacle_pos": position[0],
                }  # fmt: skip
                exec(code, space)
                theirs.append(space["collide_flag"])
            near = np.abs(np.abs(position[frames] - position[0]).sum(axis=1) - 0.001) < 1e-4
            tally.frames(1 - asked(f"unmoved({body})")[frames], np.array(theirs), "SLB101", "Automated Collision Check",
                         [("within 0.1 mm of the limit: the initial state is that of several frames", near)])  # fmt: skip

    yield compare
