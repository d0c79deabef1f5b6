"""Parts: what was written is found, what was damaged is not there, and folders may be shared."""

from safestage_eval.run.result_parts import Line, Parts


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
