"""Is a robot that touched nothing blamed for anything? Counts verdicts on episodes in which it stood still.

    python benchmarks/untouched.py FILE.hdf5 [FILE.hdf5 …] [--seeds 10] [--assets FOLDER …]

Each stored demonstration (robosuite's or LIBERO's layout) gives as many episodes: from its first state its own model
is stepped on with the robot held where it is, as stored and then with all free things put a little higher, turned and
pushed. They are written in the same layout, imported, and judged by every built-in rule, assigned or not. Roles are those of
the built-in bind files; where these have none, the first free thing is the target, and all others are protected, obstacles
and bystanders. An episode in which the robot touches something in some frame is left out. Prints a line for each file, and
every violation; exits with 1 if there is one.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests/helpers"), str(ROOT)]

from still_robots import write_still  # noqa: E402

from safestage_eval.episode import Episode  # noqa: E402
from safestage_eval.episode.contradiction import ContradictionError  # noqa: E402
from safestage_eval.formats import discover  # noqa: E402
from safestage_eval.importers import Settings, import_all  # noqa: E402
from safestage_eval.importers.bind_headers import load_bound  # noqa: E402
from safestage_eval.rules import load_rules  # noqa: E402
from safestage_eval.verdicts import judge  # noqa: E402

ROBOT = ("robot", "gripper")


def touched(episode: Episode) -> bool:
    """Whether any part of the robot touches what is none."""
    kinds = [body.kind in ROBOT for body in episode.header.bodies]
    return any(kinds[i] != kinds[j] for i, j in episode.contacts.pairs)


def in_every_role(episode: Episode) -> Episode:
    """The episode with a body for each role that it leaves open."""
    things = [b.name for b in episode.header.bodies if b.kind == "object" and b.movable]
    others = things[1:]
    roles = {"target": things[:1], "protected": others, "obstacle": others, "fragile": others}
    given = {role: list(names) for role, names in episode.header.roles.items()}
    header = episode.header.model_copy(update={"roles": {**roles, **given}})
    return replace(episode, header=header, _contacts=episode.contacts, _frames=episode.frames)


def blamed(folder: Path) -> tuple[int, int, Counter[str], list[str]]:
    """How many episodes there are, and that the robot touched nothing in; verdicts of these, violations."""
    rules = load_rules([ROOT / "rules"])
    verdicts: Counter[str] = Counter()
    found, every, still = [], 0, 0
    for ref in discover([folder]):
        episode = ref.open()
        every += 1
        if touched(episode):
            continue
        still += 1
        try:
            judged = judge(in_every_role(episode), rules).verdicts
        except ContradictionError as error:
            verdicts["refused"] += 1
            print(f"  refused: {error}")
            continue
        for verdict in judged:
            verdicts[verdict.verdict] += 1
            if verdict.verdict == "violation":
                found.append(f"{ref.episode_id} {verdict.rule}: {verdict.explanation}")
    return every, still, verdicts, found


def main() -> int:
    """Measure the files named on the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--assets", action="append", default=[], type=Path)
    asked = parser.parse_args()
    bad = 0
    for file in asked.files:
        with tempfile.TemporaryDirectory() as folder:
            still = Path(folder) / file.name
            write_still(file, still, range(asked.seeds), assets=asked.assets)
            bind = load_bound("libero" if "libero" in str(file) else "robosuite")
            outcome = import_all(
                still, Path(folder) / "data", Settings(assets=tuple(asked.assets)), bind=bind
            )
            for failed in outcome.failed:
                print(f"  not imported: {failed.message}")
            every, without, verdicts, found = blamed(Path(folder) / "data")
        text = ", ".join(f"{count} {name}" for name, count in sorted(verdicts.items()))
        print(
            f"{file.parent.name}/{file.stem}: {every} episodes, {without} without a touch: {text}",
            flush=True,
        )
        for line in found:
            print(f"  {line}")
        bad += len(found)
    return bool(bad)


if __name__ == "__main__":
    raise SystemExit(main())
