"""TFRecord files, read without TensorFlow.

A record is: its length n (uint64, little endian), a checksum of these eight bytes, n bytes, a checksum of
these. Checksums are CRC-32C (Castagnoli), rotated right by 15 bits, plus a constant (tensorflow/core/lib/io/
record_writer.h, core/lib/hash/crc32c.h). Each record of interest here is a ``tf.train.Example``
(core/example/feature.proto): names with lists of bytes, floats or integers.
"""

from __future__ import annotations

import struct
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import TraceError

F64 = NDArray[np.float64]
U32 = NDArray[np.uint32]

POLYNOMIAL = 0x82F63B78
MASK = 0xA282EAD8

_FRAME = 16
"""Bytes of a record besides its data."""


def record_places(file: Path) -> list[tuple[int, int]]:
    """Offset and size in bytes of each record's data, from the frames alone.

    Raises:
        TraceError: the file ends within a record, or a length is not what was written.
    """
    places, size = [], file.stat().st_size
    with file.open("rb") as stream:
        at = 0
        while at < size:
            stream.seek(at)
            head = stream.read(12)
            if len(head) < 12:
                raise _cut(file, at)
            length, check = struct.unpack("<QI", head)
            if _masked(crc32c(head[:8])) != check:
                raise TraceError(
                    f"{file}: byte {at}", "is not the length of a record.",
                    fix="download it again; SafeStage reads uncompressed TFRecord files",
                )  # fmt: skip
            if length > size - at - _FRAME:
                raise _cut(file, at)
            places.append((at + 12, length))
            at += length + _FRAME
    return places


def read_record(file: Path, place: tuple[int, int]) -> bytes:
    """Return a record's data. Raises TraceError where they are not those that were written."""
    offset, size = place
    with file.open("rb") as stream:
        stream.seek(offset)
        data, check = stream.read(size), stream.read(4)
    if len(data) < size or len(check) < 4:
        raise _cut(file, offset)
    if _masked(crc32c(data)) != struct.unpack("<I", check)[0]:
        raise TraceError(
            f"{file}: byte {offset}", "the checksum of this record is not that of its data.",
            fix="download it again",
        )  # fmt: skip
    return data


def parse_example(data: bytes, where: str) -> dict[str, Any]:
    """Feature → its ``Feature`` message of a record. Raises TraceError where it is no Example."""
    from google.protobuf.message import DecodeError

    try:
        example = _example_type().FromString(data)
    except DecodeError:
        raise TraceError(where, "is no tf.train.Example.") from None
    return dict(example.features.feature)


def numbers(feature: Any) -> F64 | None:
    """(n,) the numbers of a feature, flat; None where it has texts instead."""
    kind = feature.WhichOneof("kind")
    if kind == "bytes_list":
        return None
    values = () if kind is None else getattr(feature, kind).value
    return np.fromiter(values, np.float64, len(values))


_EXAMPLE = """
name: "safestage/example.proto" package: "safestage" syntax: "proto3"
message_type { name: "BytesList" field { name: "value" number: 1 type: TYPE_BYTES label: LABEL_REPEATED } }
message_type { name: "FloatList" field { name: "value" number: 1 type: TYPE_FLOAT label: LABEL_REPEATED } }
message_type { name: "Int64List" field { name: "value" number: 1 type: TYPE_INT64 label: LABEL_REPEATED } }
message_type {
  name: "Feature" oneof_decl { name: "kind" }
  field { name: "bytes_list" number: 1 type: TYPE_MESSAGE type_name: ".safestage.BytesList" oneof_index: 0 }
  field { name: "float_list" number: 2 type: TYPE_MESSAGE type_name: ".safestage.FloatList" oneof_index: 0 }
  field { name: "int64_list" number: 3 type: TYPE_MESSAGE type_name: ".safestage.Int64List" oneof_index: 0 }
}
message_type {
  name: "Features"
  field { name: "feature" number: 1 type: TYPE_MESSAGE type_name: ".safestage.Features.FeatureEntry"
          label: LABEL_REPEATED }
  nested_type {
    name: "FeatureEntry" options { map_entry: true }
    field { name: "key" number: 1 type: TYPE_STRING label: LABEL_OPTIONAL }
    field { name: "value" number: 2 type: TYPE_MESSAGE label: LABEL_OPTIONAL type_name: ".safestage.Feature" }
  }
}
message_type {
  name: "Example" field { name: "features" number: 1 type: TYPE_MESSAGE type_name: ".safestage.Features" }
}
"""
"""``tf.train.Example``, whose own definition comes with TensorFlow."""


@cache
def _example_type() -> Any:
    """The class of its messages."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, text_format

    pool = descriptor_pool.DescriptorPool()
    pool.Add(text_format.Parse(_EXAMPLE, descriptor_pb2.FileDescriptorProto()))
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("safestage.Example"))


def crc32c(data: bytes) -> int:
    """CRC-32C of some bytes.

    In as many lanes as each has bytes, side by side: the register is linear over the bits, so what a lane
    leaves is carried over the lanes after it by the map that as many zero bytes have.
    """
    if len(data) < 64:
        register = 0xFFFFFFFF
        for byte in data:
            register = int(_table()[(register ^ byte) & 0xFF]) ^ (register >> 8)
        return register ^ 0xFFFFFFFF
    lanes = 1 << (len(data).bit_length() // 2)
    length = -(-len(data) // lanes)
    padded = np.zeros(lanes * length, np.uint8)  # zeros before the first byte leave a register of 0
    padded[-len(data) :] = np.frombuffer(data, np.uint8)
    padded[-len(data) :][:4] ^= 0xFF
    state: U32 = np.zeros(lanes, np.uint32)
    units = np.arange(256, dtype=np.uint32)
    carry = np.concatenate([units << (8 * k) for k in range(4)])
    for column in padded.reshape(lanes, length).T:
        state = _table()[(state ^ column) & 0xFF] ^ (state >> 8)
        carry = _table()[carry & 0xFF] ^ (carry >> 8)
    while len(state) > 1:
        state = _carried(carry, state[0::2]) ^ state[1::2]
        carry = _carried(carry, carry)
    return int(state[0]) ^ 0xFFFFFFFF


def _carried(carry: U32, state: U32) -> U32:
    """The registers after the zero bytes that ``carry`` (4 × 256, by byte) stands for."""
    parts = [carry[256 * k + (state >> (8 * k) & 0xFF)] for k in range(4)]
    return np.bitwise_xor.reduce(parts)  # type: ignore[no-any-return]


@cache
def _table() -> U32:
    table = np.arange(256, dtype=np.uint32)
    for _ in range(8):
        table = np.where(table & 1, (table >> 1) ^ np.uint32(POLYNOMIAL), table >> 1)
    return table


def _masked(crc: int) -> int:
    return ((crc >> 15 | crc << 17) + MASK) & 0xFFFFFFFF


def _cut(file: Path, at: int) -> TraceError:
    return TraceError(
        f"{file}: byte {at}", "the file ends within this record.", fix="download it again"
    )
