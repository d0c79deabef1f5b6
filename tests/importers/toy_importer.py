"""A small foreign format, and a model of an importer: JSON with boxes on vertical paths.

``{"toy": {EPISODE: {BODY: [height in m, …]}}}``; every body moves along the world's z axis
and has one height per frame. Orientations, velocities, shapes, contacts and success are not recorded.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval._text.json_text import from_json
from safestage_eval.episode import Body, Episode, Track
from safestage_eval.importers.account import Account
from safestage_eval.importers.foreign_motion import make_track
from safestage_eval.importers.importer import Importer, Settings, SourceError
from safestage_eval.importers.missing_data import say_success
from safestage_eval.importers.scene_builder import SceneBuilder

FORM = '{"toy": {EPISODE: {BODY: [height in m, …]}}}'


class Toy(Importer):
    """One JSON file."""

    name, title = "toy", "Toy JSON"

    def __init__(self, path: Path, settings: Settings) -> None:
        """Read the file; raise SourceError where it is not laid out as ``FORM``."""
        super().__init__(path, settings)
        try:
            document = from_json(path.read_text("utf-8"))
        except (OSError, ValueError) as error:
            raise SourceError(str(path), f"cannot be read: {error}.", fix=FORM) from None
        toys = document.get("toy") if isinstance(document, dict) else None
        if not isinstance(toys, dict):
            raise SourceError(str(path), "has no table of toys.", fix=FORM)
        self._toys: dict[str, Any] = toys

    @classmethod
    def recognise(cls, path: Path) -> str | None:
        """By the first bytes, which name toys."""
        if not path.is_file():
            return None
        with path.open("rb") as file:
            return "has a toy" if b'"toy"' in file.read(20) else None

    def episodes(self) -> list[str]:
        """Return the keys of the table, in its order."""
        return list(self._toys)

    def fingerprint(self, name: str) -> str:
        """Return a digest of the episode's heights: short however long the episode is."""
        return hashlib.sha256(json.dumps(self._toys[name]).encode()).hexdigest()[:16]

    def read(self, name: str, account: Account) -> Episode:
        """Read one episode; see ``Importer.read``."""
        where = f"{self.path}: {name}"
        dt = self.settings.stated_dt
        if dt is None:
            raise SourceError(where, "the time between its rows is not recorded.", fix="--dt 1/50")
        scene = SceneBuilder(self.settings, where, account)
        heights = _heights(self._toys[name], where)
        for body, z in heights.items():
            raw = Body(name=body, kind="object", untold=("up_axis", "cavity"))
            scene.add(scene.describe(raw), _motion(z))
        scene.need_shapes("toys have none")
        scene.refuse()
        say_success(account, known=False, hold=None)
        account.guessed("orientations", "upright throughout", cost="tilt, toppled and upright")
        account.guessed("velocities", "stored as 0; rules derive them from poses", cost="impact")
        t = np.arange(len(next(iter(heights.values())))) * dt
        com = "the bodies' origins"
        return scene.episode(t, com=com, task="toy", physics_dt=dt, frame_dt=dt)


def _heights(toys: Any, where: str) -> dict[str, NDArray[np.float64]]:
    """Body → (T,) m, of one length T > 0 and finite; raise SourceError where they are not."""
    if not isinstance(toys, dict) or not toys:
        raise SourceError(where, "has no bodies.", fix=FORM)
    heights = {}
    for body, values in toys.items():
        try:
            heights[body] = np.asarray(values, np.float64)
        except (TypeError, ValueError):
            raise SourceError(f"{where}/{body}", "heights are not numbers.", fix=FORM) from None
    shapes = {z.shape for z in heights.values()}
    length = len(next(iter(heights.values()))) if {len(s) for s in shapes} == {1} else 0
    if shapes != {(length,)} or not length:
        raise SourceError(where, "not every body has a height for each frame.", fix=FORM)
    for body, z in heights.items():
        if not np.isfinite(z).all():
            raise SourceError(f"{where}/{body}", "a height is not finite.", fix="numbers in m")
    return heights


def _motion(z: NDArray[np.float64]) -> Track:
    """Upright on the z axis; without velocities, which rules then derive from the poses."""
    zero = np.zeros_like(z)
    upright = np.tile([1.0, 0, 0, 0], (len(z), 1))
    return make_track(np.column_stack([zero, zero, z]), upright, None, None)


IMPORTER = Toy
