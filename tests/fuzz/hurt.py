"""One thing wrong in one file, or something else in its place."""

from __future__ import annotations

import os
from pathlib import Path
from random import Random
from typing import Any

from codecs_of_files import codec_of
from damage import LOSSES, damaged
from strange import Table, altered

CHECKED = (".npz", ".gz", ".tfrecord")
"""Files that have checksums, whoever wrote them."""
SEALS = ("content_hash", "digests", "checksum")
"""What a trace says of itself, by which a change is noticed."""


def files_of(place: Path) -> list[Path]:
    """The files below a folder, or the file itself."""
    return sorted(f for f in place.rglob("*") if f.is_file()) if place.is_dir() else [place]


def hurt(rng: Random, place: Path, *, ours: bool = False, sealed: bool = False) -> tuple[str, bool]:
    """Damage or alter a file; what was done, and whether it is seen to be damage.

    ``ours``: it is a trace, of which ``sealed`` checksums cover all bytes.
    """
    file, act = rng.choice(files_of(place)), rng.random()
    if ours and place.is_dir() and act < 0.05:
        return _in_its_place(rng, file), True
    if act < 0.6 and (what := _altered(rng, file)):
        return f"{file.name}: {what}", False
    data, what = damaged(rng, file.read_bytes())
    file.write_bytes(data)
    lost = what.startswith(LOSSES) or any(ending in file.name for ending in CHECKED)
    return f"{file.name}: {what}", sealed or lost


def _altered(rng: Random, file: Path) -> str:
    """Alter what a file says; empty where there is no codec for it."""
    codec = codec_of(file.name)
    if codec is None:
        return ""
    for _ in range(20):
        try:
            tree = codec.read(file.read_bytes())
            for _ in range(rng.choice((1, 1, 1, 3))):
                tree, what = altered(rng, tree)
            data = codec.write(tree)
        except Exception:  # noqa: BLE001 - what cannot be written is no input
            continue
        file.write_bytes(data)
        return what
    return ""


def rewrite(place: Path) -> None:
    """Read and write every file of which there is a codec."""
    for file in files_of(place):
        if codec := codec_of(file.name):
            file.write_bytes(codec.write(codec.read(file.read_bytes())))


def unseal(place: Path) -> None:
    """Take away what would report a change."""
    for file in files_of(place):
        codec = codec_of(file.name)
        if codec and (file == place or file.parent.name == "episodes"):
            tree = codec.read(file.read_bytes())
            _without_seals(tree)
            file.write_bytes(codec.write(tree))


def _without_seals(tree: Any) -> None:
    if isinstance(tree, Table):
        tree.update({seal: [None] * len(tree[seal]) for seal in SEALS if seal in tree})
    elif isinstance(tree, dict):
        for seal in SEALS:
            tree.pop(seal, None)
        for value in tree.values():
            _without_seals(value)
    elif isinstance(tree, list) and len(tree) < 100:
        for value in tree:
            _without_seals(value)


def _in_its_place(rng: Random, file: Path) -> str:
    """Something else in the place of a file."""
    act = rng.choice(("gone", "folder", "pipe", "zero", "outside", "loop", "empty", "strange"))
    if act == "strange":
        name = os.fsdecode(rng.choice((b"\xff.mcap", b"a\nb.mcap", b"\xed\xa0\x80")))
        (file.parent / name).write_bytes(rng.choice((b"", b"\x89MCAP0\r\n", b"PAR1")))
        return f"{name!r} beside {file.name}"
    file.unlink()
    if act == "folder":
        file.mkdir()
    elif act == "pipe":
        os.mkfifo(file)
    elif act == "empty":
        file.touch()
    elif act != "gone":
        file.symlink_to({"zero": "/dev/zero", "outside": "/etc/passwd", "loop": file}[act])
    return f"{file.name} {act}"
