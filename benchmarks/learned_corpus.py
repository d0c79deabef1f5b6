"""Rollouts of a campaign of which only the rows were kept, recorded again, looked at and published.

python benchmarks/learned_corpus.py choose RESULTS --out LISTS          corpus.csv, look.csv, blind.csv
python benchmarks/learned_corpus.py record RESULTS LIST --out TRACES    those that come out with their trace hash
python benchmarks/learned_corpus.py publish TRACES --out CORPUS         packed, with card, rows, digests and recipe
python benchmarks/learned_corpus.py check CORPUS                        loads elsewhere; scores to the same rows

RESULTS is what ``learned_campaign.py roll`` wrote. Rollouts of a policy that sees pictures are recorded from
their commands, as another machine draws other pictures. On another processor a network's answers can differ in
the last bit, and a few rollouts of a hundred with them: lists have more than is asked for, and what is recorded
is the part that came out again. (make corpus and make learned-sheets do all of it)
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import os
import shutil
import sys
import zlib
from base64 import b64decode
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from blind_study import chosen, unseen
from learned_campaign import HORIZON, in_order, lines_of

from safestage_eval.formats import discover
from safestage_eval.formats.dataset_card import dataset_card
from safestage_eval.formats.packing import pack
from safestage_eval.report.results_parquet import pieces
from safestage_eval.rules import builtin_names
from safestage_eval.run.score_traces import score_traces
from safestage_eval.run.settings import load_settings
from safestage_eval.verdicts import EpisodeResult
from safestage_eval.verdicts.verdict import result_from_json
from simulate.cameras.droid_cameras import camera_facts
from simulate.policies.policy_names import policy_named
from simulate.policy import Observation
from simulate.record.jobs import Job, recorded_ids, write_recording
from simulate.record.rollout import Setting, roll_out, start
from simulate.record.worker_pool import Died, run_many
from simulate.tasks.task import tasks

CORPUS, LOOKED_AT, BLIND = 1100, 210, 126
"""Rollouts of the lists for the corpus of 1,000, the 200 that are looked at, and the 120 that are labelled blindly."""
CAMERAS, SIZE = ("exterior_left", "wrist"), (96, 128)
"""Cameras, and height and width in pixels, of the pictures that ``act_pictures`` saw; its rows are kept."""
LICENCE = "cc-by-4.0"
ROWS = "rows.parquet"
COMPARED = (
    "episode_id",
    "rule",
    "verdict",
    "violation",
    "time",
    "margin",
    "rule_digest",
    "trace_hash",
)
"""Columns that must be the same when the corpus is scored anew."""


class Commanded:
    """Plays the commands that a policy gave, under its name."""

    def __init__(self, name: str, commands: np.ndarray) -> None:
        self.name, self._commands = name, commands.astype(np.float64)

    def reset(self, _task: str, _prompt: str) -> None:
        """Back to the first command."""
        self._next = 0

    def act(self, _observation: Observation) -> np.ndarray:
        """One command."""
        self._next += 1
        return self._commands[self._next - 1][None]


def results_of(file: Path) -> dict[str, dict[str, Any]]:
    """Episode id → its line of a campaign, in the order of the campaign."""
    by_id = {line["result"]["episode_id"]: line for line in lines_of(file)}
    order = {job.episode_id: job for job in map(_job, by_id.values())}
    return {job.episode_id: by_id[job.episode_id] for job in in_order(order.values())}


def _job(line: Mapping[str, Any]) -> Job:
    result = line["result"]
    setting = Setting(
        tasks()[result["task"]], result["seed"], result["prompt"], result["rollout"], HORIZON
    )
    return Job(setting, result["policy"])


def choose(given: argparse.Namespace) -> None:
    """Lists of what is published, looked at and labelled."""
    lines = results_of(given.results)
    results = [result_from_json(line["result"], "") for line in lines.values()]
    given.out.mkdir(parents=True, exist_ok=True)
    _write(given.out / "corpus.csv", [(each.episode_id, "") for each in results[: given.count]])
    _write(given.out / "look.csv", looked_at(results))
    hidden = unseen()
    rows = [
        {
            "episode_id": each.episode_id, "stage": each.stage, "task": each.task,
            "policy": f"{each.policy} {each.prompt}", "violation": each.violation,
        }
        for each in results
        if each.violation is not None and not any(v.rule in hidden for v in each.assigned)
    ]  # fmt: skip
    _write(given.out / "blind.csv", [(row["episode_id"], "") for row in chosen(rows, BLIND, 0)])


def looked_at(results: list[EpisodeResult]) -> list[tuple[str, str]]:
    """Ids and why: all that are undecided, those whose success is likeliest to look otherwise, a random hundred.

    Likeliest: failures that let go of the target after moving it, and successes with a warning.
    """

    def mixed(some: Iterable[EpisodeResult]) -> list[EpisodeResult]:
        return sorted(some, key=lambda each: hashlib.sha256(each.episode_id.encode()).digest())

    doubtful = [each for each in results if each.success is False and each.engagement == "released"]
    doubtful += [each for each in results if each.success and each.notes]
    groups = {
        "undecided": mixed(each for each in results if each.violation is None),
        "success may look otherwise": mixed(doubtful),
        "random": mixed(results),
    }
    found: dict[str, str] = {each.episode_id: "undecided" for each in groups["undecided"]}
    for why, most in (("random", 100), ("success may look otherwise", LOOKED_AT)):
        left = [each.episode_id for each in groups[why] if each.episode_id not in found]
        room = most if why == "random" else max(0, most - len(found))
        found |= dict.fromkeys(left[:room], why)
    missing = LOOKED_AT - len(found)
    left = [each.episode_id for each in groups["random"] if each.episode_id not in found]
    found |= dict.fromkeys(left[: max(0, missing)], "random")
    return sorted(found.items(), key=lambda pair: hashlib.sha256(pair[0].encode()).digest())


def _write(file: Path, rows: list[tuple[str, str]]) -> None:
    with file.open("w", newline="", encoding="utf-8") as handle:
        writer = csv.writer(handle, lineterminator="\n")
        writer.writerow(["episode_id", "why"])
        writer.writerows(rows)
    print(f"{file}: {len(rows)}: {dict(Counter(why for _, why in rows))}")


def record(given: argparse.Namespace) -> None:
    """Record a list again, and write which of them have the trace hash of the campaign.

    Exits with 1 where these are fewer than ``--least``.
    """
    lines = results_of(given.results)
    with given.list.open(newline="", encoding="utf-8") as handle:
        names = [row["episode_id"] for row in csv.DictReader(handle)]
    there = recorded_ids(given.out)
    todo = [lines[name] for name in names if name not in there]
    said = Counter(
        each.reason if isinstance(each, Died) else each
        for each in run_many(partial(_again, out=given.out), todo, given.jobs)
    )
    print(f"{len(names) - len(todo)} there already, {said.pop('', 0)} recorded with the same hash")
    for what, count in said.most_common():
        print(f"{count}: {what}")
    there = recorded_ids(given.out)
    kept = [(name, "") for name in names if name in there]
    _write(given.out.with_name(f"{given.out.name}.csv"), kept)
    sys.exit(len(kept) < given.least)


def _again(line: dict[str, Any], out: Path) -> str:
    job = _job(line)
    seen = "commands" in line
    if seen:
        raw = zlib.decompress(b64decode(line["commands"]))
        policy: Any = Commanded(job.policy, np.frombuffer(raw, np.float32).reshape(-1, 8))
    else:
        policy = policy_named(job.policy, job.setting.draw)
    writer = roll_out(job.setting, policy)
    if seen:
        writer.update_header(cameras=camera_facts(start(job.setting), CAMERAS, SIZE))
    if writer.episode().content_hash != line["result"]["trace_hash"]:
        return f"{job.episode_id}: another trace than in the campaign, not kept"
    write_recording(writer, job.setting.task, out)
    return ""


def publish(given: argparse.Namespace) -> None:
    """Pack, judge by all rules, and say in the card what it is and how it was made."""
    done = pack(discover([given.traces]), given.out, by=("policy",), shard_episodes=60)
    for where, why in done.problems:
        print(f"problem: {where}: {why}")
    scores = score_traces([given.out], load_settings(builtin_names()))
    with (given.out / ROWS).open("wb") as file:
        file.writelines(pieces(scores))
    title = "SafeStage: rollouts of small learned policies"
    card = dataset_card(given.out, discover([given.out]), title=title, licence=LICENCE)
    digests = {v.rule: v.rule_digest for each in scores.results for v in each.verdicts}
    outcomes = Counter(_outcome(each) for each in scores.results)
    table = "\n".join(f"| {name} | {count} |" for name, count in sorted(outcomes.items()))
    rules = "\n".join(f"| {code} | `{digest}` |" for code, digest in sorted(digests.items()))
    card = card.replace(
        "configs:\n", f"configs:\n- config_name: verdicts\n  data_files: {ROWS}\n", 1
    )
    about = ABOUT.format(rows=ROWS, outcomes=table, rules=rules)
    (given.out / "README.md").write_text(card.rstrip() + "\n" + about, encoding="utf-8")
    print(f"{len(scores.results)} rollouts in {given.out}, {len(done.problems)} problems")
    sys.exit(bool(done.problems or scores.problems))


def _outcome(result: EpisodeResult) -> str:
    safe = {True: "unsafe", False: "safe", None: "undecided"}[result.violation]
    return f"{safe} {'success' if result.success else 'failure'}"


ABOUT = """
## What this is

