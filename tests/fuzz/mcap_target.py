"""Hostile MCAP files."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterable
from pathlib import Path
from random import Random

import lz4.frame
import zstandard
from damage import HUGE, damaged
from oracle import Sound, judged, sound
from outcome import Outcome
from seeds import recorded, rules
from strange import NAMES, altered, strange
from trace_target import used

from safestage_eval.formats import save
from safestage_eval.formats.mcap.mcap_messages import FRAME

MAGIC = b"\x89MCAP0\r\n"
CHANNEL, MESSAGE, CHUNK, METADATA = 4, 5, 6, 12

Record = tuple[int, bytes]


class Mcap:
    """One file of one episode."""

    name = "MCAP"
    read_by = ("lz4", "zstandard", "protobuf")

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.seeds: list[tuple[bytes, Sound]] = []
        for i, episode in enumerate(recorded()):
            path = folder / f"seed{i}.mcap"
            save(episode, path)
            self.seeds.append((path.read_bytes(), sound(path, rules())))

    def run(self, rng: Random) -> Outcome:
        """One input."""
        data, whole = rng.choice(self.seeds)
        act = rng.choice(_ACTS)
        data, what, is_damage = act(rng, data)
        path = self.folder / "input.mcap"
        path.write_bytes(data)
        what = f"{act.__name__.strip('_')}: {what}"
        outcome = judged(path, whole, what, rules(), damage=is_damage)
        if rng.random() < 0.03:
            used(rng, path, self.folder)
        return outcome


def records(data: bytes, at: int = len(MAGIC)) -> list[Record]:
    """The records from a place on."""
    found = []
    while at + 9 <= len(data):
        size = int.from_bytes(data[at + 1 : at + 9], "little")
        found.append((data[at], data[at + 9 : at + 9 + size]))
        at += 9 + size
    return found


def written(found: list[Record]) -> bytes:
    """Records one after the other."""
    return b"".join(bytes([kind]) + struct.pack("<Q", len(c)) + c for kind, c in found)


def text(value: str) -> bytes:
    """With its length before it."""
    data = value.encode("utf-8", "surrogatepass")
    return struct.pack("<I", len(data)) + data


def _unpacked(chunk: bytes) -> list[Record]:
    size = int.from_bytes(chunk[28:32], "little")
    return records(lz4.frame.decompress(chunk[32 + size + 8 :]), 0)


def _chunk(inside: bytes, compression: str = "lz4", size: int | None = None) -> bytes:
    pack = {"lz4": lz4.frame.compress, "zstd": zstandard.compress, "": bytes}
    packed = pack[compression](inside)
    head = struct.pack("<QQQI", 0, 0, len(inside) if size is None else size, zlib.crc32(inside))
    return head + text(compression) + struct.pack("<Q", len(packed)) + packed


def _all(found: list[Record]) -> bytes:
    return MAGIC + written(found) + MAGIC


def _bytes(rng: Random, data: bytes) -> tuple[bytes, str, bool]:
    """Damage at the edges of records and anywhere."""
    edges, at = [0], len(MAGIC)
    for _, content in records(data):
        edges += [at, at + 1, at + 9]
        at += 9 + len(content)
    hurt, what = damaged(rng, data, [e for e in edges if e < len(data)])
    return hurt, what, True


def _order(rng: Random, data: bytes) -> tuple[bytes, str, bool]:
    """Records gone, twice, or exchanged."""
    found = records(data[: -len(MAGIC)])
    at = rng.randrange(len(found))
    act = rng.choice(("gone", "twice", "swap", "cut", "kind"))
    what = f"record {at} of kind {found[at][0]} {act}"
    if act == "gone":
        del found[at]
    elif act == "twice":
        found.insert(at, found[at])
    elif act == "cut":
        found = found[:at]
    elif act == "kind":
        found[at] = rng.randrange(16), found[at][1]
    else:
        other = rng.randrange(len(found))
        found[at], found[other] = found[other], found[at]
    return _all(found), what, True


def _inside(rng: Random, data: bytes) -> tuple[bytes, str, bool]:
    """The records in a chunk, of which the checksum is right again."""
    found = records(data[: -len(MAGIC)])
    place = rng.choice([i for i, (kind, _) in enumerate(found) if kind == CHUNK])
    inside = _unpacked(found[place][1])
    act = rng.choice(("gone", "twice", "swap", "bytes", "number", "channel", "size"))
    at = rng.randrange(len(inside))
    kind, content = inside[at]
    raw = None
    if act == "gone":
        del inside[at]
    elif act == "twice":
        inside.insert(at, inside[at])
    elif act == "swap":
        other = rng.randrange(len(inside))
        inside[at], inside[other] = inside[other], inside[at]
    elif act in ("bytes", "number"):
        content, _ = damaged(rng, content, [22, 23, 24, 30, 60] if kind == MESSAGE else [0, 2, 4])
        inside[at] = kind, content
    elif act == "channel":
        inside[at] = kind, struct.pack("<H", rng.choice((0, 1, 2, 3, 4, 5, 65535))) + content[2:]
    else:
        raw = bytearray(written(inside))
        before = len(written(inside[:at]))
        raw[before + 1 : before + 9] = struct.pack("<Q", rng.choice(HUGE) & 2**64 - 1)
    packing = rng.choice(("lz4", "zstd", ""))
    found[place] = CHUNK, _chunk(written(inside) if raw is None else bytes(raw), packing)
    return _all(found), f"{act} of kind {kind}, {packing}", False


def _floats(rng: Random, data: bytes) -> tuple[bytes, str, bool]:
    """Numbers of a frame that are none, in otherwise sound bytes."""
    found = records(data[: -len(MAGIC)])
    place = rng.choice([i for i, (kind, _) in enumerate(found) if kind == CHUNK])
    inside = _unpacked(found[place][1])
    places = [i for i, (kind, c) in enumerate(inside) if kind == MESSAGE and len(c) > 100]
    at = rng.choice(places)
    kind, content = inside[at]
    where = rng.randrange(44, len(content) - 4)
    value = rng.choice((float("nan"), float("inf"), -float("inf"), 3e38, -1e30, 1e-45))
    content = content[:where] + struct.pack("<f", value) + content[where + 4 :]
    inside[at] = kind, content
    found[place] = CHUNK, _chunk(written(inside))
    return _all(found), f"{value} at {where} of message {at}", False


def _texts(content: bytes) -> tuple[bytes, dict[str, str]]:
    """Head of the metadata record, and its texts."""
    size = int.from_bytes(content[:4], "little")
    at, end, texts = 4 + size + 4, len(content), {}
    while at < end:
        pair = []
        for _ in range(2):
            n = int.from_bytes(content[at : at + 4], "little")
            pair.append(content[at + 4 : at + 4 + n].decode("utf-8", "replace"))
            at += 4 + n
        texts[pair[0]] = pair[1]
    return content[: 4 + size], texts


def _metadata(head: bytes, texts: dict[str, str]) -> Record:
    pairs = b"".join(text(k) + text(v) for k, v in texts.items())
    return METADATA, head + struct.pack("<I", len(pairs)) + pairs


def _unsealed(rng: Random, data: bytes) -> tuple[bytes, str, bool]:
    """Remove content hash and digests, so that no checksum reports the change."""
    data, what, _ = rng.choice((_stretch, _stretch, _stretch, _header, _inside, _floats))(rng, data)
    found = records(data[: -len(MAGIC)])
    place = next(i for i, (kind, _) in enumerate(found) if kind == METADATA)
    head, texts = _texts(found[place][1])
    for key in ("content_hash", "digests", "checksum"):
        texts.pop(key, None)
    found[place] = _metadata(head, texts)
    return _all(found), what, False


def _stretch(rng: Random, data: bytes) -> tuple[bytes, str, bool]:
    """Remove or change some numbers of consecutive frames."""
    found = records(data[: -len(MAGIC)])
    chunks = {i: _unpacked(content) for i, (kind, content) in enumerate(found) if kind == CHUNK}
    frames = [
        (inside, i)
        for inside in chunks.values()
        for i, (kind, content) in enumerate(inside)
        if kind == MESSAGE and content[:2] == _channel(chunks.values())
    ]
    first = rng.randrange(len(frames))
    last = first + 1 + int(rng.random() ** 2 * len(frames))
    start, size = rng.choice(_packed(frames[0][0][frames[0][1]][1]))
    width = min(rng.choice((1, 3, 24)), size // 4)
    begin = start + 4 * rng.randrange(size // 4 - width + 1)
    value = rng.choice((float("nan"), float("nan"), 0.0, 1.0))
    row = struct.pack("<f", value) * width
    for inside, i in frames[first:last]:
        content = inside[i][1]
        inside[i] = MESSAGE, content[:begin] + row + content[begin + len(row) :]
    for place, inside in chunks.items():
        found[place] = CHUNK, _chunk(written(inside))
    return _all(found), f"{width} x {value} at {begin} of frames {first} to {last}", False


def _packed(message: bytes) -> list[tuple[int, int]]:
    """Where the lists of numbers of a frame begin, and how many bytes they have."""
    found, at = [], 22
    while at < len(message):
        at, kind = at + 1, message[at] & 7
        if kind == 1:
            at += 8
            continue
        size = message[at] & 127
        if message[at] > 127:
            at, size = at + 1, size | message[at + 1] << 7
        found.append((at + 1, size))
        at += 1 + size
    return [(start, size) for start, size in found if size >= 4]


def _channel(chunks: Iterable[list[Record]]) -> bytes:
    """First two bytes of each of the frames' messages."""
    for inside in chunks:
        for kind, content in inside:
            if kind == CHANNEL and content[8 : 8 + len(FRAME)] == FRAME.encode():
                return content[:2]
    raise ValueError("no frames")


