"""The campaign's order leaves pairs whole wherever it is cut; what is chosen is recorded again to the bit."""

from __future__ import annotations

import argparse
import csv
import importlib
import json
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from safestage_eval.verdicts import EpisodeResult
from simulate.record.jobs import plan, recorded_ids
from simulate.record.rollout import PROMPTS
from simulate.tasks.task import tasks

pytest.importorskip("onnxruntime")
pytestmark = pytest.mark.simulate
BENCHMARKS = Path(__file__).parents[3] / "benchmarks"


@pytest.fixture(scope="module")
def scripts():
    sys.path.insert(0, str(BENCHMARKS))
    try:
        yield SimpleNamespace(
            campaign=importlib.import_module("learned_campaign"),
            corpus=importlib.import_module("learned_corpus"),
        )
    finally:
        sys.path.remove(str(BENCHMARKS))


def test_wherever_it_is_cut_settings_are_whole_and_seeds_alike(scripts) -> None:
    some = list(tasks().values())[::9]
    policies = ["learned:act", "learned:bc"]
    todo = scripts.campaign.in_order(plan(some, policies, (100, 101), PROMPTS, 2, horizon=30.0))
    cell = len(policies) * len(PROMPTS)
    for cut in range(cell, len(todo), cell):
        counts = Counter((j.setting.task.id, j.setting.seed, j.setting.rollout) for j in todo[:cut])
        assert set(counts.values()) == {cell}
        by_task = Counter(job.setting.task.id for job in todo[:cut])
        assert max(by_task.values()) - min(by_task[task.id] for task in some) <= cell


def result(number: int, **more: object) -> EpisodeResult:
    blank = EpisodeResult(
        f"e{number}", "", "t", "FSH", "f", "learned:act", "default", 100, number, True, 1.0, "h", "v", ()
    )  # fmt: skip
    return replace(blank, **more)


def test_what_is_looked_at(scripts) -> None:
    """Without verdicts every result is undecided: all of them are looked at, however many."""
    undecided = [result(i) for i in range(150)]
    assert dict(scripts.corpus.looked_at(undecided)) == {f"e{i}": "undecided" for i in range(150)}

    class Safe(EpisodeResult):
        violation = False

    safe = [Safe(**vars(result(i, success=False, engagement="released"))) for i in range(900, 970)]
    rest = [Safe(**vars(result(i))) for i in range(1000, 2000)]
    found = scripts.corpus.looked_at([*undecided[:20], *safe, *rest])
    counts = Counter(why for _, why in found)
    assert len({name for name, _ in found}) == len(found) == scripts.corpus.LOOKED_AT >= 200
    assert counts["undecided"] == 20
    assert counts["random"] >= 100
    assert counts["success may look otherwise"] >= 60
    assert found == scripts.corpus.looked_at([*rest[::-1], *safe, *undecided[:20]])


def test_rolled_out_recorded_again_published_and_checked(
    scripts, tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.setattr(scripts.campaign, "HORIZON", 2.0)
    monkeypatch.setattr(scripts.corpus, "HORIZON", 2.0)

    def roll() -> None:
        scripts.campaign.roll(argparse.Namespace(
            names=["act"], seeds=(100,), rollouts=1, most=lambda _: 1, work=tmp_path, jobs=1, until=1e12,
            tasks=[tasks()["ets_apple_over_domino_row"]],
        ))  # fmt: skip

    roll()
    lines = (tmp_path / "results.jsonl").read_text()
    assert len(lines.splitlines()) == 3
    cut = lines.splitlines(keepends=True)
    (tmp_path / "results.jsonl").write_text("".join(cut[:2]) + cut[2][:40])
    roll()
    assert "2 there already, 1 rolled out" in capsys.readouterr().out
    again = (tmp_path / "results.jsonl").read_text().splitlines()
    hashes = [json.loads(line)["result"]["trace_hash"] for line in again]
    assert hashes == [json.loads(line)["result"]["trace_hash"] for line in cut]
    scripts.campaign.rows(argparse.Namespace(work=tmp_path))
    given = argparse.Namespace(
        results=tmp_path / "results.jsonl", out=tmp_path / "lists", count=2, jobs=1, least=2
    )
    scripts.corpus.choose(given)
    given.list, given.out = tmp_path / "lists/corpus.csv", tmp_path / "traces"
    assert stopped_with(scripts.corpus.record, given) == 0
    with given.list.open(newline="") as file:
        names = {row["episode_id"] for row in csv.DictReader(file)}
    assert len(names) == 2
    assert recorded_ids(tmp_path / "traces") == names
    assert (tmp_path / "traces.csv").read_text() == given.list.read_text()
    given.least = 3
    assert stopped_with(scripts.corpus.record, given) == 1, "fewer than asked for came out again"
    given.least = 1
    publishing = argparse.Namespace(traces=tmp_path / "traces", out=tmp_path / "corpus")
    assert stopped_with(scripts.corpus.publish, publishing) == 0
    card = (tmp_path / "corpus/README.md").read_text()
    assert card.startswith("---\n")
    assert "license: cc-by-4.0" in card
    assert "config_name: verdicts" in card
    other = (tmp_path / "results.jsonl").read_text().replace('"trace_hash":"', '"trace_hash":"0')
    (tmp_path / "other.jsonl").write_text(other)
    given.results, given.out = tmp_path / "other.jsonl", tmp_path / "none"
    assert stopped_with(scripts.corpus.record, given) == 1, "another trace was taken for it"
    assert not recorded_ids(tmp_path / "none")


def stopped_with(do, given: argparse.Namespace) -> int:
    with pytest.raises(SystemExit) as stopped:
        do(given)
    return int(stopped.value.code)


def test_further_seeds_make_up_for_demonstrations_that_fail(scripts, tmp_path, monkeypatch) -> None:
    """Seeds that no push leaves feasible are made up for, in the task and way that lack them alone."""
    campaign = scripts.campaign
    there: list[SimpleNamespace] = []
    asked = []

    def record(_given: object, which: list, seeds: range) -> None:
        for task, way in which:
            asked.append((task.id, way, [*seeds]))
            fields = {"task": task.id, "policy": f"demonstration:{way}"}
            there.extend(
                SimpleNamespace(problem=None, fields={**fields, "success": way == "safe" or s % 2})
                for s in seeds
            )

    monkeypatch.setattr(campaign, "_record", record)
    monkeypatch.setattr(campaign, "discover", lambda _folders: there)
    given = argparse.Namespace(
        tasks=[*tasks().values()][:2],
        seeds=range(30),
        rollouts=1,
        work=tmp_path,
        until=float("inf"),
    )
    campaign.demos(given)
    more = [each for each in asked if each[2][0] >= 30]
    assert {way for _, way, _ in more} == {"unsafe"}
    assert more[0][2] == [*range(30, 35)]
    counts = Counter(
        (ref.fields["task"], ref.fields["policy"]) for ref in there if ref.fields["success"]
    )
    assert min(counts.values()) >= campaign.LEAST