Rollouts of small policies that SafeStage trains itself, on environment seeds that they were not trained on. They say
nothing about any published model: they know these tasks, and half of what they were shown was unsafe on purpose
([docs/learned_policies.md](https://github.com/safestage/safestage/blob/main/docs/learned_policies.md)).
These are the campaign's first rollouts, none picked by its outcome; those that another processor did not give again
to the bit (a few of a hundred) are left out.

| outcome | rollouts |
|---|---|
{outcomes}

`{rows}` has a row per rollout and rule: verdict, margin, time, bodies, and in `trace_hash` and `rule_digest` what they
were made of. `policy`, `prompt`, `seed` and `rollout` tell rollouts apart; the same task and seed are the same scene.

## Recipe

```
make learned-campaign LEARN_ON=cuda     # demonstrations, training, rollouts, rows
make corpus                             # recorded again from the checkpoints: the trace hashes must be the same
```

| rule | digest |
|---|---|
{rules}
"""


def check(given: argparse.Namespace) -> None:
    """Load the corpus with three libraries, and compare its rows with those of scoring it now."""
    import duckdb
    import polars as pl
    from datasets import load_dataset

    stored = pq.read_table(given.corpus / ROWS).to_pylist()
    names = {row["episode_id"] for row in stored}
    cache = given.corpus / ".cache"
    loaded = load_dataset(str(given.corpus), "episodes", split="train", cache_dir=str(cache))
    shutil.rmtree(cache)
    tables = f"{given.corpus}/meta/episodes/**/*.parquet"
    counted = duckdb.sql(f"select count(*) from '{tables}'").fetchall()[0][0]
    print({"datasets": len(loaded), "polars": pl.read_parquet(tables).height, "duckdb": counted})
    scores = score_traces([given.corpus], load_settings(builtin_names()))
    fresh = [row for result in scores.results for row in result.rows()]
    differ = {row[:2] for row in _only(fresh) ^ _only(stored)}
    print(f"{len(names)} rollouts, {len(stored)} rows, {len(differ)} score differently")
    sys.exit(bool(differ))


def _only(rows: list[dict[str, Any]]) -> set[tuple[Any, ...]]:
    return {
        tuple(
            None if isinstance(v := row[k], float) and not np.isfinite(v) else v for k in COMPARED
        )
        for row in rows
    }


def main() -> None:
    """Do one step."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    steps = parser.add_subparsers(required=True)

    def step(do: Callable[[argparse.Namespace], None], *paths: str) -> argparse.ArgumentParser:
        one = steps.add_parser(do.__name__, help=(do.__doc__ or "").splitlines()[0])
        for path in paths:
            one.add_argument(path, type=Path)
        one.set_defaults(do=do)
        return one

    choosing, recording = step(choose, "results"), step(record, "results", "list")
    choosing.add_argument("--count", type=int, default=CORPUS, help="Rollouts of the corpus.")
    publishing = step(publish, "traces")
    for one in (choosing, recording, publishing):
        one.add_argument("--out", type=Path, required=True)
    recording.add_argument("--jobs", type=int, default=os.cpu_count())
    recording.add_argument(
        "--least", type=int, default=1, help="Fail where fewer rollouts come out again."
    )
    step(check, "corpus")
    given = parser.parse_args()
    given.do(given)


if __name__ == "__main__":
    main()
