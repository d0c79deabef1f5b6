"""The support graph: which body bears which, frame by frame."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode
from safestage_eval.evidence.contact_sums import ContactSums

Bool = NDArray[np.bool_]

LEAST_LOAD = 1e-3
"""N: less bears nothing whose mass is not known."""
ROUNDING = 2.0**-22
"""Forces are stored as float32: a sum of a few of them is right to this share of the greatest."""
LIGHT = 0.02
"""kg: what weighs less may be borne by less than the rounding of what else presses on it."""
LEAST_SHARE = 0.10
"""Share of a body's weight below which a contact does not bear it."""


class Assemblies:
    """Where the chain of parents of each body ends; bodies are indices into ``header.bodies``.

    A drawer hangs on its cabinet, and stays in its place. The lid of a jar goes where the jar goes:
    the parts of a free object are borne, carried and lost together, as if their hinge were locked.

    Attributes:
        robot: the moving bodies of the robot.
        fixed: what its joints hold in its place, however it may turn or slide there.
        free: objects, and parts of objects, that nothing but contact holds.
    """

    def __init__(self, bodies: Sequence[Body]) -> None:
        """``bodies``: of one header."""
        index = {body.name: i for i, body in enumerate(bodies)}
        self.robot = {
            i for i, body in enumerate(bodies) if body.kind in ("robot", "gripper") and body.movable
        }
        self._children: dict[int, set[int]] = {}
        for i, body in enumerate(bodies):
            if body.parent in index:
                self._children.setdefault(index[body.parent], set()).add(i)
        self._root = [self._end(bodies, index, i) for i in range(len(bodies))]
        self.fixed = {i for i, root in enumerate(self._root) if root is None}
        self.free = {
            i
            for i, root in enumerate(self._root)
            if root is not None and bodies[i].kind == "object" and bodies[root].kind == "object"
        }
        self._parts: dict[int, set[int]] = {}
        for i, root in enumerate(self._root):
            if root is not None and i not in self.robot:
                self._parts.setdefault(root, set()).add(i)

    def of(self, body: int) -> set[int]:
        """The body and the other parts of the object that it is a part of."""
        root = self._root[body]
        return {body} if root is None else self._parts.get(root, set()) | {body}

    def hanging(self, body: int) -> set[int]:
        """The body and all that is jointed to it, directly or not: a cabinet and its drawers."""
        hanging, todo = {body}, [body]
        while todo:
            more = self._children.get(todo.pop(), set()) - hanging
            hanging |= more
            todo += more
        return hanging

    def on_robot(self, body: int) -> bool:
        """Jointed to the robot, though no part of it: a tool on its flange."""
        return self._root[body] in self.robot and body not in self.robot

    def _end(self, bodies: Sequence[Body], index: dict[str, int], body: int) -> int | None:
        """The last body of the chain that still moves freely, or with the robot; None: none does.

        A chain ends at a body that never moves, at a fixture, or at a parent that is no body of the
        trace (the world); at the robot; or at an object without parent.
        """
        seen: set[int] = set()
        while body not in seen:
            seen.add(body)
            now = bodies[body]
            if not now.movable:
                return None
            if body in self.robot:
                return body
            if now.parent is None:
                return None if now.kind == "fixture" else body
            if now.parent not in index:
                return None
            body = index[now.parent]
        return None


class Bearing(Protocol):
    """Who bears whom, by forces or by geometry; bodies are indices into ``header.bodies``."""

    def beside(self, body: int) -> list[int]:
        """The bodies that may bear it or be borne by it, ascending."""

    def bears(self, bearer: int, borne: int) -> Bool:
        """(T,) true where the first, robot or not, bears the second."""

    def lifted(self, body: int, by: Iterable[int], held: Bool) -> Bool:
        """(T,) true where the others together bear it; where it is ``held`` it may stay open."""


