"""Messages are found with the index of a chunk exactly where a walk over its records finds them."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from safestage_eval.formats.mcap_chunks import CHANNEL, MESSAGE, Topics, bytes_at, find
from safestage_eval.formats.mcap_records import walk

SCHEMA = 3
TOPICS = ("/a", "/b", "/c")


def record(kind, content):
    return struct.pack("<BQ", kind, len(content)) + content


def channel(number, topic):
    name = topic.encode()
    return record(CHANNEL, struct.pack("<HHI", number, 1, len(name)) + name + bytes(8))


def message(number, data):
    return record(MESSAGE, struct.pack("<HIQQ", number, 0, 0, 0) + data)


numbers = st.integers(1, 4)
messages = st.tuples(st.just(MESSAGE), st.builds(message, numbers, st.binary(max_size=40)))
others = st.tuples(
    st.just(CHANNEL),
    st.builds(channel, numbers, st.sampled_from([*TOPICS, "/other"]))
    | st.builds(lambda n: record(SCHEMA, bytes(n)), st.integers(2, 30)),
)


@st.composite
def blocks(draw):
    """Records, and where the messages among them begin."""
    lead = draw(st.lists(others, max_size=4))
    rest = draw(st.lists(messages, max_size=12))
    for _ in range(draw(st.sampled_from([0, 0, 0, 1, 2]))):
        rest.insert(draw(st.integers(0, len(rest))), draw(others))
    raw, places = b"", []
    for kind, data in lead + rest:
        if kind == MESSAGE:
            places.append(len(raw))
        raw += data
    return raw, places


def outcome(raw, index):
    """Data of the messages by topic, and the channels learnt; or that the block is damaged."""
    topics = Topics(TOPICS)
    try:
        found = find(raw, None if index is None else np.array(index, np.uint64), topics)
    except (ValueError, IndexError, struct.error):
        return "damaged"
    return {topic: [bytes(p) for p in batch.parts()] for topic, batch in found.items()}, topics.of


@given(blocks(), st.randoms(use_true_random=False))
def test_with_the_right_index_in_any_order(block, random):
    raw, places = block
    random.shuffle(places)
    assert outcome(raw, places) == outcome(raw, None)


@given(blocks(), st.data())
def test_with_an_index_that_is_not_right(block, data):
    raw, places = block
    kept = [place for place in places if data.draw(st.booleans())]
    wrong = data.draw(st.lists(st.integers(0, len(raw) + 20) | st.just(2**64 - 1), max_size=3))
    assert outcome(raw, kept + wrong) == outcome(raw, None)


@given(blocks(), st.data())
def test_with_damaged_records(block, data):
    raw, places = block
    broken = bytearray(raw)
    for place in data.draw(st.lists(st.integers(0, max(0, len(raw) - 1)), max_size=3)):
        if raw:
            broken[place] = data.draw(st.sampled_from([0, 1, MESSAGE, 255]))
    broken = bytes(broken[: data.draw(st.integers(0, len(raw)))])
    assert outcome(broken, places) == outcome(broken, None)


def test_the_messages_are_those_that_were_put_in():
    raw = channel(1, "/a") + channel(2, "/b") + channel(7, "/other")
    places = []
    for number, data in ((1, b"x"), (7, b"?"), (2, b""), (1, b"yz")):
        places.append(len(raw))
        raw += message(number, data)
    expected = {"/a": [b"x", b"yz"], "/b": [b""]}, {1: "/a", 2: "/b"}
    assert outcome(raw, places) == outcome(raw, None) == expected


def test_bytes_at_positions():
    assert bytes_at(b"abcdef", np.array([4, 0]), 2).tobytes() == b"efab"
    with pytest.raises(IndexError):
        bytes_at(b"abcdef", np.array([5]), 2)


def written(chunked, index, compression):
    """A file of 50 messages on two topics, their data their own number, by topic."""
    from io import BytesIO

    from mcap.writer import CompressionType, IndexType, Writer

    stream, sent = BytesIO(), {"/a": [], "/b": []}
    writer = Writer(
        stream,
        chunk_size=300,
        compression=CompressionType[compression],
        use_chunking=chunked,
        index_types=IndexType.ALL if index else IndexType.NONE,
    )
    writer.start(profile="x")
    channels = {topic: writer.register_channel(topic, "x", 0) for topic in ("/a", "/other", "/b")}
    for n in range(50):
        topic = ("/a", "/b", "/other", "/a")[n % 4]
        data = n.to_bytes(1, "little") * (n % 7)
        sent.setdefault(topic, []).append(data)
        writer.add_message(channels[topic], n, data, n)
    writer.finish()
    return stream.getvalue(), {topic: sent[topic] for topic in ("/a", "/b")}


@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize("index", [True, False])
@pytest.mark.parametrize("compression", ["LZ4", "ZSTD", "NONE"])
def test_a_file_hands_its_messages_on_in_order(tmp_path, chunked, index, compression):
    path = tmp_path / "x.mcap"
    data, sent = written(chunked, index, compression)
    path.write_bytes(data)
    got = {topic: [] for topic in sent}

    def sink(topic):
        return lambda batch: got[topic].extend(bytes(part) for part in batch.parts())

    records = walk(path, {topic: sink(topic) for topic in got}, "x")
    assert records.whole
    assert got == sent
    # cut off: the first messages, and no others
    for cut in range(8, len(data), 61):
        path.write_bytes(data[:cut])
        for some in got.values():
            some.clear()
        assert not walk(path, {topic: sink(topic) for topic in got}, "x").whole
        assert all(got[topic] == sent[topic][: len(got[topic])] for topic in sent)
