"""Every command in docs/tutorials is executed, and every line that is shown is printed."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from contextvars import copy_context
from pathlib import Path

import pytest
from studio import run

CHECKOUT = Path(__file__).resolve().parents[2]
TUTORIALS = sorted((CHECKOUT / "docs" / "tutorials").glob("*.md"))
FENCE = re.compile(r"^```([^\n`]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
INSTALLS = {
    "git clone https://github.com/safestage/safestage && cd safestage",
    "pip install .",
    "pip install ./recorder mujoco",
    "pip install pytest",
}
"""Packages that a tutorial may install; the environment of the tests has them."""

pytestmark = pytest.mark.slow


class Reader:
    """Somebody who does what a page says, in an empty folder with traces/ in it.

    A block ``title="FILE"`` is saved, one with ``append="FILE"`` added to it; of ``console`` the lines
    that begin with ``$`` are typed, and the others must be printed. ``…`` stands for any text.
    """

    def __init__(self) -> None:
        self.printed = ""
        self.code = 0

    def reads(self, page: str) -> None:
        for kind, text in FENCE.findall(page):
            file = re.search(r'(title|append)="([^"]+)"', kind)
            language = kind.split(" ")[0]
            if file is not None:
                Path(file[2]).parent.mkdir(parents=True, exist_ok=True)
                with Path(file[2]).open("w" if file[1] == "title" else "a", encoding="utf-8") as f:
                    f.write(text)
                if language == "yaml":
                    self.runs_jobs(text)
            elif language == "console":
                self.types(text)
            elif language == "bash":
                assert {*text.splitlines()} <= INSTALLS
            else:
                assert language == "", f"nobody executes {language}"

    def types(self, block: str) -> None:
        for typed in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
            command, _, shown = typed.partition("\n")
            if command == "echo $?":
                assert shown.strip() == str(self.code)
                continue
            self.does(command)
            assert self.code in (0, 1), f"{command}\n{self.printed}"
            compare(command, shown, self.printed)

    def runs_jobs(self, workflow: str) -> None:
        for command in re.findall(r"^\s+- run: (safestage.*)$", workflow, re.MULTILINE):
            self.does(command)
            assert self.code == 0, self.printed

    def does(self, command: str) -> None:
        program, *arguments = shlex.split(command)
        if program in ("safestage", "safestage-score"):
            score = ["score"] if program == "safestage-score" else []
            done = run(*score, *arguments)
            self.printed, self.code = done.text + done.err, done.code or 0
            return
        paths = [str(CHECKOUT), str(CHECKOUT / "recorder")]
        ended = subprocess.run(
            [sys.executable if program == "python" else program, *arguments],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
            capture_output=True,
            text=True,
            check=False,
        )
        self.printed, self.code = ended.stdout + ended.stderr, ended.returncode


def compare(command: str, shown: str, printed: str) -> None:
    """Lines that are shown are printed, and in this order."""
    at = 0
    lines = [line.rstrip() for line in printed.splitlines()]
    for line in shown.splitlines():
        if line.strip() in ("", "…"):
            continue
        like = re.compile(".*".join(re.escape(part) for part in line.rstrip().split("…")))
        found = [i for i in range(at, len(lines)) if like.fullmatch(lines[i])]
        assert found, f"{command}\nprints no line\n{line}\nafter line {at} of\n{printed}"
        at = found[0] + 1


def test_a_line_that_is_not_printed_is_noticed():
    compare("x", "a…c\n…\nd\n", "abc\nb\nd\n")
    with pytest.raises(AssertionError, match="prints no line"):
        compare("x", "d\nabc\n", "abc\nb\nd\n")


@pytest.mark.parametrize("page", TUTORIALS, ids=lambda page: page.stem)
def test_a_tutorial_does_what_it_says(page, tmp_path, monkeypatch):
    if "import mujoco" in page.read_text("utf-8"):
        pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    (tmp_path / "traces").symlink_to(CHECKOUT / "traces")
    # a command sets the width of lines for the rest of its context
    copy_context().run(Reader().reads, page.read_text("utf-8"))