class ByForce:
    """The vertical part of the recorded total force, friction included: no cone and no angle."""

    def __init__(self, episode: Episode, sums: ContactSums, *, sure: bool = False) -> None:
        """``sums``: of the same episode.

        Of a body without a mass any force from ``LEAST_LOAD`` on may bear it, and of a light one what
        is less than a tenth of its weight by no more than rounding; ``sure``: neither does.
        """
        self._sums = sums
        self._frames = len(episode)
        gravity = float(np.linalg.norm(episode.header.gravity))
        self.least = [
            np.inf
            if sure and body.mass is None
            else LEAST_LOAD
            if body.mass is None
            else LEAST_SHARE * body.mass * gravity + (noise if sure else -noise)
            for body, noise in zip(episode.header.bodies, _noise(episode, sums), strict=True)
        ]
        """Per body the upward force in N that bears it."""

    def beside(self, body: int) -> list[int]:
        """The bodies that it has contacts with."""
        return self._sums.beside(body)

    def bears(self, bearer: int, borne: int) -> Bool:
        """(T,) true where the force on it is upward and at least a tenth of its weight."""
        least, upward = self.least[borne], self._sums.upward(borne, bearer)
        if least > 0:
            return upward >= least
        return (upward > 0) | ((upward >= least) & self._sums.recorded(borne, bearer))

    def lifted(self, body: int, by: Iterable[int], held: Bool) -> Bool:  # noqa: ARG002
        """(T,) true where the sum of their forces is, held or not."""
        total = sum((self._sums.upward(body, other) for other in by), np.zeros(self._frames))
        return np.asarray(total >= max(self.least[body], 1e-9))


def _noise(episode: Episode, sums: ContactSums) -> list[float]:
    """N of each body: by how much the sum of forces on it may be wrong; 0 unless it is light.

    A step in which forces were stored counts where it is more than what bears the body.
    """
    gravity, (share, step) = float(np.linalg.norm(episode.header.gravity)), sums.rounding

    def noise(i: int, mass: float) -> float:
        found = step if step > LEAST_SHARE * mass * gravity else 0.0
        if mass < LIGHT:
            most = max((float(sums.normal(i, j).max()) for j in sums.beside(i)), default=0.0)
            found += max(ROUNDING, share) * most
        return found

    return [
        noise(i, body.mass) if body.mass is not None and body.kind == "object" else 0.0
        for i, body in enumerate(episode.header.bodies)
    ]


def faint(episode: Episode, sums: ContactSums) -> list[str]:
    """Names of the bodies that weigh so little that rounding may hide what bears them."""
    gravity = float(np.linalg.norm(episode.header.gravity))
    return [
        body.name
        for body, noise in zip(episode.header.bodies, _noise(episode, sums), strict=True)
        if noise > 0.01 * LEAST_SHARE * (body.mass or 0.0) * gravity
    ]


