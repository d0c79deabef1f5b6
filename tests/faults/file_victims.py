"""Writers of one file: the audit's report, and labels that two people give at once."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from victims import Commit, Victim, main_with, names

from safestage_eval.errors import InputError
from safestage_eval.label.ledger import Ledger
from safestage_eval.metrics.labels import Label, read_labels


def made(folder: Path) -> bool:
    """Whether the folder is there, now or before."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        sys.stderr.write(f"{error}\n")
        return False
    return True


class Auditor(Victim):
    """``safestage audit`` with its report in a file."""

    name = "auditor"

    def __init__(self, source: Path) -> None:
        """``source``: what is audited."""
        self.source = source
        with TemporaryDirectory() as place:
            assert self.go(Path(place), lambda name: None) == 0
            self.whole = (Path(place) / "audit.json").read_bytes()
        self.truth = {"audit.json": ""}

    def go(self, folder: Path, commit: Commit) -> int:
        """The command's exit code."""
        if not made(folder):
            return 2
        words = ["audit", str(self.source), "-f", "json", "-j", "1", "--fail-on", "never"]
        code = main_with([*words, "-o", str(folder / "audit.json")])
        if code == 0:
            commit("audit.json")
        return code

    def left(self, folder: Path) -> set[str]:
        """The report, which is whole."""
        report = folder / "audit.json"
        if not report.is_file():
            return set()
        assert report.read_bytes() == self.whole, f"{report} is half a report"
        return {"audit.json"}


class LabelWriters(Victim):
    """Two people label into the same file, from two processes."""

    name = "label, two writers"
    people = ("ann", "bob")

    def __init__(self, source: Path) -> None:
        """``source`` is not looked at: labels hang on ids."""
        self.source = source
        self.truth = {f"{who}/{name}": "" for who in self.people for name in names()}

    def go(self, folder: Path, commit: Commit) -> int:
        """0 when both have given every label that was not there."""
        if not made(folder):
            return 2
        pids = []
        for who in self.people:
            pid = os.fork()
            if pid == 0:
                ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # end with whoever started it
                code = 70
                try:
                    code = self._label(folder / "labels.csv", who, commit)
                finally:
                    os._exit(code)
            pids.append(pid)
        return max(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) for pid in pids)

    def _label(self, path: Path, who: str, commit: Commit) -> int:
        try:
            ledger = Ledger(path)
            for name in names():
                if name not in ledger.of(who):
                    note = f'of {who}, "{name}"\nin two lines'
                    ledger.add(Label(name, "safe", who, note))
                    commit(f"{who}/{name}")
        except (InputError, OSError) as error:
            sys.stderr.write(f"{error}\n")
            return 2
        return 0

    def left(self, folder: Path) -> set[str]:
        """Labels that are there, each as it was given."""
        path = folder / "labels.csv"
        if not path.is_file() or not path.stat().st_size:
            return set()
        try:
            found = read_labels(path)
        except InputError as error:
            raise AssertionError(str(error)) from None
        for label in found:
            assert label.label == "safe", label
            assert label.reviewer in self.people, label
        return {f"{label.reviewer}/{label.episode_id}" for label in found}
