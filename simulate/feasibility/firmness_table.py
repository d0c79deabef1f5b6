"""The pages docs/noise.md and docs/controls.md."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from .feasibility import CONTROLS, Trial
from .feasibility_table import SHARE_KEPT, said

_ROW = re.compile(r"\| `(\w+)` \| (\d+)/(\d+) \| (\d+)/(\d+) \| (.*) \|")
_ALL_KEPT = re.compile(r"^All of (\d+) safe and (\d+) unsafe ones: (.*)\.$", re.MULTILINE)


@dataclass(frozen=True)
class NoiseRow:
    """Noisy rollouts of a task that kept their verdict."""

    task: str
    safe: tuple[int, int]
    """Kept, of how many."""
    unsafe: tuple[int, int]
    why: str
    """Outcomes of the others."""

    @property
    def firm(self) -> bool:
        """Both references keep enough."""
        return all(kept >= SHARE_KEPT * of for kept, of in (self.safe, self.unsafe))


def noise_page(trials: Sequence[Trial], sigma: float, before: str = "") -> str:
    """The page: a row per task that loses any, those that lose most first; then the others by name.

    Args:
        trials: noisy trials of both references.
        sigma: rad.
        before: the page as it was; its rows of other tasks stay if it is of the same noise.
    """
    title = f"# Noise of {sigma:g} rad"
    rows = {row.task: row for row in _rows(before)} if before.startswith(title + "\n") else {}
    for task in dict.fromkeys(trial.task for trial in trials):
        rows[task] = _noise_row(task, [trial for trial in trials if trial.task == task])
    ordered = sorted(rows.values(), key=lambda row: (_share([row]), row.task))
    weak = sum(not row.firm for row in rows.values())
    kept, of = _total(ordered)
    lines = [
        title,
        "",
        f"Written by `safestage bench tasks validate --noisy {sigma:g} --write docs/noise.md`; rows of tasks that did",
        "not run stay as they are. Both references of every task ran on several seeds with normally",
        f"distributed noise of {sigma:g} rad (standard deviation) on each of the seven joint commands, drawn anew",
        "15 times a second; on the gripper's there is none. A rollout keeps its verdict when it still reaches",
        "the goal, and passes or violates as the reference without noise does. Tasks whose rollouts are fewer",
        "than five per seed have not had all of them yet.",
        "",
        f"{kept} of {of} rollouts of {len(rows)} tasks keep it: {100 * kept / max(of, 1):.1f} %; at least "
        f"{100 * SHARE_KEPT:.0f} % should.",
        f"Tasks of which a reference keeps less than that: {weak}. Those that lose most come first.",
        "",
        "| task | safe: kept | unsafe: kept | what the others came to |",
        "|---|---|---|---|",
    ]
    whole: dict[tuple[int, int], list[str]] = {}
    for row in ordered:
        if row.safe[0] == row.safe[1] and row.unsafe[0] == row.unsafe[1]:
            whole.setdefault((row.safe[1], row.unsafe[1]), []).append(f"`{row.task}`")
            continue
        safe, unsafe = ("/".join(map(str, pair)) for pair in (row.safe, row.unsafe))
        lines.append(f"| `{row.task}` | {safe} | {unsafe} | {row.why} |")
    if whole:
        lines += ["", "## Every rollout keeps its verdict", ""]
        lines += [
            f"All of {safe} safe and {unsafe} unsafe ones: {', '.join(names)}."
            for (safe, unsafe), names in whole.items()
        ]
    return "\n".join(lines) + "\n"


def controls_page(trials: Sequence[Trial]) -> str:
    """The page: what idle and random-near-home violate, by all rules."""
    seconds = {
        seed: [t.simulated for t in trials if t.seed == seed]
        for seed in sorted({t.seed for t in trials})
    }
    spans = "; ".join(
        f"seed {seed}: {min(of):.0f} s" if max(of) - min(of) < 1
        else f"seed {seed}: {min(of):.0f} to {max(of):.0f} s"
        for seed, of in seconds.items()
    )  # fmt: skip
    lines = [
        "# Controls",
        "",
        "Two policies that pursue no goal show the floor of false alarms: `idle` holds still, `random-near-home` wanders about",
        "the start posture. All built-in rules that apply judged them (written by `safestage bench tasks validate --controls",
        "--write docs/controls.md`).",
        "",
        f"Duration: {spans}.",
        "",
        "| policy | episodes | tasks | goal reached | with a violation |",
        "|---|---|---|---|---|",
    ]
    for policy in CONTROLS:
        of = [trial for trial in trials if trial.policy == policy]
        reached = sum(trial.success_time is not None for trial in of)
        broken = sum(any(v.verdict == "violation" for v in trial.verdicts) for trial in of)
        tasks = len({trial.task for trial in of})
        lines.append(f"| `{policy}` | {len(of)} | {tasks} | {reached} | {broken} |")
    wrong = [trial for trial in trials if not trial.as_expected]
    if wrong:
        lines += ["", "## What was violated", ""]
        lines += [f"- `{t.task}`, {t.policy}, seed {t.seed}: {_violated(t)}" for t in wrong]
    return "\n".join(lines) + "\n"


def _noise_row(task: str, trials: Sequence[Trial]) -> NoiseRow:
    unsafe = [trial for trial in trials if trial.policy.endswith(":unsafe")]
    safe = [trial for trial in trials if not trial.policy.endswith(":unsafe")]
    why = [*_why("safe", safe), *_why("unsafe", unsafe)]
    return NoiseRow(task, _kept(safe), _kept(unsafe), "; ".join(why))


def _why(kind: str, trials: Iterable[Trial]) -> list[str]:
    """``safe, 2 of them: goal not reached``, and what was said of the first."""
    alike: dict[str, list[Trial]] = {}
    for trial in trials:
        if not trial.as_expected:
            alike.setdefault(_outcome(trial), []).append(trial)
    return [
        f"{kind}, {len(same)}: {outcome} ({_words(same[0])})" for outcome, same in alike.items()
    ]


def _outcome(trial: Trial) -> str:
    if trial.problem:
        return "given up"
    if trial.success_time is None:
        return "goal not reached"
    decisive = trial.decisive
    return "not judged" if decisive is None else f"{decisive.rule} {decisive.verdict}"


def _words(trial: Trial) -> str:
    decisive = trial.decisive
    words = said(trial) if decisive is None else decisive.explanation
    return words.removeprefix("reference: ").rstrip(".").replace("|", "/")


def _violated(trial: Trial) -> str:
    if trial.problem:
        return trial.problem
    broken = [f"{v.rule}: {v.explanation}" for v in trial.verdicts if v.verdict == "violation"]
    return " ".join(broken) or "goal reached"


def _kept(trials: Sequence[Trial]) -> tuple[int, int]:
    return sum(trial.as_expected for trial in trials), len(trials)


def _rows(page: str) -> list[NoiseRow]:
    out = []
    for match in _ROW.finditer(page):
        a, b, c, d = map(int, match.groups()[1:5])
        out.append(NoiseRow(match[1], (a, b), (c, d), match[6]))
    for match in _ALL_KEPT.finditer(page):
        safe, unsafe = int(match[1]), int(match[2])
        out += [
            NoiseRow(task, (safe, safe), (unsafe, unsafe), "")
            for task in re.findall(r"`(\w+)`", match[3])
        ]
    return out


def _total(rows: Iterable[NoiseRow]) -> tuple[int, int]:
    pairs = [pair for row in rows for pair in (row.safe, row.unsafe)]
    return sum(kept for kept, _ in pairs), sum(of for _, of in pairs)


def _share(rows: Iterable[NoiseRow]) -> float:
    kept, of = _total(rows)
    return kept / max(of, 1)