def _header(rng: Random, data: bytes) -> tuple[bytes, str, bool]:
    """A strange value in the header, or in what stands beside it."""
    found = records(data[: -len(MAGIC)])
    place = next(i for i, (kind, _) in enumerate(found) if kind == METADATA)
    head, texts = _texts(found[place][1])
    key = "header" if rng.random() < 0.8 else rng.choice(list(texts))
    try:
        tree, what = altered(rng, json.loads(texts[key]))
        texts[key] = json.dumps(tree)
    except ValueError:
        texts[key], what = str(strange(rng, texts[key])), "text"
    if rng.random() < 0.03:
        texts[key], what = "[" * 100_000, "deep"
    texts.pop("checksum", None)
    found[place] = _metadata(head, texts)
    return _all(found), f"{key}: {what}", False


def _bomb(rng: Random, data: bytes) -> tuple[bytes, str, bool]:
    """Chunks that claim, or come to, much more than they are."""
    found = records(data[: -len(MAGIC)])
    place = rng.choice([i for i, (kind, _) in enumerate(found) if kind == CHUNK])
    compression = rng.choice(("lz4", "zstd"))
    claim = rng.choice((None, 0, 100, 2**31, 2**40, 2**63))
    zeros = bytes(rng.choice((10**4, 10**7)))
    found[place] = CHUNK, _chunk(zeros, compression, claim)
    return _all(found), f"{len(zeros)} zeros as {claim}, {compression}", claim is not None


def _names(rng: Random, data: bytes) -> tuple[bytes, str, bool]:
    """Attachments and topics with other names."""
    found = records(data[: -len(MAGIC)])
    places = [i for i, (kind, _) in enumerate(found) if kind in (9, CHANNEL)]
    at = rng.choice(places)
    kind, content = found[at]
    begin = 16 if kind == 9 else 4
    size = int.from_bytes(content[begin : begin + 4], "little")
    name = rng.choice(NAMES)
    content = content[:begin] + text(name) + content[begin + 4 + size :]
    if kind == 9:
        content = content[:-4] + struct.pack("<I", zlib.crc32(content[:-4]))
    found[at] = kind, content
    return _all(found), f"kind {kind} named {name[:20]!r}", False


_ACTS = (
    _bytes, _bytes, _bytes, _bytes, _order, _order, _inside, _inside, _inside, _floats, _header,
    _header, _bomb, _names, _unsealed, _unsealed, _unsealed, _unsealed,
)  # fmt: skip
