"""Episodes of a file go to one process, while there are other files; all are given out once."""

from collections import Counter
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from safestage_eval.formats import EpisodeRef
from safestage_eval.run.sharing import AHEAD, Shares, place


def numbered(sizes):
    """Files with so many episodes each, one file after the other."""
    files = [file for file, size in enumerate(sizes) for _ in range(size)]
    return [
        (number, EpisodeRef(Path("meta.parquet"), "parquet", stored_in=f"shard-{file}"))
        for number, file in enumerate(files)
    ]


def handed_out(episodes, turns, processes):
    """Process and episodes of each turn: as ``turns`` says, then each in turn; most that were held."""
    looked, given_out, most = 0, 0, 0

    def source():
        nonlocal looked
        for episode in episodes:
            looked += 1
            yield episode

    shares, had, log = Shares(source(), processes), [None] * processes, []
    turns = iter(turns)
    idle = 0
    while idle < processes:
        process, count = next(turns, (len(log) + idle, 3))
        process %= processes
        others = [had[other] for other in range(processes) if other != process]
        chunk = shares.take(count, had[process], others)
        assert len(chunk) <= count
        idle = 0 if chunk else idle + 1
        if chunk:
            had[process] = place(chunk[-1])
            given_out += len(chunk)
            most = max(most, looked - given_out)
            log.append((process, chunk))
    return log, most


TURNS = st.lists(st.tuples(st.integers(0, 3), st.integers(1, 64)), max_size=40)


@given(st.lists(st.integers(1, 120), max_size=8), TURNS, st.integers(1, 4))
def test_each_episode_is_given_out_once_and_few_are_held(sizes, turns, processes):
    episodes = numbered(sizes)
    log, most = handed_out(episodes, turns, processes)
    assert sorted(number for _, chunk in log for number, _ in chunk) == list(range(sum(sizes)))
    assert most <= AHEAD * processes + 64
    if processes == 1:
        assert [number for _, chunk in log for number, _ in chunk] == list(range(sum(sizes)))
        assert most <= 1


@given(st.lists(st.integers(1, 100), min_size=2, max_size=8), st.integers(2, 4))
def test_a_file_has_one_process_until_no_other_file_is_left(sizes, processes):
    """Then processes that have nothing to do share what is left of the others' files."""
    log, _ = handed_out(numbered(sizes), (), processes)
    begun, visitors = set(), {}
    for process, chunk in log:
        for episode in chunk:
            visitors.setdefault(place(episode), Counter())[process] += 1
        if all(place(episode) in begun for episode in chunk):
            continue
        # somebody still found a file that nobody had: up to here no file was shared
        begun |= {place(episode) for episode in chunk}
        assert all(len(counted) == 1 for counted in visitors.values())


@given(st.lists(st.integers(1, 9), min_size=1, max_size=9), st.permutations(range(9)), TURNS)
def test_episodes_of_files_in_any_order_are_all_given_out(sizes, order, turns):
    """Episodes of one file between those of another."""
    episodes = sorted(numbered(sizes), key=lambda episode: order[episode[0] % 9])
    log, _ = handed_out(episodes, turns, 3)
    assert Counter(n for _, chunk in log for n, _ in chunk) == Counter(n for n, _ in episodes)


def test_of_one_large_file_each_process_has_its_share():
    log, _ = handed_out(numbered([600]), (), 3)
    share = Counter()
    for process, chunk in log:
        share[process] += len(chunk)
    assert min(share.values()) > 150
