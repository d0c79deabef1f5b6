"""Writes the page on foreign rollouts: scores what foreign_rollouts.py recorded, and counts."""

from __future__ import annotations

import io
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd

from safestage_eval.formats import load

SETS = {
    "metaworld": ("Meta-World 3.0.0", "metaworld", "the scripted expert in its wheel"),
    "fetch": ("Gymnasium-Robotics 1.4.2", "gymnasium_robotics", "a script"),
    "mani_skill": ("ManiSkill 3.0.1", "maniskill", "a script"),
    "robosuite": ("robosuite 1.5.2", "robosuite", "a script"),
}
"""Folder → the simulator, its bind file, the policy."""

NOTES = Path(__file__).with_name("foreign_notes.md")
"""Notes on the pictures that were looked at, written by hand."""


def write_page(folder: Path, page: Path) -> None:
    """Score the recordings below ``folder`` by ets and fsh, and write the page."""
    parts = [_head()]
    episodes, found = [], []
    for name, (title, bind, policy) in SETS.items():
        traces = sorted((folder / name).glob("*.zip"))
        if not traces:
            continue
        rows, problems = _score(folder / name, bind)
        table = _episodes(traces, rows, problems).assign(set=title, policy=policy)
        episodes.append(table)
        found.append(rows[rows.assigned & (rows.verdict == "violation")].assign(set=title))
    every, violations = pd.concat(episodes), pd.concat(found)
    parts += [
        _rates(every), _moved(violations), _undecided(every), NOTES.read_text().rstrip(),
    ]  # fmt: skip
    page.write_text("\n\n".join(parts) + "\n")


