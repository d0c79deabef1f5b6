"""Claims of a foreign MCAP file are compared before it is read."""

import io
import struct
import zlib

import lz4.frame
import pytest
from mcap.writer import CompressionType, Writer

from safestage_eval.errors import TraceError
from safestage_eval.importers.mcap_whole import whole_messages
from safestage_eval.importers.tf_messages import read_messages

CHUNK, INDEX = 6, 8


def recording(packing=CompressionType.LZ4, attached=b"", **options):
    out = io.BytesIO()
    writer = Writer(out, compression=packing, chunk_size=400, **options)
    writer.start()
    schema = writer.register_schema("foxglove.FrameTransforms", "jsonschema", b"{}")
    channel = writer.register_channel("/tf", "json", schema)
    for n in range(20):
        writer.add_message(channel, n, b'{"transforms": []}' + b" " * 60, n)
    if attached:
        writer.add_attachment(0, 0, "x", "y", attached)
    writer.finish()
    return out.getvalue()


def records(data):
    """(kind, where, length) of each record."""
    at = 8
    while at + 9 <= len(data) - 8:
        kind, length = struct.unpack_from("<BQ", data, at)
        yield kind, at, length
        at += 9 + length


def messages(data):
    return [message.log_time for _, _, message in whole_messages(io.BytesIO(data))]


@pytest.mark.parametrize("packing", list(CompressionType))
@pytest.mark.parametrize("chunked", [True, False])
def test_a_sound_file(packing, chunked):
    assert messages(recording(packing, use_chunking=chunked)) == list(range(20))


@pytest.mark.parametrize("packing", list(CompressionType))
def test_every_byte_of_what_is_read_counts(packing):
    """One flipped anywhere but in names nobody asks for: an error, or the same messages."""
    data = recording(packing)
    truth = messages(data)
    for at in range(0, len(data), 7):
        hurt = bytearray(data)
        hurt[at] ^= 0x10
        try:
            found = messages(bytes(hurt))
        except Exception:  # noqa: BLE001 — the reader's own errors come in many kinds
            continue
        assert found == truth, at


def bomb():
    """An LZ4 chunk that says 100 bytes and comes to 64 MiB."""
    inside = bytes(64 << 20)
    packed = lz4.frame.compress(inside)
    head = struct.pack("<QQQI", 0, 0, 100, zlib.crc32(inside)) + struct.pack("<I", 3) + b"lz4"
    content = head + struct.pack("<Q", len(packed)) + packed
    return struct.pack("<BQ", CHUNK, len(content)) + content


def unchecked(data):
    """Without a checksum of the summary."""
    return data[:-12] + bytes(4) + data[-8:]


def test_a_bomb_without_an_index(tmp_path):
    data = recording(use_chunking=False)
    end = next(at for kind, at, _ in records(data) if kind == 15)
    footer = struct.pack("<BQQQI", 2, 20, 0, 0, 0)
    ending = struct.pack("<BQI", 15, 4, 0) + footer + data[-8:]
    (tmp_path / "x.mcap").write_bytes(data[:end] + bomb() + ending)
    with pytest.raises(TraceError, match="a chunk of 100 bytes has"):
        read_messages([tmp_path / "x.mcap"])


def test_messages_that_the_index_lost():
    data = bytearray(unchecked(recording()))
    data[next(at for kind, at, _ in records(bytes(data)) if kind == INDEX)] = 0x80  # passed over
    with pytest.raises(ValueError, match="says that it has 20 messages"):
        messages(bytes(data))
