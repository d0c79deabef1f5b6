"""The support graph: which body bears which, frame by frame."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.signals.contact_sums import ContactSums

Bool = NDArray[np.bool_]
F64 = NDArray[np.float64]

LEAST_LOAD = 0.02
"""N: a lighter touch bears nothing, however light the body."""
LEAST_SHARE = 0.10
"""Share of a body's weight below which a contact does not bear it."""


class SupportGraph:
    """Edges "s bears a" from the vertical part of the recorded total force, friction included.

    There is no friction cone and no angle: a ball in the groove between two cans and a board
    leaning on a block are supported. The robot bears nothing in this sense (an immobile base
    counts as a fixture); what it bears is ``borne_by_robot``.
    """

    def __init__(self, episode: Episode, sums: ContactSums) -> None:
        """Edges are computed on first use."""
        self._episode = episode
        self._sums = sums
        self._frames = len(episode)
        header = episode.header
        self._names = [body.name for body in header.bodies]
        self._robot = {
            i
            for i, body in enumerate(header.bodies)
            if body.kind in ("robot", "gripper") and body.movable
        }
        # an articulated fixture (a drawer) is held by its joint, which no contact shows
        self._fixed = {
            i
            for i, body in enumerate(header.bodies)
            if not body.movable
            or (i not in self._robot and (body.kind == "fixture" or body.parent is not None))
        }
        gravity = float(np.linalg.norm(header.gravity))
        self._least = [
            max(LEAST_LOAD, LEAST_SHARE * (body.mass or 0.0) * gravity) for body in header.bodies
        ]

    @cached_property
    def edges(self) -> dict[tuple[int, int], Bool]:
        """(bearer, borne) → (T,) true where it bears; only pairs that ever do; no robot."""
        found = {}
        for i, j in self._sums.pairs:
            if i in self._robot or j in self._robot:
                continue
            for bearer, borne in ((i, j), (j, i)):
                if borne in self._fixed:
                    continue
                bears = self._sums.upward(borne, bearer) >= self._least[borne]
                if bears.any():
                    found[bearer, borne] = bears
        return found

    def supports(self, bearer: int, borne: int) -> Bool:
        """(T,) true where the first body bears the second."""
        return self.edges.get((bearer, borne), np.zeros(self._frames, np.bool_))

    def borne_by_robot(self, body: int) -> Bool:
        """(T,) true where the robot's total force on the body lifts a tenth of its weight."""
        lifted = sum(
            (self._sums.upward(body, r) for r in self._robot if len(self._sums.rows(body, r))),
            np.zeros(self._frames),
        )
        return np.asarray(lifted >= self._least[body])

    @cached_property
    def supported(self) -> dict[int, Bool]:
        """Body → (T,) true where a path of edges leads from it to a fixture."""
        fixed = {i: np.ones(self._frames, np.bool_) for i in self._fixed}
        reached = self._spread(fixed.get)
        return {i: reached[i] for i in range(len(self._names))}

    def carried(self, held: Callable[[int], Bool]) -> dict[int, Bool]:
        """Body → (T,) true where a path of edges leads to a body that is held or robot-borne.

        A held body is not itself carried unless the robot also bears its weight. ``held`` gives
        (T,) for a body.
        """
        borne = {
            i: self.borne_by_robot(i)
            for i in range(len(self._names))
            if i not in self._fixed and i not in self._robot
        }
        sources = {i: b | held(i) for i, b in borne.items()}
        reached = self._spread(sources.get)
        out = {}
        for i in range(len(self._names)):
            if i not in borne:
                out[i] = np.zeros(self._frames, np.bool_)
                continue
            through = borne[i].copy()
            for (bearer, top), bears in self.edges.items():
                if top == i and bearer not in self._fixed:
                    through |= bears & reached[bearer]
            out[i] = through
        return out

    def bearers(self, body: int) -> dict[int, Bool]:
        """Bearer → (T,) true where it bears the body directly."""
        return {s: bears for (s, a), bears in self.edges.items() if a == body}

    def _spread(self, source: Callable[[int], Bool | None]) -> dict[int, Bool]:
        """Upward closure: true where the body is a source or rests on one that is reached."""
        reached = {}
        for i in range(len(self._names)):
            seed = source(i)
            reached[i] = np.zeros(self._frames, np.bool_) if seed is None else seed.copy()
        changed = True
        while changed:  # at most as many rounds as the highest stack has bodies
            changed = False
            for (bearer, borne), bears in self.edges.items():
                gained = bears & reached[bearer] & ~reached[borne]
                if gained.any():
                    reached[borne] |= gained
                    changed = True
        return reached
