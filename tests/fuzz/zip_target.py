"""Hostile ZIP files of the recorder for other simulators."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from damage import damaged
from oracle import Sound, judged, sound
from outcome import Outcome
from seeds import recorded, rules
from strange import NAMES, altered
from trace_target import used
from zipped import written

from safestage_eval.formats.zip_reader import HEADER

Members = dict[str, bytes]

KINDS = ("<f4", "<f8", "<i8", "|O", "|b1", "<M8[s]", "|V4", "<c8", "<U1000000000", ">f4", "|S1")
SHAPES = (
    "()",
    "(0,)",
    "(-1,)",
    "(2**40, 3)",
    f"({2**62}, 4)",
    "(1, 1, 1, 1)",
    "3",
    "[3]",
    "(True,)",
)
SYNTAX = (
    "{", "{'descr': '<f4'", "('", "\\", "{'a' 'b'}", "'''", "é" * 30, "\0", "(" * 2000, "1 if x else",
    "{'descr': __import__('os'), 'fortran_order': False, 'shape': (1,), }", "0777", "\t\n x", "$",
    "{'descr': '<f4', 'fortran_order': 1, 'shape': (3,), }", "1" * 5000, "\x0c", "9L", "{**1}",
)  # fmt: skip
"""Headers of NumPy's format that are none."""


class Zipped:
    """One file of one episode."""

    name = "recorder's ZIP"
    read_by = ("numpy",)

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.seeds: list[tuple[bytes, Sound]] = []
        for i, episode in enumerate(recorded()):
            path = written(episode, folder / f"seed{i}.zip")
            self.seeds.append((path.read_bytes(), sound(path, rules())))

    def run(self, rng: Random) -> Outcome:
        """One input."""
        data, whole = rng.choice(self.seeds)
        act = rng.choice(_ACTS)
        data, what, is_damage = act(rng, data)
        path = self.folder / "input.zip"
        path.write_bytes(data)
        what = f"{act.__name__.strip('_')}: {what}"
        outcome = judged(path, whole, what, rules(), damage=is_damage)
        if rng.random() < 0.03:
            used(rng, path, self.folder)
        return outcome


def members(data: bytes) -> Members:
    """Name -> content."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def packed(parts: Members, *, packing: int = zipfile.ZIP_STORED, twice: str = "") -> bytes:
    """A ZIP file of them, whose checksums are right."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", packing) as archive:
        for name, content in parts.items():
            archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), content, packing)
            if name == twice:
                archive.start_dir = archive.fp.tell()
                archive.writestr(zipfile.ZipInfo(name + "x", (1980, 1, 1, 0, 0, 0)), content[::-1])
    return (
        out.getvalue().replace(f"{twice}x".encode(), f"{twice}".encode())
        if twice
        else out.getvalue()
    )


def array(content: bytes) -> np.ndarray[Any, Any]:
    """A member as an array that can be changed."""
    return np.lib.format.read_array(io.BytesIO(content)).copy()


def npy(values: np.ndarray[Any, Any]) -> bytes:
    """An array as a member."""
    out = io.BytesIO()
    np.lib.format.write_array(out, values, version=(1, 0), allow_pickle=True)
    return out.getvalue()


def _bytes(rng: Random, data: bytes) -> tuple[bytes, str, bool]:
    """Damage at the edges of members, in the directory, and anywhere."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        edges = [info.header_offset for info in archive.infolist()]
        directory = archive.start_dir
    edges += [edge + more for edge in edges for more in (4, 14, 18, 26, 28, 30, 60)]
    edges += [directory, len(data) - 22, len(data) - 6] * 10
    edges += [rng.randrange(directory, len(data)) for _ in range(60)]
    hurt, what = damaged(rng, data, [edge for edge in edges if edge < len(data)])
    return hurt, what, True


def _header(rng: Random, data: bytes) -> tuple[bytes, str, bool]:
    """A strange value in the JSON header."""
    parts = members(data)
    tree, what = altered(rng, json.loads(parts[HEADER]))
    try:
        text = json.dumps(tree).encode()
    except (ValueError, RecursionError):
        text, what = b"[" * 100_000, "deep"
    return packed(parts | {HEADER: text}), what, False


def _numbers(rng: Random, data: bytes) -> tuple[bytes, str, bool]:
    """A stretch of an array's numbers is not there, or says something else."""
    parts = members(data)
    name = rng.choice([n for n in parts if n.endswith(".npy") and not n.startswith("mesh/")])
    values = array(parts[name])
    flat = values.reshape(-1).view(np.float32 if values.dtype.names else values.dtype)
    if not flat.size:
        return data, f"{name} is empty", False
    first = rng.randrange(flat.size)
    last = first + 1 + int(rng.random() ** 4 * flat.size)
    value: float = rng.choice((np.nan, np.nan, np.nan, 0.0, np.inf, 3e38, -1.0, rng.gauss(0, 1)))
    if flat.dtype.kind == "i":
        value = rng.choice((0, -1, 1, 2**31, 2**62))
    flat[first:last] = value
    return packed(parts | {name: npy(values)}), f"{name}[{first}:{last}] = {value:g}", False


