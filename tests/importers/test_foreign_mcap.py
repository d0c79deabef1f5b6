"""What a foreign MCAP file claims is compared with what is in it."""

import io
import struct
import zlib

import lz4.frame
import pytest
from mcap.writer import CompressionType, Writer

from safestage_eval.errors import TraceError
from safestage_eval.importers.bag_files import CHUNK, messages
from safestage_eval.importers.tf_messages import read_messages


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


def times(path, data):
    path.write_bytes(data)
    return [message.time for message in messages(path)]


@pytest.mark.parametrize("packing", list(CompressionType))
@pytest.mark.parametrize("chunked", [True, False])
def test_a_sound_file(tmp_path, packing, chunked):
    data = recording(packing, use_chunking=chunked)
    assert times(tmp_path / "x.mcap", data) == list(range(20))


@pytest.mark.parametrize("packing", list(CompressionType))
def test_every_byte_of_what_is_read_counts(tmp_path, packing):
    """One flipped anywhere but in names nobody asks for: an error, or the same messages."""
    data = recording(packing)
    truth = times(tmp_path / "x.mcap", data)
    for at in range(0, len(data), 7):
        hurt = bytearray(data)
        hurt[at] ^= 0x10
        try:
            found = times(tmp_path / "x.mcap", hurt)
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


def test_a_bomb_among_messages(tmp_path):
    data = recording(use_chunking=False)
    (tmp_path / "x.mcap").write_bytes(data[:8] + bomb() + data[8:])
    with pytest.raises(TraceError, match="a chunk of 100 bytes has"):
        read_messages([tmp_path / "x.mcap"])


def test_messages_that_are_not_there(tmp_path):
    data = recording()
    at = data.index(b"lz4", data.index(b"lz4") + 1) - 41  # its second chunk
    assert data[at] == CHUNK
    hurt = data[:at] + b"\x80" + data[at + 1 :]  # of a kind that readers pass over
    with pytest.raises(ValueError, match="says that it has 20 messages"):
        times(tmp_path / "x.mcap", hurt)