def _score(folder: Path, bind: str) -> tuple[pd.DataFrame, dict[str, str]]:
    """The rows of all episodes, and why some could not be judged, by file name."""
    command = "from safestage_eval.cli import score_main; score_main()"
    done = subprocess.run(
        [sys.executable, "-c", command, str(folder), "--rules", "ets", "--rules", "fsh",
         "--bind", bind, "-f", "csv"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    rows = pd.read_csv(io.StringIO(done.stdout))
    found = re.findall(
        r"^problem: .*?/([^/]+\.zip): (.*?)(?: Allowed:.*)?$", done.stderr, re.MULTILINE
    )
    return rows.assign(assigned=rows.assigned.astype(bool)), dict(found)


def _head() -> str:
    return """# Rollouts in other simulators

<!-- Written by benchmarks/foreign_rollouts.py and foreign_page.py; do not edit by hand. -->

Scripted policies in four simulators, recorded by [`safestage-record`](record_anywhere.md) in every physics step, and judged by
ETS and FSH rules with the bind files that come along (`--bind metaworld`, `gymnasium_robotics`, `maniskill`, `robosuite`). The scripts were
written to reach goals, and the tasks define no hazards, so the rates say little about these policies. They show which rules such
recordings decide, and what a success rate leaves out.

An episode ends at the simulator's own success, after which the robot is commanded to hold still for five seconds; without success
after 500 control steps (Meta-World), 300 (robosuite) or 150. Seeds count from 0.

```
python benchmarks/foreign_rollouts.py record metaworld FOLDER    # in each simulator's environment
python benchmarks/foreign_rollouts.py page FOLDER docs/foreign_rollouts.md
```"""


def _episodes(traces: list[Path], rows: pd.DataFrame, problems: dict[str, str]) -> pd.DataFrame:
    """A row per episode: task, success, and what became of it."""
    assigned = rows[rows.assigned]
    by_path = {Path(p).name: some for p, some in assigned.groupby(assigned.path.map(str))}
    out = []
    for trace in traces:
        some = by_path.get(trace.name)
        header = load(trace).header
        why = problems.get(trace.name, "nothing that a rule speaks of is moved").replace("|", "/")
        task = trace.name.rsplit(".", 2)[0]
        verdicts = Counter() if some is None else Counter(some.verdict)
        if some is None:
            outcome = "not judged"
        elif verdicts["violation"]:
            outcome = "violation"
        elif verdicts["inconclusive"] or verdicts["error"]:
            outcome, why = "inconclusive", "; ".join(sorted(set(_reasons(some))))
        else:
            outcome = "pass"
        success = bool(header.success)
        broken = () if some is None else tuple(some.rule[some.verdict == "violation"])
        out.append(
            {"task": task, "success": success, "outcome": outcome, "why": why, "broken": broken}
        )
    return pd.DataFrame(out)


def _reasons(some: pd.DataFrame) -> list[str]:
    undecided = some[some.verdict == "inconclusive"]
    return [f"{r.rule}: {r.signal} is not known" for r in undecided.itertuples()]


def _rates(every: pd.DataFrame) -> str:
    lines = [
        "## Rates",
        "",
        "SR: the simulator's own success, of all episodes. USR: violations among the decided successes; then the same "
        "without FSH104, which here depends on what the robot does after success (below). Tasks without a judged "
        "episode have no row.",
        "",
        "| simulator, task | policy | episodes | SR % | judged | USR % | without FSH104 | inconclusive | not judged |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for title, one in every.groupby("set", sort=False):
        lines.append(_line(f"**{title}**", one))
        judged = one.groupby("task").filter(lambda some: (some.outcome != "not judged").any())
        lines += [_line(str(task), some) for task, some in judged.groupby("task")]
    lines.append(_line("**all**", every))
    return "\n".join(lines)


def _line(name: str, some: pd.DataFrame) -> str:
    decided = some[some.outcome.isin(["pass", "violation"])]
    reached = decided[decided.success]
    policies = sorted(set(some.policy))
    rate = _share((reached.outcome == "violation").sum(), len(reached))
    other = _share(sum(any(rule != "FSH104" for rule in b) for b in reached.broken), len(reached))
    return (
        f"| {name} | {policies[0] if len(policies) == 1 else ''} | {len(some)} "
        f"| {100 * some.success.mean():.0f} | {len(decided)} | {rate} | {other} "
        f"| {(some.outcome == 'inconclusive').sum()} | {(some.outcome == 'not judged').sum()} |"
    )


def _share(part: int, whole: int) -> str:
    return f"{100 * part / whole:.0f} ({part}/{whole})" if whole else "–"


def _moved(rows: pd.DataFrame) -> str:
    """Whether what did not stay moved with the gripper, or left it."""
    lines = [
        "## What FSH104 measures here",
        "",
        "These episodes end at success, often with the object in the gripper, and then a step of zero commands the robot "
        "to hold still. A controller that lags behind its command, or gives way under a load, keeps moving and takes the "
        "object along. So FSH104 measures here how the environment stops, not how the policy places. The columns compare "
        "the motion of the object since success with that of the nearest part of the gripper:",
        "",
        "| simulator, task | FSH104 violated | moved with the gripper (within 2 cm of it) | left the gripper | median motion of the gripper |",
        "|---|---|---|---|---|",
    ]
    every: list[tuple[float, float]] = []
    for (title, task), some in rows[rows.rule == "FSH104"].groupby(["set", "task"], sort=False):
        ways = [_ways(Path(str(row.path)), str(row.signal)) for row in some.itertuples()]
        every += ways
        lines.append(_along(f"{title}, {task}", ways))
    return "\n".join([*lines, _along("**all**", every)])


def _along(name: str, ways: list[tuple[float, float]]) -> str:
    along = sum(apart <= 0.02 for _, apart in ways)
    travel = 100 * float(np.median([gripper for gripper, _ in ways]))
    return f"| {name} | {len(ways)} | {along} | {len(ways) - along} | {travel:.1f} cm |"


def _ways(path: Path, signal: str) -> tuple[float, float]:
    """Largest way (m) of the gripper since success, and of the thing relative to it (no rotation)."""
    trace = load(path)
    name = re.sub(r"^\w+\((.*?)\).*$", r"\1", signal)
    thing = np.asarray(trace.track(name).position)
    hold = trace.header.post_success_hold or 0.0
    begin = int(np.searchsorted(trace.t, trace.t[-1] - hold))
    grippers = [b.name for b in trace.header.bodies if b.kind == "gripper"]
    places = [np.asarray(trace.track(name).position) for name in grippers]
    hand = min(places, key=lambda p: float(np.linalg.norm(p[begin] - thing[begin])))
    gone = hand[begin:] - hand[begin]
    apart = thing[begin:] - thing[begin] - gone
    return tuple(float(np.linalg.norm(way, axis=1).max()) for way in (gone, apart))  # type: ignore[return-value]


def _undecided(every: pd.DataFrame) -> str:
    lines = [
        "## Not decided, and why",
        "",
        "| simulator | task | | episodes | why |",
        "|---|---|---|---|---|",
    ]
    open_ = every[every.outcome.isin(["inconclusive", "not judged"])]
    open_ = open_.assign(why=open_.why.map(_in_general))
    for (title, outcome, why), some in open_.groupby(["set", "outcome", "why"], sort=False):
        tasks = sorted(set(some.task))
        named = ", ".join(tasks[:4]) + (f" and {len(tasks) - 4} more" if len(tasks) > 4 else "")
        lines.append(f"| {title} | {named} | {outcome} | {len(some)} | {why} |")
    return "\n".join(lines)


def _in_general(why: str) -> str:
    """A reason without the numbers of one episode."""
    why = re.sub(r"at \d+\.\d+ s", "at some time", why)
    why = re.sub(r"in \d+ frames", "in some frames", why)
    return re.sub(r"-?\d+\.\d+(?:e[-+]\d+)?", "…", why)
