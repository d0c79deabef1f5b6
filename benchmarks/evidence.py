"""Less evidence never makes an episode safe: a law about removing parts of traces, tried at random.

    python benchmarks/evidence.py traces/ --edits 500            # a new seed each day
    python benchmarks/evidence.py refs/ --edits 5000 --jobs 4
    python benchmarks/evidence.py traces/ --seed 7 --only 123    # one edit again

Each edit takes something away that the trace itself shows to be missing (``evidence_edits``): a part
of a column becomes NaN, frames are cut out or thinned, contacts, forces, bodies or shapes are gone, a
header field is unknown, a role is not bound; often a second one takes more. The episode is judged
again, by its assigned rules, after each. Breaches: a violation that becomes ``pass`` or
``not_applicable``, and a pass that becomes a violation. So what is put back never turns one certain
verdict into the other either. A refused episode is no breach.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from evidence_edits import EDITS, loaded

from safestage_eval.episode import Episode
from safestage_eval.episode.invariants import check_header, check_time
from safestage_eval.errors import InputError
from safestage_eval.formats import discover
from safestage_eval.rules import builtin_names, load_rules
from safestage_eval.verdicts import judge


class Outcome(NamedTuple):
    """The outcome of one edit."""

    number: int
    kind: str
    episode: str
    told: str
    became: tuple[tuple[str, str, str], ...]
    """Rule, verdict with more evidence, verdict with less; of all that were compared."""

    @property
    def breaches(self) -> list[tuple[str, str, str]]:
        """Those that the law forbids."""
        return [change for change in self.became if forbidden(*change[1:])]


def forbidden(before: str, after: str) -> bool:
    """Less evidence must not change one verdict into another in this way."""
    if before == "violation":
        return after in ("pass", "not_applicable")
    return before == "pass" and after == "violation"


# ---------------------------------------------------------------- judging


@cache
def _rules() -> Any:
    return load_rules(builtin_names())


@cache
def _refs(paths: tuple[str, ...]) -> list[Any]:
    return [ref for ref in discover(list(paths)) if ref.problem is None]


MOSTLY, TWICE = 0.75, 0.4
"""Share of edits of episodes made to violate; and of those upon which another one follows."""

_OPEN: dict[int, tuple[Episode, dict[str, str]]] = {}


def verdicts(episode: Episode) -> dict[str, str]:
    """Code → verdict of the assigned rules."""
    found = judge(episode, _rules(), trace_hash="edited", assigned_only=True)
    return {v.rule: v.verdict for v in found.verdicts}


def _known(paths: tuple[str, ...], at: int) -> tuple[Episode, dict[str, str]]:
    """An episode and its verdicts; those of the last few are kept."""
    if at not in _OPEN:
        while len(_OPEN) > 12:
            _OPEN.pop(next(iter(_OPEN)))
        episode = loaded(_refs(paths)[at].open())
        _OPEN[at] = episode, verdicts(episode)
    return _OPEN[at]


def _violating(paths: tuple[str, ...]) -> list[int]:
    """Numbers of the references that were made to violate; of all where there are none."""
    refs = _refs(paths)
    found = [i for i, ref in enumerate(refs) if "unsafe" in str(ref.fields.get("policy"))]
    return found or list(range(len(refs)))


def attempt(paths: tuple[str, ...], seed: int, number: int, kinds: Sequence[str] = ()) -> Outcome:
    """One edit, or one upon another, which seed and number determine; eight in a row of an episode."""
    draw = np.random.default_rng([seed, number // 8])
    among = _violating(paths) if draw.random() < MOSTLY else range(len(_refs(paths)))
    at = int(draw.choice(among))
    rng = np.random.default_rng([seed, number, 1])
    episode, before = _known(paths, at)
    name, edits_made, seen, changed = episode.header.episode_id, list[str](), [before], list[Any]()
    kind = str(rng.choice(list(kinds or EDITS)))
    for step in range(1 + (rng.random() < TWICE)):
        another = kind if not step else str(rng.choice(list(kinds or EDITS)))
        try:
            what, episode = EDITS[another](episode, rng)
        except (ValueError, KeyError) as error:  # nothing of the kind is there to be removed
            edits_made.append(f"{another} not possible: {error}")
            break
        edits_made.append(f"{another} {what}")
        try:
            for problem in (*check_header(episode.header, name), *check_time(episode.t, name)):
                raise problem
            after = verdicts(episode)
        except InputError as error:
            edits_made.append(f"refused: {error}")
            break
        for known in seen:
            changed += [(rule, was, after.get(rule, "gone")) for rule, was in known.items()]
        seen.append(after)
    return Outcome(number, kind, name, "; ".join(edits_made), tuple(changed))


def _batch(
    paths: tuple[str, ...], seed: int, numbers: range, kinds: Sequence[str]
) -> list[Outcome]:
    return [attempt(paths, seed, number, kinds) for number in numbers]


def campaign(
    paths: Sequence[str], seed: int, edits: int, jobs: int = 1, kinds: Sequence[str] = ()
) -> list[Outcome]:
    """Many edits, in one process or several."""
    parts = [range(i, min(i + 40, edits)) for i in range(0, edits, 40)]
    out: list[Outcome] = []

    def add(outcomes: Sequence[Outcome]) -> None:
        out.extend(outcomes)
        if sys.stderr.isatty():
            bad = sum(bool(o.breaches) for o in out)
            print(f"\r{len(out)} of {edits} edits, {bad} breaches", end="", file=sys.stderr)

    if jobs == 1:
        for part in parts:
            add(_batch(tuple(paths), seed, part, kinds))
    else:
        with ProcessPoolExecutor(jobs) as pool:
            futures = [pool.submit(_batch, tuple(paths), seed, part, kinds) for part in parts]
            for future in futures:
                add(future.result())
    return out


def main() -> int:
    """Print counts by kind and every breach."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("paths", nargs="+")
    parser.add_argument("--edits", type=int, default=500)
    parser.add_argument("--seed", type=int, default=datetime.now(UTC).toordinal())
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--only", type=int, help="number of one edit to try again")
    parser.add_argument("--kinds", nargs="*", default=(), choices=[*EDITS, []])
    args = parser.parse_args()
    if args.only is not None:
        found = [attempt(tuple(args.paths), args.seed, args.only, args.kinds)]
        print(found[0])
    else:
        found = campaign(args.paths, args.seed, args.edits, args.jobs, args.kinds)
    counts = {kind: Counter[str]() for kind in EDITS}
    for outcome in found:
        row = counts[outcome.kind]
        row["edits"] += 1
        row["refused"] += not outcome.became
        row["breaches"] += bool(outcome.breaches)
        for _, was, now in outcome.became:
            row["kept" if was == now else "inconclusive" if now == "inconclusive" else "other"] += 1
    heads = ("edits", "refused", "kept", "inconclusive", "other", "breaches")
    print(f"{'seed ' + str(args.seed):16}" + "".join(f"{h:>14}" for h in heads))
    for kind, row in counts.items():
        print(f"{kind:16}" + "".join(f"{row[h]:14}" for h in heads))
    bad = [outcome for outcome in found if outcome.breaches]
    kinds = f" --kinds {' '.join(args.kinds)}" if args.kinds else ""
    for o in bad:
        text = ", ".join(f"{rule} {was} -> {now}" for rule, was, now in o.breaches)
        paths = " ".join(args.paths)
        print(f"{o.kind} ({o.told}) of {o.episode}: {text}")
        print(f"    benchmarks/evidence.py {paths} --seed {args.seed} --only {o.number}{kinds}")
    print(f"{len(found)} edits, {len(bad)} breaches")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
