"""Checksums and frames of TFRecord files."""

import numpy as np
import pytest
import rlds_sets
from hypothesis import given
from hypothesis import strategies as st

from safestage_eval.importers.tfrecord import crc32c, numbers, parse_example, record_places


@pytest.mark.parametrize(
    ("data", "crc"),
    [
        (b"123456789", 0xE3069283),
        (bytes(32), 0x8A9136AA),  # RFC 3720, B.4
        (b"\xff" * 32, 0x62A8AB43),
        (bytes(range(32)), 0x46DD794E),
        (bytes(range(31, -1, -1)), 0x113FDB5C),
    ],
)
def test_published_checksums(data, crc):
    assert crc32c(data) == crc


@given(st.integers(0, 3000), st.integers(0, 2**32 - 1))
def test_lanes_are_no_other_checksum(size, seed):
    data = np.random.default_rng(seed).bytes(size)
    assert crc32c(data) == rlds_sets.crc32c(data)


@given(st.lists(st.integers(0, 300), max_size=8))
def test_records_lie_where_they_were_written(tmp_path_factory, sizes):
    file = tmp_path_factory.mktemp("records") / "a"
    file.write_bytes(b"".join(rlds_sets.record(b"x" * size) for size in sizes))
    assert [size for _, size in record_places(file)] == sizes


@given(st.lists(st.integers(-(2**63), 2**63 - 1)))
def test_whole_numbers(values):
    data = rlds_sets.example({"a": np.array(values, np.int64)})
    found = numbers(parse_example(data, "here")["a"])
    assert found.tolist() == [float(v) for v in values]
