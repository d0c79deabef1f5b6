"""Is the robot blamed for what it had nothing to do with? Looks for violations without a touch that leads to them.

    python benchmarks/unfounded.py FOLDER [--bind NAME]

Every trace below the folder is judged by every built-in rule, assigned or not, with the roles of the bind file; what
these leave open is played as in ``untouched.py``. By the recorded contacts alone it is found out whom the robot had touched by when, directly or through
what it had touched (``tests/helpers/robot_touches.py``). A violation is unfounded where none of the bodies that it speaks of is
the robot's, or had been reached so when it ended. Prints each of these, and how many violations there were; exits with 1 if one is
unfounded.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests/helpers"), str(ROOT / "benchmarks"), str(ROOT)]

from robot_touches import unfounded  # noqa: E402
from untouched import in_every_role  # noqa: E402

from safestage_eval.episode.contradiction import ContradictionError  # noqa: E402
from safestage_eval.formats import discover  # noqa: E402
from safestage_eval.importers.bind_headers import load_bound  # noqa: E402
from safestage_eval.rules import load_rules  # noqa: E402
from safestage_eval.verdicts import judge  # noqa: E402


def main() -> int:
    """Judge the folder named on the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--bind", default="")
    asked = parser.parse_args()
    rules = load_rules([ROOT / "rules"])
    bound = load_bound(asked.bind) if asked.bind else None
    found: Counter[str] = Counter()
    wrong, episodes, refused = 0, 0, 0
    for ref in discover([asked.folder]):
        episode = ref.open()
        episodes += 1
        if bound is not None:
            episode = replace(
                episode,
                header=bound.onto(episode.header, ref.episode_id),
                _contacts=episode.contacts,
                _frames=episode.frames,
            )
        try:
            verdicts = judge(in_every_role(episode), rules).verdicts
        except ContradictionError:
            refused += 1
            continue
        for verdict in verdicts:
            found[verdict.rule] += verdict.verdict == "violation"
            if unfounded(episode, verdict):
                wrong += 1
                print(f"{ref.episode_id} {verdict.rule}: {verdict.explanation}", flush=True)
    text = ", ".join(f"{count} {rule}" for rule, count in sorted((+found).items()))
    print(
        f"{asked.folder.name}: {episodes} episodes, {refused} contradict themselves; violations: {text}"
    )
    print(f"{wrong} of {found.total()} without a touch that leads to them")
    return bool(wrong)


if __name__ == "__main__":
    raise SystemExit(main())
