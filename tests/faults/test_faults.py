"""A small share of the crash campaign (docs/reliability.md): nothing lost, nothing half, work goes on."""

import random

import pytest
from fault_campaign import full_disk, killed, read_only
from victims import prepared, writers

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")]


@pytest.mark.parametrize("number", range(6))
def test_whatever_happens_to_what_writes(tmp_path, number):
    victim = writers(prepared(tmp_path))[number]
    chance = random.Random(number)
    rows = [
        killed(victim, 4, chance, tmp_path / "killed"),
        full_disk(victim, 2, chance, tmp_path / "full"),
        read_only(victim, chance, tmp_path / "locked"),
    ]
    for row in rows:
        assert (row.lost, row.halves, row.next_failed) == (0, 0, 0), row
    assert rows[0].tried == 4
