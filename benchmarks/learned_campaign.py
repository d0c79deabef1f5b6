"""From demonstrations to the rows of thousands of rollouts of policies trained on them, in steps that can be cut.

python benchmarks/learned_campaign.py demos                    record demonstrations, both ways of every task
python benchmarks/learned_campaign.py export                   a LeRobot dataset of them
python benchmarks/learned_campaign.py train bc act diffusion   several at once on one GPU
python benchmarks/learned_campaign.py roll act diffusion       roll out and judge, nothing kept but the rows
python benchmarks/learned_campaign.py rows                     the rows as one Parquet file

Each step takes up what is there already, uses all processors (--jobs), and begins nothing after --minutes.
Whatever is cut off, what there is covers all tasks alike: rollouts go by rollout and seed, and within these
task by task, with all prompts and policies of a task beside each other, so that pairs stay whole.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
import zlib
from base64 import b64encode
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from safestage_eval.formats import discover
from safestage_eval.report.results_parquet import pieces
from safestage_eval.rules import RuleSet, builtin_names, load_rules
from safestage_eval.run.scores import Scores, titles
from safestage_eval.verdicts import judge
from safestage_eval.verdicts.verdict import result_from_json, to_json
from simulate.learn.checkpoint import FOLDER
from simulate.learn.export_dataset import export_dataset
from simulate.policies.policy_names import policy_named
from simulate.record.jobs import Job, Outcome, plan, record_one, recorded_ids
from simulate.record.rollout import PROMPTS, roll_out
from simulate.record.worker_pool import Died, run_many
from simulate.tasks.task import Task, tasks_matching
from simulate.world.world import FRAME_RATE, FRAMES_PER_ACTION

DEMO_HORIZON = 45.0
"""s; what has not reached its goal by then would wait for the task's horizon in vain."""
WAYS = ("safe", "unsafe")
LEAST = 20
"""Demonstrations of each task and way that reach the goal."""
MORE = 5
"""Times that further seeds are tried where there are fewer."""
HORIZON = DEMO_HORIZON
"""s of the rollouts of learned policies: as long as demonstrations had."""


def demos(given: argparse.Namespace) -> None:
    """Record demonstrations: seeds outermost, so that a cut leaves as many of every task.

    Then on further seeds, where fewer than ``LEAST`` of a task and way reached the goal: the arm cannot follow
    every push.
    """
    seeds = given.seeds
    by_id = {task.id: task for task in given.tasks}
    _record(given, [(task, way) for task in given.tasks for way in WAYS], seeds)
    for _ in range(MORE):
        lacking = _lacking(given)
        if not lacking or time.time() > given.until:
            break
        seeds = range(seeds[-1] + 1, seeds[-1] + 1 + max(lacking.values()))
        _record(given, [(by_id[task], way) for task, way in lacking], seeds)
    for (task, way), count in _lacking(given).items():
        print(f"{count} too few of {task}, {way}")


def _lacking(given: argparse.Namespace) -> dict[tuple[str, str], int]:
    """(task id, way) → how many demonstrations that reached their goal are missing."""
    asked = min(LEAST, len(given.seeds) * given.rollouts)
    reached = Counter(
        (ref.fields["task"], ref.fields["policy"])
        for ref in discover([given.work / "demos"])
        if ref.problem is None and ref.fields.get("success")
    )
    missing = {
        (task.id, way): asked - reached[task.id, f"demonstration:{way}"]
        for task in given.tasks
        for way in WAYS
    }
    return {which: count for which, count in missing.items() if count > 0}


def _record(
    given: argparse.Namespace, which: Iterable[tuple[Task, str]], seeds: Sequence[int]
) -> None:
    """Record what is not there yet, and print what came of it."""
    out = given.work / "demos"
    todo = [
        job
        for task, way in which
        for job in plan(
            [task],
            [f"demonstration:{way}"],
            seeds,
            ("default",),
            given.rollouts,
            horizon=DEMO_HORIZON,
        )
    ]
    todo.sort(key=lambda job: (job.setting.rollout, job.setting.seed))
    there = recorded_ids(out)
    todo = [job for job in todo if job.episode_id not in there]
    failed: Counter[str] = Counter()
    reached = recorded = late = 0
    simulated = taken = 0.0
    work = partial(_demo, out=out, until=given.until)
    for outcome in _all(todo, work, given.jobs):
        if outcome is None:
            late += 1
        elif isinstance(outcome, Died) or outcome.problem:
            why = outcome.reason if isinstance(outcome, Died) else outcome.problem
            name = "" if isinstance(outcome, Died) else outcome.episode_id.partition(".d")[0]
            failed[f"{name}: {why}"] += 1
        else:
            recorded += 1
            reached += outcome.success_time is not None
            simulated, taken = simulated + outcome.simulated, taken + outcome.taken
    for why, count in failed.most_common():
        print(f"not recorded, {count} times: {why}")
    said = f"{len(there)} there already, {recorded} recorded ({reached} reached their goal, {simulated:.0f} s"
    print(
        f"{said} in {taken:.0f} s of processor), {failed.total()} not recorded, {late} left for next time"
    )


