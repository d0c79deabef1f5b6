"""Who hangs together with whom by contacts among free bodies, frame by frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode.contacts import Pair
from safestage_eval.evidence.contact_sums import ContactSums

from .arrangement import Arrangement
from .assembly import Assemblies

Bool = NDArray[np.bool_]


class Chains:
    """Bodies are indices into ``header.bodies``; T frames."""

    def __init__(
        self, frames: int, assemblies: Assemblies, sums: ContactSums, arrangement: Arrangement
    ) -> None:
        """Prepare for one episode; nothing is computed yet."""
        self._frames = frames
        self._assemblies = assemblies
        self._sums = sums
        self._arrangement = arrangement
        self._clusters: dict[int, list[Pair]] = {}
        self._joined: dict[int, dict[int, Bool]] = {}
        self._handled: dict[int, Bool] = {}
        self._signatures: dict[int, NDArray[np.int64]] = {}

    def cluster(self, body: int) -> list[Pair]:
        """Pairs with a free body that contacts among free bodies ever join to the given one."""
        if body not in self._clusters:
            members, todo = {body}, [body]
            while todo:
                at = todo.pop()
                near = self._assemblies.of(at).union(self._sums.beside(at))
                near = near & self._assemblies.free - members
                members |= near
                todo += near
            pairs = sorted({(min(b, o), max(b, o)) for b in members for o in self._sums.beside(b)})
            self._clusters.update(dict.fromkeys(members, pairs))
        return self._clusters[body]

    def joined(self, body: int) -> dict[int, Bool]:
        """Free body → (T,) true where a chain of contacts among free bodies joins it to this one."""
        if body not in self._joined:
            cluster, free = self.cluster(body), self._assemblies.free
            near = {b for pair in cluster for b in pair if b in free} | {body}
            touch = {p: self._arrangement.touching(p) for p in cluster if near.issuperset(p)}
            for part in near:
                for other in self._assemblies.of(part) & free - {part}:
                    touch[part, other] = np.ones(self._frames, np.bool_)
            reached = {body: np.ones(self._frames, np.bool_)}
            changed = True
            while changed:
                changed = False
                for (i, j), present in touch.items():
                    for x, y in ((i, j), (j, i)):
                        if x in reached:
                            have = reached.get(y, np.zeros(self._frames, np.bool_))
                            gained = present & reached[x] & ~have
                            if gained.any():
                                reached[y] = have | gained
                                changed = True
            self._joined[body] = reached
        return self._joined[body]

    def linked(self, body: int, on: int) -> Bool:
        """(T,) true where a chain of contacts among free bodies joins the two."""
        joined = self.joined(body)
        if on in self._assemblies.free:
            return joined.get(on, np.zeros(self._frames, np.bool_))
        linked = np.zeros(self._frames, np.bool_)
        for gone in self._assemblies.hanging(on):
            for b, present in joined.items():
                if gone in self._sums.beside(b):
                    pair = (min(b, gone), max(b, gone))
                    linked |= present & self._arrangement.touching(pair)
        return linked

    def handled(self, body: int) -> Bool:
        """(T,) the robot touches what hangs together with a body."""
        if body not in self._handled:
            touched = np.zeros(self._frames, np.bool_)
            joined = self.joined(body)
            for i, j in self.cluster(body):
                for robot, other in ((i, j), (j, i)):
                    if robot in self._assemblies.robot and other in joined:
                        touched |= joined[other] & self._arrangement.touching((i, j))
            self._handled[body] = touched
        return self._handled[body]

    def signature(self, body: int) -> NDArray[np.int64]:
        """(T,) equal where equal sets of contact points of the cluster carry something."""
        if body not in self._signatures:
            self._signatures[body] = self._arrangement.signature(self.cluster(body))
        return self._signatures[body]
