"""A small share of the crash campaign (docs/reliability.md): nothing lost, nothing half, work goes on."""

import random

import pytest
from child import Child
from fault_campaign import full_disk, killed, read_only
from victims import prepared, writers

from safestage_eval.formats.parquet import dataset_layout as layout

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")]


@pytest.fixture(scope="module")
def victims(tmp_path_factory):
    return writers(prepared(tmp_path_factory.mktemp("victims")))


@pytest.mark.parametrize("number", range(6))
def test_whatever_happens_to_what_writes(tmp_path, victims, number):
    victim, chance = victims[number], random.Random(number)
    kills = 1 if victim.name == "importer" else 2  # which starts a process each time
    rows = [
        killed(victim, kills, chance, tmp_path / "killed"),
        full_disk(victim, 1, chance, tmp_path / "full"),
        read_only(victim, chance, tmp_path / "locked"),
    ]
    for row in rows:
        assert (row.lost, row.halves, row.next_failed) == (0, 0, 0), row
    assert rows[0].tried == kills


@pytest.mark.parametrize("number", range(6))
@pytest.mark.parametrize("left", ["nothing but a folder", "a dataset without episodes"])
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