def _all(todo: Sequence[Job], work: Callable[[Job], Any], jobs: int) -> Iterator[Any]:
    """Results of the work on every job. The first is done here: what it loads, all processes have."""
    if todo:
        yield work(todo[0])
        yield from run_many(work, todo[1:], jobs)


def _demo(job: Job, out: Path, until: float) -> Outcome | None:
    return None if time.time() > until else record_one(job, out)


def export(given: argparse.Namespace) -> None:
    """A LeRobot dataset of the demonstrations that reached their goal."""
    out = given.work / "dataset"
    if (out / "meta/info.json").exists():
        print(f"{out} is there already")
        return
    spread = partial(run_many, jobs=given.jobs)
    done = export_dataset(discover([given.work / "demos"]), out, spread=spread)
    print(
        f"{done.kept} episodes, {done.steps:,} control steps, {done.left_out} did not reach their goal"
    )
    print("\n".join(done.problems), end="\n" if done.problems else "")


def train(given: argparse.Namespace) -> None:
    """Train several at once; ``act_again`` is act from another seed."""
    running = {}
    for name in given.names:
        out = FOLDER / f"{name}.onnx"
        kind = name.removesuffix("_again")
        command = [
            sys.executable, "-c", "from safestage_eval.cli import main; main()", "learn", "train", kind,
            "--data", str(given.work / "dataset"), "--out", str(out), "--device", given.device,
            "--seed", str(int(name != kind)),
        ]  # fmt: skip
        command += ["--steps", str(given.steps)] if given.steps else []
        log = (given.work / f"train-{name}.log").open("w", encoding="utf-8")
        running[name] = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)
    for name, process in running.items():
        code = process.wait()
        lines = (given.work / f"train-{name}.log").read_text(encoding="utf-8").splitlines()
        print(f"{name}: exit {code}: {lines[-1] if lines else ''}")
    sys.exit(any(process.returncode for process in running.values()))


def roll(given: argparse.Namespace) -> None:
    """Roll out and judge at once; a line of JSON for each rollout."""
    todo = in_order(plan(
        given.tasks, [f"learned:{name}" for name in given.names], given.seeds, PROMPTS, given.rollouts,
        horizon=HORIZON,
    ))  # fmt: skip
    todo = [job for job in todo if job.setting.rollout < given.most(job.policy)]
    file = given.work / "results.jsonl"
    there = {line["result"]["episode_id"] for line in lines_of(file)}
    _mend(file)
    todo = [job for job in todo if job.episode_id not in there]
    new = late = 0
    simulated = taken = 0.0
    problems: Counter[str] = Counter()
    began = time.time()
    with file.open("a", encoding="utf-8") as out:
        for line in _all(todo, partial(_rolled, until=given.until), given.jobs):
            if line is None:
                late += 1
            elif isinstance(line, Died) or "problem" in line:
                problems[line.reason if isinstance(line, Died) else line["problem"]] += 1
            else:
                new += 1
                simulated, taken = simulated + line["simulated"], taken + line["taken"]
                out.write(json.dumps(line, separators=(",", ":")) + "\n")
                out.flush()
    for problem, count in problems.most_common(20):
        print(f"{count}: {problem}")
    print(
        f"{len(there)} there already, {new} rolled out and judged ({simulated:.0f} s in {taken:.0f} s of processor, "
        f"{time.time() - began:.0f} s on the clock), {problems.total()} failed, {late} left for next time"
    )


def in_order(todo: Iterable[Job]) -> list[Job]:
    """By rollout and seed; then the tasks in an order without meaning, each with all its prompts and policies."""
    return sorted(
        todo,
        key=lambda job: (
            job.setting.rollout,
            job.setting.seed,
            zlib.crc32(job.setting.task.id.encode()),
        ),
    )


