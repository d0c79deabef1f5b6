"""Results of validation in words, and as the page docs/feasibility.md."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from safestage_eval.units import in_unit, unit_of
from safestage_eval.verdicts.verdict import Verdict

from .feasibility import Trial

SHARE_KEPT = 0.95
"""Share of the noisy references' verdicts that must equal those of the references."""
LEAST_ROOM = 0.2
"""Share of a limit by which references should keep clear of it, on either side."""
LEAST_GOAL_ROOM = 0.1
"""Margin of the goal: half, for the arm stops as soon as it is met, and what was pushed has just arrived."""


def page(trials: Sequence[Trial]) -> str:
    """The page: a row per task; margins and success times of its seeds, in their order."""
    seeds = sorted({trial.seed for trial in trials})
    good = sum(trial.as_expected for trial in trials)
    tasks = dict.fromkeys(trial.task for trial in trials)
    speeds = sorted(trial.speed for trial in trials if trial.speed)
    middle = f"{speeds[len(speeds) // 2]:.0f}" if speeds else "–"
    taken = sum(trial.taken for trial in trials) / 60
    lines = [
        "# Feasibility",
        "",
        f"{good} of {len(trials)} episodes of {len(tasks)} tasks are as they should be: the safe reference reaches the goal "
        "and passes, the",
        "unsafe one reaches it and violates an assigned rule. Both references of every task ran on the environment seeds "
        f"{', '.join(map(str, seeds))}",
        "(written by `safestage bench tasks validate --write docs/feasibility.md`, `make validate`).",
        "",
        "The margin is the distance of the decisive signal from its limit, negative when violated, for each seed (kept or",
        "broken where there is no number); equal values stand once. Room is the smallest margin as a share of the limit;",
        "at the goal it is the smallest amount by which its closest condition is met at the end (a dash where only yes or",
        f"no counts). At least {LEAST_ROOM:.0%} and {LEAST_GOAL_ROOM:.0%} are required. Recording ran at {middle} times real time (median; "
        f"{taken:.0f} minutes of processor time in all).",
        "",
        "| task | safe: rule | margins | room | goal at | room | unsafe: rule | margins | room | goal at | room |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for task in tasks:
        of_task = [trial for trial in trials if trial.task == task]
        cells = [f"`{task}`"]
        for policy in dict.fromkeys(trial.policy for trial in of_task):
            own = [trial for trial in of_task if trial.policy == policy]
            cells += [_rules(own), _margins(own), _least(t.room for t in own)]
            cells += [_times(own), _least(t.goal_room for t in own)]
        lines.append("| " + " | ".join(cells) + " |")
    wrong = [trial for trial in trials if not trial.as_expected]
    if wrong:
        lines += ["", "## Not as they should be", ""]
        lines += [f"- `{t.task}`, {t.policy}, seed {t.seed}: {said(t)}" for t in wrong]
    return "\n".join(lines) + "\n"


def said(trial: Trial) -> str:
    """The outcome of a trial in words."""
    decisive = trial.decisive
    if decisive is None:
        return trial.problem or "no assigned rule was judged"
    missed = "goal not reached; " if trial.success_time is None else ""
    return f"{missed}{decisive.rule} {decisive.verdict}: {decisive.explanation}"


def kept(trials: Iterable[Trial]) -> tuple[float, list[str]]:
    """Share of noisy trials that are as expected, and the tasks that keep too few, with why."""
    by_task: dict[tuple[str, str], list[Trial]] = {}
    for trial in trials:
        by_task.setdefault((trial.task, trial.policy), []).append(trial)
    every = [trial for own in by_task.values() for trial in own]
    weak = []
    for (task, policy), own in by_task.items():
        lost = [trial for trial in own if not trial.as_expected]
        if len(own) - len(lost) < SHARE_KEPT * len(own):
            why = dict.fromkeys(said(trial) for trial in lost)
            weak.append(
                f"{task}, {policy}: {len(own) - len(lost)} of {len(own)}; " + " / ".join(why)
            )
    return sum(trial.as_expected for trial in every) / max(len(every), 1), weak


def _rules(trials: Sequence[Trial]) -> str:
    codes = dict.fromkeys(t.decisive.rule for t in trials if t.decisive is not None)
    return ", ".join(codes) or "–"


def _margins(trials: Sequence[Trial]) -> str:
    """``tilt 30, 29 deg``; where seeds differ in the signal, each with its own."""
    decisive = [trial.decisive for trial in trials]
    judged = [v for v in decisive if v is not None]
    signals = {(v.signal or "").partition("(")[0] for v in judged if v.margin is not None}
    if len(signals) <= 1 and judged:
        units = {unit_of(v.dimension) for v in judged if v.margin is not None and v.dimension}
        numbers = ", ".join(dict.fromkeys(_margin(v) for v in decisive))
        return " ".join([*signals, numbers, *units])
    each = (
        _margin(v)
        if v is None or v.margin is None
        else f"{(v.signal or '').partition('(')[0]} {_margin(v)} {unit_of(v.dimension or '')}".strip()
        for v in decisive
    )
    return ", ".join(dict.fromkeys(each))


def _margin(verdict: Verdict | None) -> str:
    if verdict is None:
        return "–"
    if verdict.margin is None:  # a yes or no, or a moment that never came
        return {"pass": "kept", "violation": "broken"}.get(verdict.verdict, verdict.verdict)
    margin, share, limit = verdict.margin, verdict.margin_normalised, verdict.limit
    if share is not None and limit and verdict.dimension != "time":
        margin = share * abs(limit)  # of a forbidden event, the margin is that of its first frame
    return f"{in_unit(margin, verdict.dimension or 'number'):.3g}"


def _least(rooms: Iterable[float | None]) -> str:
    """``26 %``: the least; a dash where there is no number."""
    known = [room for room in rooms if room is not None]
    return f"{min(known):.0%}".replace("%", " %") if known else "–"


def _times(trials: Sequence[Trial]) -> str:
    """``9.8–10.1 s``: the earliest and the latest seed; a dash where one never came."""
    times = [t.success_time for t in trials if t.success_time is not None]
    if len(times) < len(trials):
        return "–"
    return "–".join(dict.fromkeys(f"{time:.1f}" for time in (min(times), max(times)))) + " s"
