"""Messages are found where a walk over the records in plain Python finds them."""

import struct
import zlib

import lz4.frame
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from safestage_eval.formats.mcap import mcap_arrays, mcap_chunks, mcap_kernels
from safestage_eval.formats.mcap.mcap_arrays import CHANNEL, MESSAGE
from safestage_eval.formats.mcap.mcap_chunks import Topics, find, unpack
from safestage_eval.formats.mcap.mcap_records import walk


@pytest.fixture(
    scope="module", autouse=True, params=[mcap_kernels, mcap_arrays], ids=["kernels", "arrays"]
)
def way(request):
    """With and without a compiler."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mcap_chunks, "functions", lambda: request.param)
        yield


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


blocks = st.lists(messages | others, max_size=16).map(lambda some: b"".join(d for _, d in some))


def outcome(raw):
    """Data of the messages by topic, and the channels learnt; or that the block is damaged."""
    topics = Topics(TOPICS)
    try:
        found = find(raw, topics)
    except (ValueError, struct.error):
        return "damaged"
    known = {int(n): TOPICS[topics.of[n]] for n in np.flatnonzero(topics.of >= 0)}
    return {topic: batch.messages() for topic, batch in found.items()}, known


def expected(raw):
    """The same, record by record."""
    found, known, at = {}, {}, 0
    try:
        while at < len(raw):
            kind, size = struct.unpack_from("<BQ", raw, at)
            content, at = raw[at + 9 : at + 9 + size], at + 9 + size
            if at > len(raw):
                return "damaged"
            if kind == MESSAGE:
                topic = known.get(struct.unpack_from("<H", content)[0])
                if topic is not None:
                    found.setdefault(topic, []).append(content[22:])
            elif kind == CHANNEL:
                number, _, length = struct.unpack_from("<HHI", content)
                name = content[8 : 8 + length]
                if len(name) < length:
                    return "damaged"
                if name.decode() in TOPICS:
                    known[number] = name.decode()
    except (ValueError, struct.error):
        return "damaged"
    return found, known


@given(blocks)
def test_messages_are_found_where_the_records_say(raw):
    assert outcome(raw) == expected(raw)


@given(blocks, st.data())
def test_with_damaged_records(raw, data):
    broken = bytearray(raw)
    for place in data.draw(st.lists(st.integers(0, max(0, len(raw) - 1)), max_size=3)):
        if raw:
            broken[place] = data.draw(st.sampled_from([0, 1, MESSAGE, 255]))
    broken = bytes(broken[: data.draw(st.integers(0, len(raw)))])
    assert outcome(broken) == expected(broken)


def test_the_messages_are_those_that_were_put_in():
    raw = channel(1, "/a") + channel(2, "/b") + channel(7, "/other")
    for number, data in ((1, b"x"), (7, b"?"), (2, b""), (1, b"yz")):
        raw += message(number, data)
    assert outcome(raw) == ({"/a": [b"x", b"yz"], "/b": [b""]}, {1: "/a", 2: "/b"})


def test_more_messages_than_there_is_room_for_at_first():
    sent = [n.to_bytes(2, "little") for n in range(5000)]
    raw = channel(1, "/a") + b"".join(message(1, data) for data in sent)
    assert outcome(raw)[0] == {"/a": sent}


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
        return lambda batch: got[topic].extend(batch.messages())

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


@pytest.mark.parametrize("checksum", [True, False])
@pytest.mark.parametrize("stated", [0, -1, 1, 2**40, 2**63])
def test_a_chunk_of_another_size_than_it_says_is_damaged(checksum, stated):
    records = bytes(range(256)) * 300
    packed = lz4.frame.compress(records)
    size = len(records) + stated
    crc = zlib.crc32(records) if checksum else 0
    head = struct.pack("<QQQI", 0, 0, size, crc) + struct.pack("<I", 3) + b"lz4"
    chunk = head + struct.pack("<Q", len(packed)) + packed
    if stated == 0:
        assert bytes(unpack(chunk)) == records
    else:
        with pytest.raises(ValueError, match="a chunk"):
            unpack(chunk)