def _rolled(job: Job, until: float) -> dict[str, Any] | None:
    if time.time() > until:
        return None
    start = time.process_time()
    try:
        policy = policy_named(job.policy, job.setting.draw)
        writer = roll_out(job.setting, policy)
        if writer.header.termination == "error":
            return {"problem": f"{job.policy}: {writer.header.notes[-1]}"}
        episode = writer.episode()
        result = judge(episode, _judged_by(), assigned_only=True)
    except Exception as error:  # noqa: BLE001 - whatever it is, the others go on
        return {"problem": f"{job.policy}, {job.setting.task.id}: {error!r}"}
    line = {"result": to_json(result), "simulated": round(len(episode) / FRAME_RATE, 3)}
    if getattr(policy, "cameras", ()):  # another machine draws other pictures: what it did is kept
        commands = np.ascontiguousarray(episode.frames.action[::FRAMES_PER_ACTION], np.float32)
        line["commands"] = b64encode(zlib.compress(commands.tobytes(), 9)).decode()
    line["taken"] = round(time.process_time() - start, 3)
    return line


@cache
def _judged_by() -> RuleSet:
    return load_rules(builtin_names())


def lines_of(file: Path) -> Iterable[dict[str, Any]]:
    """The whole lines of a file of ``roll``."""
    if not file.exists():
        return
    with file.open(encoding="utf-8") as lines:
        for line in lines:
            if line.endswith("\n"):  # else it was cut off
                yield json.loads(line)


def _mend(file: Path) -> None:
    """Take away a last line that was cut off, so that the next one begins anew."""
    if file.exists():
        whole = file.read_bytes()
        if not whole.endswith(b"\n"):
            os.truncate(file, whole.rfind(b"\n") + 1)


def rows(given: argparse.Namespace) -> None:
    """The rows of all rollouts so far, as ``safestage-score -f parquet`` writes them."""
    results = {}
    for line in lines_of(given.work / "results.jsonl"):
        result = result_from_json(line["result"], "")
        results[result.episode_id] = result
    scores = Scores(tuple(results[name] for name in sorted(results)), (), titles(_judged_by()))
    out = given.work / "rows.parquet"
    with out.open("wb") as file:
        file.writelines(pieces(scores))
    print(f"{len(results)} rollouts in {out}")


def _numbers(text: str) -> Sequence[int]:
    first, _, last = text.partition("-")
    return range(int(first), int(last or first) + 1)


STEPS = {
    "demos": (demos, "0-21", 1), "export": (export, "0", 1),
    "train": (train, "0", 1), "roll": (roll, "100-102", 4), "rows": (rows, "0", 1),
}  # fmt: skip
"""Step → what does it, its seeds and rollouts."""


def main() -> None:
    """Do one step."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("step", choices=STEPS)
    parser.add_argument("names", nargs="*", help="Policies to train or to roll out.")
    parser.add_argument(
        "--work", type=Path, default=Path("build/learn"), help="Folder for all of it."
    )
    parser.add_argument("--task", action="append", help="Only tasks of this pattern. Repeatable.")
    parser.add_argument("--seeds", type=_numbers, help="Such as 0-19.")
    parser.add_argument("--rollouts", type=int, help="Rollouts of each setting.")
    parser.add_argument(
        "--once", action="append", default=[], help="A policy that is rolled out once per setting."
    )
    parser.add_argument(
        "--minutes", type=float, default=1e6, help="Start nothing new after this many minutes."
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="Processes.")
    parser.add_argument("--device", default="cuda", help="Where to train.")
    parser.add_argument("--steps", type=int, help="Steps of training. Default: the recipe's.")
    given = parser.parse_args()
    do, seeds, rollouts = STEPS[given.step]
    given.seeds = given.seeds or _numbers(seeds)
    given.rollouts = given.rollouts or rollouts
    given.until = time.time() + 60 * given.minutes
    given.tasks = tasks_matching(tuple(given.task or ("*",)))
    given.most = lambda policy: (
        1 if policy.removeprefix("learned:") in given.once else given.rollouts
    )
    given.work.mkdir(parents=True, exist_ok=True)
    began = time.time()
    do(given)
    print(f"{given.step}: {time.time() - began:.0f} s", flush=True)


if __name__ == "__main__":
    main()