def _frames(rng: Random, data: bytes) -> tuple[bytes, str, bool]:
    """The last frames, or some in the midst, are in no array."""
    parts = members(data)
    about = json.loads(parts[HEADER])
    frames = about["frames"]
    keep = np.ones(frames, bool)
    first = rng.randrange(1, frames)
    keep[first : frames if rng.random() < 0.4 else first + 1 + int(rng.random() ** 3 * frames)] = (
        False
    )
    moving = ("position", "orientation", "linear_velocity", "angular_velocity")
    counts = array(parts["counts.npy"])
    changed = {"counts.npy": npy(counts[keep])}
    changed["contacts.npy"] = npy(array(parts["contacts.npy"])[np.repeat(keep, counts)])
    for name in ("t", *ROBOT):
        changed[f"{name}.npy"] = npy(array(parts[f"{name}.npy"])[keep])
    for name in moving:
        changed[f"{name}.npy"] = npy(np.ascontiguousarray(array(parts[f"{name}.npy"])[:, keep]))
    about["frames"] = int(keep.sum())
    changed[HEADER] = json.dumps(about).encode()
    return packed(parts | changed), f"{keep.sum()} of {frames} frames, gone from {first}", False


ROBOT = ("joint_position", "joint_velocity", "joint_torque", "action", "gripper")


def _shapes(rng: Random, data: bytes) -> tuple[bytes, str, bool]:
    """An array's own header says something else, or nothing that could be read."""
    parts = members(data)
    name = rng.choice([n for n in parts if n.endswith(".npy")])
    content = parts[name]
    size = int.from_bytes(content[8:10], "little")
    text = content[10 : 10 + size].decode("latin-1")
    act = rng.choice(("kind", "shape", "syntax", "syntax", "bytes", "version", "fortran"))
    if act == "kind":
        text = text.replace(text.split("'")[3], rng.choice(KINDS))
    elif act == "shape":
        at = text.index("(")
        text = text[:at] + rng.choice(SHAPES) + text[text.index(")", at) + 1 :]
    elif act == "syntax":
        text = rng.choice(SYNTAX) if rng.random() < 0.5 else _spoilt(rng, text)
    elif act == "fortran":
        text = text.replace("False", "True")
    raw = text.encode("latin-1", "replace")
    head = (
        content[:6] + bytes([rng.choice((0, 1, 2, 3, 255)), 0]) if act == "version" else content[:8]
    )
    if act == "bytes":
        raw = damaged(rng, raw)[0]
    made = head + struct.pack("<H", len(raw) & 0xFFFF) + raw + content[10 + size :]
    return packed(parts | {name: made}), f"{name} {act} {raw[:60]!r}", False


def _spoilt(rng: Random, text: str) -> str:
    """Python that is none any more."""
    at = rng.randrange(len(text))
    return text[:at] + rng.choice(SYNTAX)[:5] + text[at + rng.choice((0, 1, 5, 50)) :]


def _members(rng: Random, data: bytes) -> tuple[bytes, str, bool]:
    """Members gone, renamed, exchanged, compressed, twice, or of another length."""
    parts = members(data)
    name, other = rng.choice(list(parts)), rng.choice(list(parts))
    act = rng.choice(("gone", "renamed", "exchanged", "packed", "twice", "cut", "longer", "first"))
    if act == "gone":
        del parts[name]
    elif act == "renamed":
        parts[rng.choice([n for n in NAMES if n and "\ud800" not in n])] = parts.pop(name)
    elif act == "exchanged":
        parts[name], parts[other] = parts[other], parts[name]
    elif act == "packed":
        packing = rng.choice((zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA))
        return packed(parts, packing=packing), f"packed {packing}", False
    elif act == "twice":
        return packed(parts, twice=name), f"{name} twice", False
    elif act == "cut":
        parts[name] = parts[name][: rng.randrange(len(parts[name]) + 1)]
    elif act == "longer":
        parts[name] += bytes(rng.choice((1, 4, 4096)))
    else:
        parts = {name: parts.pop(name), **parts}
    return packed(parts), f"{name} {act}", False


def _bomb(rng: Random, data: bytes) -> tuple[bytes, str, bool]:
    """A member that is, or claims to be, much more than it was."""
    parts = members(data)
    name = rng.choice([n for n in parts if n.endswith(".npy")])
    if rng.random() < 0.3:
        parts[name] = npy(np.zeros(rng.choice((10**5, 10**7)), np.float32))
        return packed(parts, packing=zipfile.ZIP_DEFLATED), f"{name} zeros", False
    whole = bytearray(packed(parts))
    at = whole.rindex(name.encode()) - 46
    place = rng.choice((20, 24, 42))  # packed size, size, where it begins
    whole[at + place : at + place + 4] = struct.pack("<I", rng.choice((0, 1, 2**31, 2**32 - 1)))
    return bytes(whole), f"{name} claims at {place}", True


_ACTS = (
    _bytes, _bytes, _bytes, _header, _header, _header, _numbers, _numbers, _numbers, _numbers, _frames,
    _shapes, _shapes, _members, _bomb,
)  # fmt: skip
