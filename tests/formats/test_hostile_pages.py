"""Lengths and counts that a Parquet file only claims never lead a kernel out of its arrays."""

import numba  # noqa: F401 — the quick way is taken where it is loaded
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from safestage_eval.formats.byte_source import LocalSource
from safestage_eval.formats.parquet.footer_types import types_agree
from safestage_eval.formats.parquet.page_kernels import (
    DELTA,
    SPLIT,
    _deltas,
    find_pages,
    read_pages,
)
from safestage_eval.formats.parquet.parquet_columns import Block, read_blocks
from safestage_eval.formats.parquet.parquet_footer import COMPRESSED, FIRST_PAGE, parse, read_footer

HUGE = (2**31 - 1, 2**31, 2**32, 2**58, 2**59, 2**60, 2**62, 2**63 - 1, -1, -(2**31), -(2**63))
TEXT, LIST, RECORD, NUMBER = 8, 9, 12, 6


def varint(n):
    """Seven bits per byte, as far as 64 bits go."""
    n &= 2**64 - 1
    out = bytearray()
    while n > 127:
        out.append(n & 127 | 128)
        n >>= 7
    return bytes([*out, n])


def zigzag(n):
    return varint((n << 1) ^ (n >> 63))


def record(fields):
    """A Thrift record of whole numbers and records: number → value."""
    out, last = b"", 0
    for number, value in fields.items():
        kind = RECORD if isinstance(value, dict) else NUMBER
        out += bytes([(number - last) << 4 | kind])
        out += record(value) if kind == RECORD else zigzag(value)
        last = number
    return out + b"\0"


def header(size, packed, count, encoding=SPLIT):
    return record({1: 0, 2: size, 3: packed, 5: {1: count, 2: encoding, 3: 3, 4: 3}})


def pages_of(data, rows, encoding=SPLIT, end=None):
    """How many pages are found in bytes that begin with one, and the table of them."""
    values = np.frombuffer(data, np.uint8)
    chunks = np.array([[0, len(data) if end is None else end]])
    plan = np.array([[0, 1 if encoding == DELTA else 4, 0, 0, 0, 1, 0]])
    pages = np.zeros((4, 7), np.int64)
    found, stack = np.empty((64, 3), np.int64), np.empty((16, 4), np.int64)
    return find_pages(values, plan, chunks, rows, found, stack, pages), pages


def test_a_page_as_it_should_be():
    count, pages = pages_of(header(40, 12, 10) + bytes(12), 10)
    assert count == 1
    assert pages[0, 1:4].tolist() == [12, 40, 10]


@pytest.mark.parametrize("number", HUGE)
@pytest.mark.parametrize("place", range(3))
def test_a_page_that_claims_too_much(number, place):
    claimed = [40, 12, 10]
    claimed[place] = number
    whole = header(*claimed) + bytes(12)
    assert pages_of(whole, 10)[0] == -1
    assert pages_of(header(40, 12, 5) + bytes(12) + whole, 10)[0] == -1


def test_a_page_that_would_unpack_to_much_more_than_its_values():
    assert pages_of(header(10 << 20, 1 << 16, 10) + bytes(1 << 16), 10)[0] == -1


@pytest.mark.parametrize("number", HUGE)
@pytest.mark.parametrize("place", range(2))
def test_blocks_of_differences_that_claim_too_much(number, place):
    claimed = [number, 1] if place == 0 else [128, number]
    for width in (0, 1, 32, 33, 255):
        data = b"".join(map(varint, claimed)) + varint(10) + zigzag(0) + zigzag(1) + bytes([width])
        out = np.zeros(20, np.uint32)[::2]
        assert not _deltas(np.frombuffer(data, np.uint8), 0, out)
        assert not out[1:].any()


@pytest.mark.parametrize("levels", [0, 1, 4, 2**31, 2**32 - 1])
@pytest.mark.parametrize("run", [0, 1, 2, 20, 22, 2**63, 2**64 - 2])
def test_levels_that_claim_too_much(levels, run):
    values = levels.to_bytes(4, "little") + varint(run) + b"\1" + bytes(40)
    pages = np.array([[0, len(values), len(values), 10, SPLIT, -1, 0]])
    plan = np.array([[0, 4, 1, 0, 0, 1, 0]])
    good = read_pages(
        np.frombuffer(values, np.uint8), pages, plan, 10, np.zeros(10, np.uint32),
        np.zeros(10, np.uint32), np.ones(1, np.bool_),
    )  # fmt: skip
    assert good == (levels == 2 and run == 20)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "f.parquet"
    table = pa.table({"x": np.arange(50, dtype=np.float32), "n": np.arange(50, dtype=np.int32)})
    pq.write_table(
        table, path, compression="lz4", use_dictionary=False,
        column_encoding={"x": "BYTE_STREAM_SPLIT", "n": "DELTA_BINARY_PACKED"},
    )  # fmt: skip
    return LocalSource(path)


@pytest.mark.parametrize("number", [n for n in HUGE if abs(n) < 2**63])
@pytest.mark.parametrize("place", [FIRST_PAGE, COMPRESSED])
def test_columns_that_are_not_in_the_file(file, number, place):
    footer = read_footer(file)
    wanted = (Block(("x",), np.dtype(np.float32)),)
    assert read_blocks(file, footer, 0, wanted)
    footer.chunks[0, 0, place] = number
    assert not read_blocks(file, footer, 0, wanted)


def test_whole_numbers_in_place_of_names_are_no_limits(file):
    table = pa.table({"episode_index": ["a", "b"], "body": [1, 2]})
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink)
    data = sink.getvalue().to_pybytes()
    length = int.from_bytes(data[-8:-4], "little")
    [group] = parse(data[-8 - length : -8]).groups
    assert group.limits == {}


def test_a_footer_of_nothing_but_list_elements_takes_no_room():
    many = 1 << 20
    elements = bytes([2 << 4 | LIST, 0xF1]) + varint(many) + b"\1" * many + b"\0"
    assert parse(elements) is None


def test_levels_of_nesting_without_end():
    for deep in (bytes([1 << 4 | RECORD]), bytes([1 << 4 | LIST, 0x19]), b"\x19"):
        assert parse(deep * 1000) is None


def test_delta_pages_are_found_too():
    assert pages_of(header(40, 12, 10, DELTA) + bytes(12), 10, DELTA)[0] == 1


def test_types_that_do_not_agree_are_not_asked_for(file):
    """pyarrow ends the process when it is."""
    data = file.read(0, file.size)
    footer = data[-8 - int.from_bytes(data[-8:-4], "little") : -8]
    assert types_agree(footer)
    # the schema's elements: a type as the first field, then whether values may be missing
    other = footer.replace(b"\x15\x08\x25\x02\x18\x01x", b"\x15\x0c\x25\x02\x18\x01x")
    assert other != footer
    assert not types_agree(other)


@pytest.mark.parametrize("kind", range(16))
def test_the_types_of_no_footer_at_all(kind):
    for bytes_ in (b"", bytes([0x10 | kind]), bytes([0x10 | kind, 0xFF]) * 50, b"\x19\xfc" * 9000):
        types_agree(bytes_)
