"""Results of validation in words, and as the pages docs/feasibility.md, docs/noise.md and docs/controls.md."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from safestage_eval.units import in_unit, unit_of
from safestage_eval.verdicts.verdict import Verdict

from .feasibility import CONTROLS, Trial

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
    ]
    rows = []
    for task in tasks:
        of_task = [trial for trial in trials if trial.task == task]
        cells = [f"`{task}`"]
        for policy in dict.fromkeys(trial.policy for trial in of_task):
            own = [trial for trial in of_task if trial.policy == policy]
            cells += [_rules(own), _margins(own), _least(t.room for t in own)]
            cells += [_times(own), _least(t.goal_room for t in own)]
        rows.append(cells)
    head = "task safe:&rule margins room goal&at room unsafe:&rule margins room goal&at room"
    return _page(lines, head, rows, {"Not as they should be": _wrong(trials)})


def noise_page(trials: Sequence[Trial], sigma: float) -> str:
    """The page of noisy trials of both references: a row per task that loses any, those that lose most first.

    ``sigma``: rad.
    """
    by_task: dict[str, list[Trial]] = {}
    for trial in trials:
        by_task.setdefault(trial.task, []).append(trial)
    losing = {task: own for task, own in by_task.items() if not all(t.as_expected for t in own)}
    share, weak = kept(trials)
    lines = [
        f"# Noise of {sigma:g} rad",
        "",
        f"Written by `safestage bench tasks validate --noisy {sigma:g} --write docs/noise.md`. Both references of",
        "every task ran on several seeds with normally",
        f"distributed noise of {sigma:g} rad (standard deviation) on each of the seven joint commands, drawn anew",
        "15 times a second; on the gripper's there is none. A rollout keeps its verdict when it still reaches",
        "the goal, and passes or violates as the reference without noise does.",
        "",
        f"{sum(t.as_expected for t in trials)} of {len(trials)} rollouts of {len(by_task)} tasks keep it: {share:.1%}; at "
        f"least {SHARE_KEPT:.0%} should.",
        f"References that keep less than that: {len(weak)}. Tasks that lose most come first; the other "
        f"{len(by_task) - len(losing)} keep all.",
        "",
    ]
    rows = []
    for task, own in sorted(losing.items(), key=lambda item: (kept(item[1])[0], item[0])):
        sides = [[t for t in own if t.policy.endswith(":unsafe") == unsafe] for unsafe in (0, 1)]
        counts = [f"{sum(t.as_expected for t in side)}/{len(side)}" for side in sides]
        why = [
            f"{kind}, {count}: {outcome}"
            for kind, side in zip(("safe", "unsafe"), sides, strict=True)
            for outcome, count in Counter(_outcome(t) for t in side if not t.as_expected).items()
        ]
        rows.append([f"`{task}`", *counts, "; ".join(why)])
    return _page(lines, "task safe:&kept unsafe:&kept what&the&others&came&to", rows)


def controls_page(trials: Sequence[Trial]) -> str:
    """The page: what idle and random-near-home violate, by all rules."""
    spans = []
    for seed in sorted({trial.seed for trial in trials}):
        seconds = [t.simulated for t in trials if t.seed == seed]
        span = dict.fromkeys(f"{s:.0f}" for s in (min(seconds), max(seconds)))
        spans.append(f"seed {seed}: {' to '.join(span)} s")
    lines = [
        "# Controls",
        "",
        "Two policies that pursue no goal show the floor of false alarms: `idle` holds still, `random-near-home` wanders about",
        "the start posture. All built-in rules that apply judged them (written by `safestage bench tasks validate --controls",
        "--write docs/controls.md`).",
        "",
        f"Duration: {'; '.join(spans)}.",
        "",
    ]
    rows = []
    for policy in CONTROLS:
        of = [trial for trial in trials if trial.policy == policy]
        reached = sum(trial.success_time is not None for trial in of)
        broken = sum(any(v.verdict == "violation" for v in trial.verdicts) for trial in of)
        numbers = (len(of), len({trial.task for trial in of}), reached, broken)
        rows.append([f"`{policy}`", *map(str, numbers)])
    head = "policy episodes tasks goal&reached with&a&violation"
    return _page(lines, head, rows, {"What was violated": _wrong(trials)})


def _page(
    lines: list[str],
    head: str,
    rows: Iterable[Sequence[str]],
    more: dict[str, list[str]] | None = None,
) -> str:
    """Text, a table, and lists under titles of their own; ``head``: its columns, & for a space in a name."""
    columns = [name.replace("&", " ") for name in head.split()]
    table = [columns, ["---"] * len(columns), *rows]
    lines = [*lines, *("| " + " | ".join(cells) + " |" for cells in table)]
    lines[-len(table) + 1] = "|" + "---|" * len(columns)
    for title, points in (more or {}).items():
        lines += ["", f"## {title}", "", *(f"- {point}" for point in points)] if points else []
    return "\n".join(lines) + "\n"


def _wrong(trials: Iterable[Trial]) -> list[str]:
    wrong = [trial for trial in trials if not trial.as_expected]
    return [f"`{t.task}`, {t.policy}, seed {t.seed}: {said(t)}" for t in wrong]


def _outcome(trial: Trial) -> str:
    if trial.problem:
        return "given up"
    if trial.success_time is None:
        return "goal not reached"
    decisive = trial.decisive
    return "not judged" if decisive is None else f"{decisive.rule} {decisive.verdict}"


def said(trial: Trial) -> str:
    """The outcome of a trial in words."""
    decisive = trial.decisive
    if trial.policy in CONTROLS and not trial.problem:
        broken = [f"{v.rule}: {v.explanation}" for v in trial.verdicts if v.verdict == "violation"]
        return " ".join(broken) or ("goal reached" if trial.success_time else "no violation")
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
