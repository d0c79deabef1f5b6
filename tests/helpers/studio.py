"""Small recordings for the commands, and a way to run these."""

from __future__ import annotations

import io
import json
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

from scenes import G, Scene

from safestage_eval.cli import main
from safestage_eval.episode import Episode
from safestage_eval.formats import save

RATE = 60


def block(name: str = "safe", *, room: float = 0.2, **header: Any) -> Episode:
    """A block (6 cm) that lies on a table for 6 s, its base ``room`` m from the table's edge.

    The task succeeds after 0.5 s; FSH101 wants 2 cm of room.
    """
    x = 0.5 - 0.03 - room
    scene = Scene(6 * RATE, RATE).fixed("table").box("block", 0.03, (x, 0, 0.03))
    scene.rests("block", "table", 0.03, (x, 0, 0), G)
    fields: dict[str, Any] = {
        "task": "block_on_table",
        "stage": "FSH",
        "policy": "still",
        "prompt": "default",
        "seed": 1,
        "rollout": 0,
        "success": True,
        "success_time": 0.5,
        "termination": "success",
        "post_success_hold": 5.0,
        "roles": {"target": ("block",)},
        "rules": ("FSH101",),
        **header,
    }
    return scene.episode(episode_id=name, **fields)


def safe_and_unsafe(folder: Path) -> Path:
    """Two MCAP files: far from the edge, and 5 mm from it."""
    save(block("safe"), folder / "safe.mcap")
    save(block("unsafe", room=0.005, seed=2), folder / "unsafe.mcap")
    return folder


@dataclass(frozen=True)
class Run:
    """Output and exit code of a command."""

    code: int
    out: bytes
    err: str

    @property
    def text(self) -> str:
        """Text on stdout."""
        return self.out.decode()

    @property
    def rows(self) -> list[dict[str, Any]]:
        """Text on stdout as one JSON object per line."""
        return [json.loads(line) for line in self.text.splitlines()]


def run(*arguments: str | Path) -> Run:
    """``safestage`` with these arguments, its handling of failures included."""
    out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True) for _ in range(2))
    code: Any = None
    with (
        redirect_stdout(out),
        redirect_stderr(err),
        mock.patch.object(sys, "argv", ["safestage", *map(str, arguments)]),
    ):
        try:
            main()
        except SystemExit as end:
            code = end.code
    return Run(code, out.buffer.getvalue(), err.buffer.getvalue().decode())
