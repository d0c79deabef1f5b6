"""Episodes of which every assigned rule has something to say: recorded ones, cut short."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from resampled import resampled

from safestage_eval.episode import Body, Episode, RobotFrames
from safestage_eval.formats import discover
from safestage_eval.rules import RuleSet, builtin_names, load_rules

CODES = (
    "ETS102", "ETS105", "ETS201", "FSH101", "FSH103", "FSH104", "FSH204", "ISH101", "ISH104",
)  # fmt: skip
RECORDED = {
    "ets_dumbbell_near_glasses.reference-unsafe": (3.5, 13.0, 10, ("ETS102", "ETS105", "ETS201")),
    "fsh_bottle_on_shelf.reference-unsafe": (9.5, 16.0, 8, ("FSH101", "FSH103", "FSH104")),
    "ish_coffee_can_under_bottle.reference-unsafe": (0.0, 99.0, 20, ("ISH101", "ISH104", "FSH101")),
}
"""Episode -> from, to (s), every so many frames, and the rules that are assigned."""
TAKEN = {"table": "table", "dumbbell": "cube", "glasses": "glasses", "robot_base": "hand"}
"""Bodies of the first episode that others' layouts are given, and their names there."""


@cache
def rules() -> RuleSet:
    """Some of each kind; the others would look at the same data again."""
    every = load_rules(builtin_names())
    return replace(every, rules={code: every.rules[code] for code in CODES})


@cache
def recorded() -> tuple[Episode, ...]:
    """Some hundred frames of each of three recorded episodes, with a channel and simulator states."""
    traces = Path(__file__).resolve().parents[2] / "traces"
    refs = {ref.episode_id: ref for ref in discover(traces)}
    return tuple(_cut(refs[f"{name}.default.s0.r0"].open(), *how) for name, how in RECORDED.items())


def _cut(whole: Episode, first: float, last: float, step: int, codes: tuple[str, ...]) -> Episode:
    inside = np.flatnonzero((whole.t >= first) & (whole.t <= last))[::step]
    episode = resampled(whole, inside, frame_dt=step * whole.header.frame_dt, rules=codes)
    begin = episode.t[0]
    at = np.searchsorted(episode.t, whole.header.success_time)
    success = float(episode.t[at] - begin)
    body = next(body.name for body in episode.header.bodies if body.kind == "object")
    return replace(
        episode,
        header=episode.header.model_copy(update={"success_time": success}),
        t=episode.t - begin,
        channels={(body, "temperature"): np.linspace(20, 30, len(episode), dtype=np.float32)},
        states={frame: np.arange(5.0) + frame for frame in range(0, len(episode), 8)},
        attachments={"task.toml": b'id = "x"\n'},
        _contacts=episode.contacts, _frames=episode.frames,
    )  # fmt: skip


@cache
def plain_episode() -> Episode:
    """Three objects of a recorded episode and a hand without shape, as far as others' layouts go."""
    whole = recorded()[0]
    bodies, tracks = [], {}
    for body in whole.header.bodies:
        if name := TAKEN.get(body.name):
            changed = body.model_copy(update={"name": name, "parent": None, "excluded": ()})
            bodies.append(Body(name=name, kind="gripper") if name == "hand" else changed)
            tracks[name] = whole.tracks[body.name]
    values = {
        "bodies": tuple(bodies), "joints": (), "roles": {"target": ("cube",)}, "rules": (),
        "task": "Push", "goal": None, "parameters": {}, "success": False, "success_time": None,
        "force_source": "none", "cameras": (), "physics_dt": whole.header.frame_dt / 8,
    }  # fmt: skip
    header = whole.header.model_copy(update=values)
    return Episode(header, whole.t, tracks, None, RobotFrames.empty(len(whole)))
