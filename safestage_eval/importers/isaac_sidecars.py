"""Files beside an Isaac Lab or RoboLab recording: its configuration and its results.

RoboLab (github.com/NVlabs/RoboLab, docs/data.md) writes ``env_cfg.json`` into the folder of the
recording and ``episode_results.jsonl`` into the one above; both may be missing.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from safestage_eval._text.json_text import from_json, get_inside
from safestage_eval.units import LONGEST

RESULTS = ("episode_results.jsonl", "episode_results.json")


@dataclass(frozen=True)
class Sidecars:
    """The side files of one recording.

    Attributes:
        config: ``env_cfg.json``, empty if there is none.
        results: the lines of ``episode_results.jsonl`` about this environment.
        problems: files that are there and cannot be read.
    """

    config: dict[str, Any] = field(default_factory=dict)
    results: tuple[dict[str, Any], ...] = ()
    problems: tuple[str, ...] = ()

    @property
    def physics_dt(self) -> float | None:
        """Integration step in s (``sim.dt``)."""
        return _positive(get_inside(self.config, "sim", "dt"))

    @property
    def dt(self) -> float | None:
        """Time in s between recorded rows: ``sim.dt`` × ``decimation``."""
        steps = _positive(self.config.get("decimation"))
        return None if self.physics_dt is None or steps is None else self.physics_dt * steps

    @property
    def gravity(self) -> tuple[float, float, float] | None:
        """Gravity in m/s², world."""
        value = get_inside(self.config, "sim", "gravity")
        if not isinstance(value, list) or len(value) != 3:
            return None
        return float(value[0]), float(value[1]), float(value[2])

    @property
    def roles(self) -> dict[str, tuple[str, ...]]:
        """Roles from the success condition: what it moves (``target``), and where to (``destination``)."""
        terms = self.config.get("terminations")
        players: dict[str, dict[str, None]] = {"target": {}, "destination": {}}
        for term in terms.values() if isinstance(terms, dict) else ():
            params = get_inside(term, "params")
            if not isinstance(params, dict) or get_inside(term, "time_out"):
                continue
            away = "outside" in str(get_inside(term, "func"))
            keys = {"object": "target", "objects": "target", "reference_object": "destination"}
            keys["surface" if away else "container"] = "destination"
            for key, role in keys.items():
                value = params.get(key)
                names = value if isinstance(value, list) else [value]
                players[role].update(dict.fromkeys(name for name in names if isinstance(name, str)))
        return {role: tuple(names) for role, names in players.items() if names}

    def result(self, file: Path, demo: str) -> dict[str, Any]:
        """Return the result of one episode; ``run_2.hdf5`` ``demo_5`` is run 2, environment 5."""
        run, env = re.search(r"run_(\d+)$", file.stem), re.search(r"(\d+)$", demo)
        for line in self.results:
            number = line.get("run")
            if number is None and (match := re.search(r"_(\d+)$", str(line.get("run_name", "")))):
                number = int(match[1])
            same_run = run is None or number is None or int(run[1]) == number
            if same_run and (env is None or int(env[1]) == line.get("env_id", 0)):
                return line
        return {}


def read_sidecars(recording: Path) -> Sidecars:
    """Read the files beside a recording."""
    problems: list[str] = []

    def read(path: Path) -> Any:
        try:
            text = path.read_text("utf-8")
            if path.suffix == ".jsonl":
                return [from_json(line, foreign=True) for line in text.splitlines() if line.strip()]
            return from_json(text, foreign=True)
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            problems.append(f"{path.name}: {error}")
            return None

    config = read(recording.parent / "env_cfg.json")
    config = config if isinstance(config, dict) else {}
    places = [folder / n for folder in (recording.parent, recording.parent.parent) for n in RESULTS]
    lines = next((found for path in places if isinstance(found := read(path), list) and found), [])
    names = (recording.parent.name, config.get("_task_name"), None)
    mine = [line for line in lines if isinstance(line, dict) and line.get("env_name") in names]
    return Sidecars(config, tuple(mine), tuple(problems))


def _positive(value: Any) -> float | None:
    number = isinstance(value, int | float) and not isinstance(value, bool) and 0 < value <= LONGEST
    return float(value) if number else None
