"""Writes the page on foreign rollouts: scores what foreign_rollouts.py recorded, and counts."""

from __future__ import annotations

import io
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

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
"""What was seen in pictures, written by hand."""


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
    parts += [_rates(every), _found(violations), _undecided(every), NOTES.read_text().rstrip()]
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
    return """# Rollouts of other people's simulators

<!-- Written by benchmarks/foreign_rollouts.py and foreign_page.py; do not edit by hand. -->

Scripted policies in four simulators, recorded by [`safestage-record`](record_anywhere.md) inside their own
environments, in every physics step, and judged by ETS and FSH with the bind files that come along
(`--bind metaworld`, `gymnasium_robotics`, `maniskill`, `robosuite`). An episode ends at the simulator's own
success, after which the robot is held still for five seconds with the gripper as it was; without success
after 500 control steps (Meta-World), 300 (robosuite) or 150.

```
python benchmarks/foreign_rollouts.py record metaworld FOLDER    # in each simulator's environment
python benchmarks/foreign_rollouts.py page FOLDER docs/foreign_rollouts.md
```

A policy that passes here is not safe, and one that does not is no worse than others: these scripts were
written to reach goals, and the tasks name no hazards. What the table shows is which rules such recordings
decide, and what a success rate leaves out."""


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
        out.append({"task": task, "success": success, "outcome": outcome, "why": why})
    return pd.DataFrame(out)


def _reasons(some: pd.DataFrame) -> list[str]:
    undecided = some[some.verdict == "inconclusive"]
    return [f"{r.rule}: {r.signal} is not known" for r in undecided.itertuples()]


def _rates(every: pd.DataFrame) -> str:
    lines = [
        "## Rates",
        "",
        "SR: the simulator's own success, of all episodes. USR: of the successful episodes that were judged and "
        "decided, those with a violation. Inconclusive and unjudged ones are in neither.",
        "",
        "| simulator, task | policy | episodes | SR % | judged | USR % | inconclusive | not judged |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for title, one in every.groupby("set", sort=False):
        lines.append(_line(f"**{title}**", one))
        lines += [_line(str(task), some) for task, some in one.groupby("task")]
    lines.append(_line("**all**", every))
    return "\n".join(lines)


def _line(name: str, some: pd.DataFrame) -> str:
    decided = some[some.outcome.isin(["pass", "violation"])]
    reached = decided[decided.success]
    unsafe = (reached.outcome == "violation").sum()
    policies = sorted(set(some.policy))
    rate = f"{100 * unsafe / len(reached):.0f} ({unsafe}/{len(reached)})" if len(reached) else "–"
    return (
        f"| {name} | {policies[0] if len(policies) == 1 else ''} | {len(some)} "
        f"| {100 * some.success.mean():.0f} | {len(decided)} | {rate} "
        f"| {(some.outcome == 'inconclusive').sum()} | {(some.outcome == 'not judged').sum()} |"
    )


def _found(rows: pd.DataFrame) -> str:
    lines = [
        "## What was found",
        "",
        "| simulator, task | rule | episodes | an example |",
        "|---|---|---|---|",
    ]
    for (title, task, rule), some in rows.groupby(["set", "task", "rule"], sort=False):
        one = some.iloc[0]
        lines.append(
            f"| {title}, {task} | {rule} | {some.path.nunique()} | {one.episode_id}: {one.explanation} |"
        )
    return "\n".join(lines)


def _undecided(every: pd.DataFrame) -> str:
    lines = [
        "## What was not decided, and why",
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
    return re.sub(r"\d+\.\d+(?:e[-+]\d+)?", "…", why)
