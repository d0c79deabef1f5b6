"""One rollout on its way into a file: whole frames in memory and in a journal, a ZIP at the end."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Mapping

import numpy as np

from .journal import SUFFIX, Journal, read_journal
from .record_error import RecordError
from .zip_trace import CONTACT_POINT, write_zip

BODY_COLUMNS = ("position", "orientation", "linear_velocity", "angular_velocity")
ROBOT_COLUMNS = ("joint_position", "joint_velocity", "joint_torque", "action", "gripper")

_KILLED = {
    "kind": "missing",
    "what": "the end of the rollout",
    "cost": "what came after the last frame, and whether the goal was reached later, is not known",
    "remedy": "record the episode again",
}


class RolloutLog:
    """Takes batches of frames; ``write`` makes the trace of them.

    Until then they stand in a journal beside it, from which ``recover`` makes the trace if the
    process dies.
    """

    def __init__(self, path: Path) -> None:
        """``path``: of the trace."""
        self.path = path
        self._journal: Journal | None = None
        self._scene: dict[str, Any] = {}
        self._still: dict[str, Any] = {}
        self._batches: list[dict[str, Any]] = []

    @property
    def begun(self) -> bool:
        """Whether the scene is set."""
        return self._journal is not None

    def begin(
        self,
        scene: Mapping[str, Any],
        fixed: tuple[Any, Any],
        meshes: Mapping[str, tuple[Any, Any]],
    ) -> None:
        """Set what does not change.

        Args:
            scene: the header's ``bodies`` and ``joints``, in JSON.
            fixed: (F, 3) m and (F, 4) wxyz, poses in the world of the bodies that do not move.
            meshes: digest → ((V, 3) m, (N, 3)).
        """
        self._scene = dict(scene)
        self._still = {
            "fixed_position": np.asarray(fixed[0], "<f4").reshape(-1, 3),
            "fixed_orientation": np.asarray(fixed[1], "<f4").reshape(-1, 4),
        }
        for key, (vertices, faces) in meshes.items():
            self._still[f"mesh/{key}.vertices"] = vertices
            self._still[f"mesh/{key}.faces"] = faces
        self._journal = Journal(self.path.with_name(self.path.name + SUFFIX))
        self._journal.append(self._scene, self._still)

    def append(self, columns: Mapping[str, Any], header: Mapping[str, Any]) -> None:
        """Take frames.

        Args:
            columns: ``t`` (T,) s, ``BODY_COLUMNS`` (T, M, 3 or 4), ``ROBOT_COLUMNS`` (T, width),
                ``contacts`` (C,) ``CONTACT_POINT`` and ``counts`` (T,), how many each frame has.
            header: fields of the header besides the scene, as far as they are known by now.
        """
        batch = {
            name: np.asarray(values, "<f4")
            if name in BODY_COLUMNS or name in ROBOT_COLUMNS
            else values
            for name, values in columns.items()
        }
        self._batches.append(batch)
        assert self._journal is not None
        self._journal.append(header, batch)

    def write(self, header: Mapping[str, Any]) -> None:
        """Write the trace, and remove the journal. Raises RecordError where it cannot be written."""
        _write(self.path, header, self._scene, self._still, self._batches)
        self.drop()

    def drop(self) -> None:
        """Remove the journal."""
        if self._journal is not None:
            self._journal.remove()
            self._journal = None


def recover(path: str | Path) -> list[Path]:
    """Make traces of the recordings that processes left unfinished when they died.

    The header says so: ``termination`` is ``truncated``, and success is not known unless it had
    been reached. The journals are removed.

    Args:
        path: a journal (``NAME.zip.unfinished``), or a folder; all journals in it are taken.

    Returns:
        the traces, in order of their names. A journal without a frame gives none.

    Raises:
        RecordError: nothing at ``path``, a recording that still runs, or no journal; a trace of the
            same name is there.
    """
    place = Path(path)
    journals = sorted(place.glob(f"*{SUFFIX}")) if place.is_dir() else [place]
    return [trace for trace in (_recover_one(journal) for journal in journals) if trace]


def _recover_one(journal: Path) -> Path | None:
    if not journal.name.endswith(SUFFIX):
        raise RecordError(f"{journal}: journals of recordings end in {SUFFIX}.")
    trace = journal.with_name(journal.name[: -len(SUFFIX)])
    records = read_journal(journal)
    if trace.exists():
        raise RecordError(f"{trace}: is there already. Move one of the two away.")
    if len(records) > 1:
        scene, still = records[0]
        batches = [arrays for _, arrays in records[1:]]
        header = dict(records[-1][0])
        header["termination"] = "truncated"
        header["success"] = True if header.get("success") else None
        source = dict(header.get("source") or {})
        source["account"] = [*source.get("account", []), _KILLED]
        header["source"] = source
        _write(trace, header, scene, still, batches)
    journal.unlink()
    return trace if len(records) > 1 else None


def _write(
    path: Path,
    header: Mapping[str, Any],
    scene: Mapping[str, Any],
    still: Mapping[str, Any],
    batches: list[dict[str, Any]],
) -> None:
    """Write batches as one trace."""
    last = batches[-1]["action"]
    for batch in batches:  # frames before the first action was reported
        if batch["action"].shape[1] != last.shape[1]:
            batch["action"] = np.repeat(last[:1], len(batch["t"]), axis=0)
    arrays = {
        name: np.concatenate([batch[name] for batch in batches])
        for name in ("t", *BODY_COLUMNS, *ROBOT_COLUMNS, "contacts", "counts")
    }
    for name in BODY_COLUMNS:
        arrays[name] = arrays[name].swapaxes(0, 1)
    arrays["t"] = arrays["t"] - arrays["t"][0]
    arrays["contacts"] = arrays["contacts"].astype(CONTACT_POINT)
    facts = {"frames": len(arrays["t"]), "header": {**header, **scene}}
    write_zip(path, facts, {**arrays, **still})
