"""The ledger: what was written is found, what was damaged is not there."""

import random

from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef
from safestage_eval.run.run_ledger import FILE, Ledger
from safestage_eval.run.worker import Line


class Keys:
    """Keys that are the ids of episodes."""

    def of(self, ref):
        return ref.episode_id


def line(n):
    return Line(b"{%d}" % n * (n % 7), f"e{n}", f"h{n}")


def written(folder, *numbers):
    """A ledger of a run over these episodes, and those that it asked for."""
    ledger = Ledger(folder, Keys())
    refs = [EpisodeRef(folder / f"{n}.mcap", "mcap", f"e{n}") for n in numbers]
    asked = []
    for number, ref in ledger.todo(refs):
        asked.append(int(ref.episode_id[1:]))
        ledger.note(number, line(asked[-1]))
    ledger.flush()
    return ledger, asked


def test_found_again_by_key_and_only_the_rest_is_asked_for(tmp_path):
    assert written(tmp_path, 1, 2, 3)[1] == [1, 2, 3]
    ledger, asked = written(tmp_path, 3, 10, 1)
    assert asked == [10]
    assert [ledger.find(f"e{n}") for n in (1, 2, 3, 10)] == [line(n).text for n in (1, 2, 3, 10)]
    assert ledger.find("e5") is None


def test_two_runs_share_a_folder(tmp_path):
    one, other = Ledger(tmp_path, Keys()), Ledger(tmp_path, Keys())
    for ledger, n in ((one, 1), (other, 2)):
        for number, _ in ledger.todo([EpisodeRef(tmp_path, "mcap", f"e{n}")]):
            ledger.note(number, line(n))
    one.flush()
    other.flush()
    assert one.find("e2") == line(2).text
    assert other.find("e1") == line(1).text


def test_whatever_byte_is_lost_the_results_are_the_same_or_not_there(tmp_path):
    """Cut off and turned over at many places."""
    written(tmp_path, 1, 2, 3)
    whole = (tmp_path / FILE).read_bytes()
    for place in random.Random(1).sample(range(len(whole)), 400):
        for data in (
            whole[:place],
            whole[:place] + bytes([whole[place] ^ 129]) + whole[place + 1 :],
        ):
            (tmp_path / FILE).write_bytes(data)
            try:
                ledger, _ = written(tmp_path, 1, 2, 3)
            except InputError as error:
                assert "--resume" in str(error)
                continue
            assert [ledger.find(f"e{n}") for n in (1, 2, 3)] == [line(n).text for n in (1, 2, 3)]
