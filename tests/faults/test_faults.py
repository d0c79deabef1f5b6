"""A small share of the crash campaign (docs/reliability.md): nothing lost, nothing half, work goes on."""

import random
from itertools import product

import pytest
from child import Child
from fault_campaign import full_disk, killed, read_only
from file_victims import Auditor, LabelWriters
from object_store import object_store
from process_faults import denied, failing_disk, jumping_clock
from sampled import share
from stores import short_store, throttling_store
from victims import StoreScorer, prepared, writers

from safestage_eval.formats.parquet import dataset_layout as layout

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")]


SOUND = (0, 0, 0)
"""Nothing lost, no half file taken for a whole one, and no next run that failed."""


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    return prepared(tmp_path_factory.mktemp("victims"))


@pytest.fixture(scope="module")
def victims(source):
    return writers(source)


@pytest.fixture(scope="module")
def file_victims(source):
    return [Auditor(source), LabelWriters(source)]


@pytest.mark.parametrize("number", share(range(8), 4))
def test_whatever_happens_to_what_writes(tmp_path, victims, file_victims, number):
    victim, chance = [*victims, *file_victims][number], random.Random(number)
    rows = [killed(victim, 1, chance, tmp_path / "killed")]
    if victim.name != "importer":  # which starts a process each time
        rows += [
            failing_disk(victim, 2, chance, tmp_path / "failing"),
            denied(victim, 1, chance, tmp_path / "denied"),
        ]
    if number < 3:
        rows += [
            full_disk(victim, 1, chance, tmp_path / "full"),
            read_only(victim, chance, tmp_path / "locked"),
            jumping_clock(victim, 1, chance, tmp_path / "clock"),
        ]
    for row in rows:
        assert (row.lost, row.halves, row.next_failed) == SOUND, row
    assert rows[0].tried == 1


def test_a_store_that_throttles_or_answers_with_less(tmp_path, source):
    chance = random.Random(0)
    with object_store() as store:
        distant = StoreScorer(source, store)
        for fault in share([throttling_store, short_store], 2):
            row = fault(distant, 1, chance, tmp_path / fault.__name__)
            assert (row.lost, row.halves, row.next_failed) == SOUND, row


@pytest.mark.parametrize(
    ("number", "left"),
    share(product([0, 2, 4], ["nothing but a folder", "a dataset without episodes"]), 3),
)
def test_what_was_left_without_an_episode_is_no_obstacle(tmp_path, victims, number, left):
    victim = victims[number]
    folder = tmp_path / "out" / "data"
    (folder / "meta" / "episodes").mkdir(parents=True)
    (folder / "meta" / ".info.json.part").write_bytes(b"{")
    if left == "a dataset without episodes":
        layout.prepare(folder)
    child = Child(victim, folder)
    assert child.wait() == 0, child.said()
    assert child.committed() <= victim.everything == victim.left(folder)