class SupportGraph:
    """Edges "s bears a", by whatever tells who bears whom.

    A ball in the groove between two cans and a board leaning on a block are supported. The robot
    bears nothing in this sense (an immobile base counts as a fixture); what it bears is
    ``borne_by_robot``.
    """

    def __init__(self, episode: Episode, bearing: Bearing) -> None:
        """Edges are found when a body is asked about: its own, and those of what it rests on."""
        self._bearing = bearing
        self._frames = len(episode)
        self.assemblies = Assemblies(episode.header.bodies)
        self._robot = self.assemblies.robot
        # an articulated fixture (a drawer) is held by its joint, which no contact shows
        self._fixed = self.assemblies.fixed
        self._edges: dict[tuple[int, int], Bool | None] = {}

    def _edge(self, bearer: int, borne: int) -> Bool | None:
        """(T,) true where one bears the other; None if it never does. No robot bears."""
        if bearer in self._robot or borne in self._robot or borne in self._fixed:
            return None
        if (bearer, borne) not in self._edges:
            bears = self._bearing.bears(bearer, borne)
            self._edges[bearer, borne] = bears if bears.any() else None
        return self._edges[bearer, borne]

    def bearers(self, body: int) -> dict[int, Bool]:
        """Bearer → (T,) true where it bears the body directly; only those that ever do."""
        edges = {s: self._edge(s, body) for s in self._bearing.beside(body)}
        return {s: bears for s, bears in edges.items() if bears is not None}

    def load(self, body: int) -> dict[int, Bool]:
        """Body → (T,) true where it rests directly on the given one; only those that ever do."""
        edges = {a: self._edge(body, a) for a in self._bearing.beside(body)}
        return {a: bears for a, bears in edges.items() if bears is not None}

    def jointed(self, body: int) -> dict[int, Bool]:
        """The other parts of the object that it is a part of, each with (T,) true throughout."""
        return dict.fromkeys(self.assemblies.of(body) - {body}, np.ones(self._frames, np.bool_))

    def supports(self, bearer: int, borne: int) -> Bool:
        """(T,) true where the first body bears the second."""
        bears = self._edge(bearer, borne) if borne in self._bearing.beside(bearer) else None
        return np.zeros(self._frames, np.bool_) if bears is None else bears

    def borne_by_robot(self, body: int, held: Bool | None = None) -> Bool:
        """(T,) true where the robot's bodies together bear it; geometry need not tell where held."""
        if self.assemblies.on_robot(body):
            return np.ones(self._frames, np.bool_)
        hands = [r for r in self._bearing.beside(body) if r in self._robot]
        gripped = np.zeros(self._frames, np.bool_) if held is None else held
        return self._bearing.lifted(body, hands, gripped)

    def rests_on(self, body: int, on: int, held: Callable[[int], Bool]) -> Bool:
        """(T,) true where a path of edges leads from one to the other, past no held body."""
        if body == on or body not in self._above(on):
            return np.zeros(self._frames, np.bool_)
        below = self._below(body)
        open_ = self._let_go(
            below, lambda i: held(i) if i != on else np.zeros(self._frames, np.bool_)
        )
        return self._spread(open_, {on: np.ones(self._frames, np.bool_)})[body]

    def _let_go(
        self, below: Mapping[int, Mapping[int, Bool]], held: Callable[[int], Bool]
    ) -> dict[int, Mapping[int, Bool]]:
        """Edges without those that bear a body while it is held."""
        taken = {i: held(i) for i in below if i not in self._fixed}
        return {
            i: {s: bears & ~taken[i] for s, bears in bearers.items()} if i in taken else bearers
            for i, bearers in below.items()
        }

    def supported_without(self, body: int, gone: int) -> Bool:
        """(T,) true where a path of edges leads to a fixture past ``gone``."""
        below = {
            i: {s: b for s, b in at.items() if s != gone} for i, at in self._below(body).items()
        }
        sources = {i: np.ones(self._frames, np.bool_) for i in below if i in self._fixed - {gone}}
        return self._spread(below, sources)[body]

    def supported(self, body: int, held: Callable[[int], Bool] | None = None) -> Bool:
        """(T,) true where a path of edges leads from the body to a fixture, past no ``held`` body."""
        below = self._below(body)
        sources = {i: np.ones(self._frames, np.bool_) for i in below if i in self._fixed}
        free = below if held is None else self._let_go(below, held)
        return self._spread(free, sources)[body]

    def carried(self, body: int, held: Callable[[int], Bool]) -> Bool:
        """(T,) true where a path of edges leads to a body that is held or robot-borne.

        A held body is not itself carried unless the robot also bears its weight. ``held`` gives
        (T,) for a body.
        """
        if body in self._fixed or body in self._robot:
            return np.zeros(self._frames, np.bool_)
        below = self._below(body)
        sources, through = {}, np.zeros(self._frames, np.bool_)
        for i in below:
            if i not in self._fixed:
                grip = held(i)
                borne = self.borne_by_robot(i, grip)
                sources[i] = borne | grip
                if i == body:
                    through = borne.copy()
        reached = self._spread(below, sources)
        for bearer, bears in below[body].items():
            if bearer not in self._fixed:
                through |= bears & reached[bearer]
        return through

    def _below(self, body: int) -> dict[int, dict[int, Bool]]:
        """The body and all that it ever rests on, directly or not, each with its bearers.

        The parts of one object bear each other through their joints.
        """
        below: dict[int, dict[int, Bool]] = {}
        todo = [body]
        while todo:
            i = todo.pop()
            if i not in below:
                below[i] = {**self.bearers(i), **self.jointed(i)}
                todo += below[i]
        return below

    def _above(self, body: int) -> set[int]:
        """The body and all that ever rest on it, directly or not."""
        above: set[int] = set()
        todo = [body]
        while todo:
            i = todo.pop()
            if i not in above:
                above.add(i)
                todo += (*self.load(i), *self.jointed(i))
        return above

    def _spread(
        self, below: Mapping[int, Mapping[int, Bool]], sources: Mapping[int, Bool]
    ) -> dict[int, Bool]:
        """Upward closure: true where the body is a source or rests on one that is reached."""
        reached = {
            i: sources[i].copy() if i in sources else np.zeros(self._frames, np.bool_)
            for i in below
        }
        changed = True
        while changed:  # at most as many rounds as the highest stack has bodies
            changed = False
            for borne, bearers in below.items():
                for bearer, bears in bearers.items():
                    gained = bears & reached[bearer] & ~reached[borne]
                    if gained.any():
                        reached[borne] |= gained
                        changed = True
        return reached
