"""Installs the wheel as users do, on every Python that is here and in hard places, and scores traces/ in each.

    python tests/package/install_matrix.py --write docs/reliability.md
    python tests/package/install_matrix.py --only 3.13       # cells whose name has this in it

Needs Linux and PyPI; `uv` is taken from PyPI where it is not installed. Hard places need the right to make a
mount namespace and to become somebody else; a cell that cannot be made says so. Exit code 1: a cell
differs from ``traces/golden.json``.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
SHOWN = ("numpy", "scipy", "pyarrow")
MARKS = ("<!-- installs -->\n", "<!-- end of installs -->\n")
LIMIT = 900
"""s for a cell."""
NOBODY = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]
OUTSIDE = Path("/opt")
"""Where environments are made if possible: one of the places has no /tmp."""
EMPTY = "mount -t tmpfs -o ro,size=4k tmpfs"


@dataclass(frozen=True)
class Place:
    """Where a wheel is installed and run.

    Attributes:
        name: for the table.
        before: commands of a shell in a mount namespace of its own; ``{venv}`` is filled in.
        words: what the command is given to, to be run as somebody else.
        without: variables that are not set.
        folder: name of the folder that all of it lies in.
    """

    name: str
    before: str = ""
    words: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    folder: str = "plain"


PLACES = (
    Place("without a home", words=tuple(NOBODY), without=("HOME", "XDG_CACHE_HOME", "USER", "LOGNAME")),
    Place(
        "without /tmp", before=f"{EMPTY} /tmp && {EMPTY} /var/tmp && {EMPTY} /dev/shm",
        without=("TMPDIR", "TEMP", "TMP"),
    ),
    Place("not root", words=tuple(NOBODY)),
    Place(
        "package read-only, nothing writable for a cache",
        before="mount --bind {venv} {venv} && mount -o remount,bind,ro {venv}",
        words=tuple(NOBODY), without=("HOME", "XDG_CACHE_HOME"),
    ),
    Place("paths that are no ASCII, locale C", folder="Wörter и 場所 x", without=("LANG", "LC_ALL")),
)  # fmt: skip


class NoSuchPlaceError(Exception):
    """A place that cannot be made here."""


def run(words: list[str], **more: object) -> str:
    """Return the output of a command. Raises RuntimeError with its last lines if it fails."""
    done = subprocess.run(
        words, capture_output=True, text=True, errors="replace", timeout=LIMIT, check=False, **more
    )
    if done.returncode:
        raise RuntimeError(
            f"exit code {done.returncode}: {(done.stdout + done.stderr).strip()[-600:]}"
        )
    return done.stdout


def uv_of(folder: Path) -> str:
    """The program, from PyPI where it is not there."""
    if found := shutil.which("uv"):
        return found
    venv.create(folder / "uv", with_pip=True)
    run([str(folder / "uv/bin/python"), "-m", "pip", "install", "-q", "uv"])
    return str(folder / "uv/bin/uv")


def python_of(minor: str) -> str | None:
    """An interpreter of this version that everybody may run, or one that only we may."""
    named = [f"/usr/bin/python{minor}", f"/usr/local/bin/python{minor}"]
    named += sorted(map(str, Path.home().glob(f".pyenv/versions/{minor}.*/bin/python")))
    named += [found] if (found := shutil.which(f"python{minor}")) else []
    for name in named:
        if Path(name).exists() and _says(name) == minor:
            return name
    return None


def _says(python: str) -> str:
    code = "import sys; print('%d.%d' % sys.version_info[:2])"
    done = subprocess.run([python, "-c", code], capture_output=True, text=True, check=False)
    return done.stdout.strip()


def installed(uv: str, python: str, wheel: Path, folder: Path, *, lowest: bool) -> Path:
    """An environment with the wheel and nothing but what it asks for."""
    made = folder / "venv"
    run([uv, "venv", "-q", "--clear", "--python", python, str(made)])
    words = [
        uv,
        "pip",
        "install",
        "-q",
        "--python",
        str(made / "bin/python"),
        "--only-binary",
        ":all:",
    ]
    if lowest:  # asked for by name too: only what is asked for directly is taken at its lowest
        words += ["--resolution", "lowest-direct", "-r", str(ROOT / "pyproject.toml")]
    run([*words, str(wheel)])
    return made


def within(place: Place, made: Path, words: list[str]) -> list[str]:
    """The words of a command in a place."""
    words = [*place.words, *words]
    if place.before:
        script = f'{place.before.format(venv=made)} && exec "$@"'
        words = ["unshare", "-m", "sh", "-c", script, "sh", *words]
    return words


def scored(made: Path, folder: Path, place: Place) -> None:
    """Score the traces in a place.

    Raises:
        NoSuchPlaceError: it cannot be made.
        RuntimeError: a verdict is not the expected one.
    """
    try:
        run(within(place, made, ["true"]))
    except (RuntimeError, OSError) as error:
        raise NoSuchPlaceError(error) from None
    shutil.copytree(ROOT / "traces", folder / "traces", dirs_exist_ok=True)
    shutil.copytree(ROOT / "rules", folder / "rules", dirs_exist_ok=True)
    (folder / "empty").mkdir(exist_ok=True)
    if place.words:
        run(["chmod", "-R", "a+rX", str(folder)])
    words = [
        str(made / "bin/python"), "-I", str(made / "bin/safestage-score"), str(folder / "traces"),
        "--rules", str(folder / "rules"), "--golden", str(folder / "traces/golden.json"), "-j", "1",
    ]  # fmt: skip
    dropped = {
        "PYTHONPATH",
        "NUMBA_CACHE_DIR",
        "VIRTUAL_ENV",
        "PYTHONPYCACHEPREFIX",
        *place.without,
    }
    env = {name: value for name, value in os.environ.items() if name not in dropped}
    said = run(within(place, made, words), cwd=folder / "empty", env=env)
    if "FSH101" not in said and "episodes" not in said:
        raise RuntimeError(f"nothing was scored: {said[-300:]}")


def versions(made: Path) -> str:
    """Checks of the most important parts."""
    code = f"from importlib.metadata import version as v; print(', '.join(f'{{n}} {{v(n)}}' for n in {SHOWN}))"
    return run([str(made / "bin/python"), "-c", code]).strip()


def musl(uv: str) -> str:
    """Requirements without wheels for musl; empty if everything has one."""
    lacking = []
    text = (ROOT / "pyproject.toml").read_text("utf-8")
    needed = re.findall(r'^  "([a-z-]+)', text.split("dependencies = [")[1].split("]\n")[0], re.M)
    for name in needed:
        words = [uv, "pip", "compile", "-q", "--only-binary", ":all:", "--no-deps", "--python-version",
                 "3.12", "--python-platform", "x86_64-unknown-linux-musl", "-"]  # fmt: skip
        low = re.search(rf'"({name}>=[^";]*)', text)
        asked = low[1] if low else name
        if subprocess.run(
            words, input=asked, capture_output=True, text=True, check=False
        ).returncode:
            lacking.append(name)
    return f"no wheels of {', '.join(lacking)}" if lacking else ""


class Table:
    """Cells by their names, and the page that has them; a cell that is tried again is replaced."""

    def __init__(self, page: Path | None) -> None:
        """Take over what the page has."""
        self._page, self.failed = page, False
        self._cells: dict[tuple[str, ...], tuple[str, ...]] = {}
        if page is not None:
            inside = page.read_text("utf-8").split(MARKS[0])[1].split(MARKS[1])[0]
            for line in inside.splitlines()[2:]:
                row = tuple(part.strip() for part in line.strip("|").split("|"))
                self._cells[row[:3]] = row

    def add(self, *row: str) -> None:
        """A cell, and the page anew."""
        self._cells[row[:3]] = row
        self.failed |= row[3] == "FAILS"
        sys.stderr.write(f"{row}\n")
        if self._page is not None:
            head, rest = self._page.read_text("utf-8").split(MARKS[0])
            text = f"{head}{MARKS[0]}{self}{MARKS[1]}{rest.split(MARKS[1])[1]}"
            self._page.write_text(text, "utf-8")

    def __str__(self) -> str:
        """Render as Markdown."""
        heads = ("Python", "dependencies", "place", "verdicts", "with", "took")
        lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
        rows = [self._cells[key] for key in sorted(self._cells, key=_order)]
        return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)]) + "\n"


def _order(key: tuple[str, ...]) -> tuple[int, str, int]:
    places = ["plain", *(place.name for place in PLACES), "musl"]
    return places.index(key[2]), key[0], ("newest", "lowest").index(key[1])


def cell(told: Table, names: tuple[str, str, str], work: Callable[[], str]) -> None:
    """One row: its names, versions, and what came of it."""
    began = time.monotonic()
    try:
        said = ("as expected", work())
    except NoSuchPlaceError as error:
        said = ("not tried", _last_line(error))
    except (RuntimeError, subprocess.TimeoutExpired) as error:
        sys.stderr.write(f"{names}: {error}\n")
        said = ("FAILS", _last_line(error))
    told.add(*names, *said, f"{time.monotonic() - began:.0f} s")


def _last_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[-1].strip()[:160].replace("|", "/") if lines else type(error).__name__


def matrix(folder: Path, only: str, told: Table) -> None:
    """All cells, or those whose names have a text in them."""
    uv = uv_of(folder)
    run([uv, "build", "-q", "--wheel", "--out-dir", str(folder / "dist"), str(ROOT)])
    [wheel] = (folder / "dist").glob("*.whl")
    plain = Place("plain")

    def fresh(python: str, place: Place, *, lowest: bool = False) -> str:
        inside = folder / "cell" / place.folder
        inside.mkdir(parents=True)
        try:
            made = installed(uv, python, wheel, inside, lowest=lowest)
            scored(made, inside, place)
            return versions(made)
        finally:
            shutil.rmtree(folder / "cell", ignore_errors=True)

    for minor in PYTHONS:
        python = python_of(minor)
        for lowest in (False, True):
            names = (minor, "lowest" if lowest else "newest", plain.name)
            if only not in " ".join(names):
                continue
            if python is None:
                told.add(*names, "not tried", "no interpreter here", "")
                continue
            cell(told, names, lambda p=python, low=lowest: fresh(p, plain, lowest=low))
    base = next(p for p in (python_of(m) for m in PYTHONS) if p is not None)
    for place in PLACES:
        names = (_says(base), "newest", place.name)
        if only in " ".join(names):
            cell(told, names, lambda where=place: fresh(base, where))
    if only in "musl":
        lacking = musl(uv)
        told.add(
            "3.12", "newest", "musl", "not installable" if lacking else "not tried", lacking, ""
        )


def main() -> int:
    """Exit code 1 where a cell failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="cells whose name has this in it")
    parser.add_argument(
        "--folder", type=Path, default=OUTSIDE if os.access(OUTSIDE, os.W_OK) else None,
        help="for environments: some GB, readable by everybody, not in /tmp",
    )  # fmt: skip
    parser.add_argument("--write", type=Path, help="page whose table is replaced")
    asked = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="installs", dir=asked.folder))
    folder.chmod(0o755)
    table = Table(asked.write)
    try:
        matrix(folder, asked.only, table)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    sys.stdout.write(str(table))
    return int(table.failed)


if __name__ == "__main__":
    sys.exit(main())
