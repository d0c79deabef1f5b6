"""Parts: what was written is found, what was damaged is not there, and folders may be shared."""

import pytest

from safestage_eval.errors import InputError
from safestage_eval.run.engine_interface import Line
from safestage_eval.run.result_parts import Parts


def key(number):
    return f"{number:032x}"


def results(*numbers):
    return [(key(n), Line(b"{%d}" % n * (n % 7), f"e{n}", f"h{n}")) for n in numbers]


def test_found_again_by_key(tmp_path):
    parts = Parts(tmp_path)
    rows = [*parts.add(results(1, 2, 3)), *parts.add(results(10, 4))]
    assert [parts.line(row) for row in rows] == [line.text for _, line in results(1, 2, 3, 10, 4)]
    again = Parts(tmp_path)
    for n in (4, 10, 3, 1, 2):
        assert again.line(again.find(key(n))) == results(n)[0][1].text
    assert again.find(key(5)) is None


def test_the_same_results_in_the_same_part(tmp_path):
    """Two runs in one folder that come to the same write the same file."""
    first, second = Parts(tmp_path), Parts(tmp_path)
    first.add(results(1, 2))
    second.add(results(1, 2))
    second.add(results(2, 1))
    assert len(list(tmp_path.iterdir())) == 2
    for parts in (first, second, Parts(tmp_path)):
        assert [parts.line(parts.find(key(n))) for n in (1, 2)] == [
            line.text for _, line in results(1, 2)
        ]


def test_whatever_byte_is_lost_the_results_are_the_same_or_not_there(tmp_path):
    """Cut off at every place, and each byte turned over."""
    Parts(tmp_path).add(results(1, 2, 3))
    [file] = tmp_path.iterdir()
    whole = file.read_bytes()
    damaged = [whole[:end] for end in range(len(whole))]
    damaged += [
        whole[:i] + bytes([whole[i] ^ flip]) + whole[i + 1 :]
        for i in range(len(whole))
        for flip in (1, 128)
    ]
    lost = 0
    for data in damaged:
        file.write_bytes(data)
        parts = Parts(tmp_path)
        for n in (1, 2, 3):
            row = parts.find(key(n))
            lost += row is None
            assert row is None or parts.line(row) == results(n)[0][1].text
    assert lost == 3 * len(damaged)


def test_what_vanishes_while_it_is_read_is_reported(tmp_path):
    parts = Parts(tmp_path)
    [row, *_] = parts.add(results(1, 2))
    next(tmp_path.iterdir()).unlink()
    with pytest.raises(InputError, match="removed while the run went on"):
        parts.line(row)


def test_a_folder_that_cannot_be_one(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be used"):
        Parts(tmp_path / "file")
