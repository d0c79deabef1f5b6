"""A small foreign format for the tests of what all importers share: JSON with boxes on paths."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from safestage_eval.episode import Body, Episode, Header, Track
from safestage_eval.errors import TraceError
from safestage_eval.importers.account import Account
from safestage_eval.importers.importer import Importer, Settings, SourceError
from safestage_eval.importers.scene_bodies import apply_map, fixed_from_map, need_shapes


class Toy(Importer):
    name, title = "toy", "Toy JSON"

    def __init__(self, path: Path, settings: Settings) -> None:
        super().__init__(path, settings)
        self._data: dict[str, Any] = json.loads(path.read_text())["toy"]

    @classmethod
    def recognise(cls, path: Path) -> str | None:
        if not path.is_file() or b'"toy"' not in path.read_bytes()[:20]:
            return None
        return "has a toy"

    def episodes(self) -> list[str]:
        return list(self._data)

    def fingerprint(self, name: str) -> str:
        return json.dumps(self._data[name])

    def read(self, name: str, account: Account) -> Episode:
        if self._data[name] == "broken":
            raise TraceError(f"{self.path}:{name}", "is broken")
        dt = self.settings.dt or self.settings.map.source.dt
        if dt is None:
            raise SourceError(str(self.path), "does not say its rate.", fix="--dt")
        account.missing("forces", cost="contact_force", remedy="ask for them")
        meshes: dict[str, Any] = {}
        bodies, tracks = [], {}
        for body, heights in self._data[name].items():
            z = np.asarray(heights, np.float32)
            zero = np.zeros((len(z), 3), np.float32)
            turn = np.tile(np.array([1, 0, 0, 0], np.float32), (len(z), 1))
            bodies.append(apply_map(Body(name=body, kind="object"), self.settings.map, meshes))
            tracks[body] = Track(np.column_stack([0 * z, 0 * z, z]), turn, zero, zero)
        need_shapes(bodies, str(self.path), among="toys have none")
        more, still = fixed_from_map(set(tracks), self.settings.map, meshes)
        header = Header(
            episode_id="", physics_dt=dt, frame_dt=dt, task="toy", bodies=(*bodies, *more)
        )
        return Episode(header, np.arange(len(z)) * dt, {**tracks, **still}, meshes=meshes)
