"""The one cause behind the contradictions of a recording, where there is one that explains them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

from safestage_eval.doubts import AtHand, contradictions
from safestage_eval.doubts.column_comparisons import compare_motion
from safestage_eval.doubts.motion_doubts import LEAST, LONGEST, PAIRS, WINDOW
from safestage_eval.episode import Episode
from safestage_eval.episode.contradiction import ContradictionError

from .repair import REPAIRS, Repair

SUSPECTS = 2
"""Bodies that are mended one by one, the one with most contradictions first."""

FITS = 0.1
"""Share of a motion by which poses and velocities differ at the most where they are of one body."""

LEFT = 0.1
"""Share of the contradictions that may be left where a repair counts as the cause."""


@dataclass(frozen=True)
class Diagnosis:
    """Cause of contradictions, and those that it does not explain.

    Attributes:
        repair: what mends the recording; None where nothing does.
        bodies: names of the bodies that it concerns; empty if all of them.
        first: a contradiction that it explains; None without a repair.
        explained: how many it explains.
        left: contradictions that it does not explain.
    """

    repair: Repair | None = None
    bodies: tuple[str, ...] = ()
    first: ContradictionError | None = None
    explained: int = 0
    left: tuple[ContradictionError, ...] = ()


def diagnose(episode: Episode, errors: Sequence[ContradictionError]) -> Diagnosis:
    """Look for the repair after which the recording no longer contradicts itself.

    Of several, the one that leaves least; of these the one after which poses and velocities fit best.
    """
    named = Counter(name for error in errors for name in error.bodies if name in episode.tracks)
    suspects = [name for name, _ in named.most_common(SUSPECTS)]
    best: tuple[int, float, Diagnosis] | None = None
    for repair, names in _candidates(errors, named, suspects):
        mended = repair.mend(episode, names or [*episode.tracks])
        if mended is episode or [*contradictions(mended, _Only(mended, suspects))]:
            continue
        left = [*contradictions(mended)]
        rest = _residual(mended, suspects)
        if len(left) > LEFT * len(errors) or (best and (len(left), rest) >= best[:2]):
            continue
        still = {(error.code, error.bodies) for error in left}
        first = next(e for e in errors if (e.code, e.bodies) not in still)
        best = (
            len(left),
            rest,
            Diagnosis(repair, names, first, len(errors) - len(left), tuple(left)),
        )
        if not left and rest < FITS:
            break
    return Diagnosis(left=tuple(errors)) if best is None else best[2]


class _Only(AtHand):
    """Some bodies alone are at hand, and their contacts."""

    def __init__(self, episode: Episode, names: Collection[str]) -> None:
        super().__init__(episode)
        self._names = names

    def matters(self, body: str) -> bool:
        """See ``AtHand``."""
        return body in self._names

    def some(self, body: str) -> bool:
        """See ``AtHand``."""
        return body in self._names or (super().some(body) and len(self._episode.tracks[body]) == 1)

    def frames(self) -> None:
        """See ``AtHand``."""


def _residual(episode: Episode, names: Iterable[str]) -> float:
    """The largest share of the motion of some bodies by which poses and velocities differ.

    ``FITS`` where there is too little motion to tell: other units make any motion small.
    """
    rest, moved = 0.0, False
    for name in names:
        track = episode.tracks[name]
        for pose, rate in PAIRS if len(track) > 1 else ():
            place, speed = getattr(track, pose), getattr(track, rate)
            motion = compare_motion(episode.t, place, speed, None, LONGEST[pose], WINDOW)
            by_pose, by_velocity, apart = motion.sizes()
            most = max(by_pose, by_velocity)
            if most > LEAST[pose]:
                rest, moved = max(rest, apart / most), True
    return float(rest) if moved else FITS


def _candidates(
    errors: Sequence[ContradictionError], named: Counter[str], suspects: Sequence[str]
) -> Iterator[tuple[Repair, tuple[str, ...]]]:
    """Repairs that fit the contradictions, of some bodies or (empty) of all."""
    codes = {error.code for error in errors}
    likely = [repair for repair in REPAIRS if codes & repair.codes]
    alone = len(named) <= 1 or (bool(named) and named.most_common(1)[0][1] == len(errors))
    several: list[tuple[Repair, tuple[str, ...]]] = [(repair, ()) for repair in likely]
    single = [(repair, (name,)) for name in suspects for repair in likely if not repair.whole]
    yield from [*single, *several] if alone else [*several, *single]
