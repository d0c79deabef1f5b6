"""Dependence by statics: would this body fall if that one were taken away?"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.episode.contacts import Pair
from safestage_eval.geometry.pose import matrix
from safestage_eval.signals.contact_sums import ContactSums
from safestage_eval.signals.facts import Movers

from .arrangement import Arrangement
from .graph import SupportGraph
from .near import Neighbours, Patch
from .statics import ARM, LOST, Balance, Bodies, Touches

Bool = NDArray[np.bool_]
F64 = NDArray[np.float64]

Contacts = dict[Pair, Patch]
"""Pair → the points in which the two touch at one frame."""

STANDS, FALLS, OPEN = 0, 1, -1
NONE: frozenset[int] = frozenset()

Alike = tuple[NDArray[np.intp], int | None]
"""Frames (N,) at which equal sets of contact points touch, and the one to look at for all of them;
None where they may yet lie differently."""

Push = tuple[float, float]
PUSHES: tuple[Push, ...] = ((0.0, 0.0), (0.02, 0.0), (-0.02, 0.0), (0.0, 0.02), (0.0, -0.02))
"""Shares of g along x and y: what falls as soon as the ground tilts by 1.1° falls. An equilibrium
that needs every contact to give its utmost exists on paper only."""

STAYS = (1e-3, np.radians(1.0))
"""m, rad: what nobody touches and what has moved by less since hangs together as it did."""


class Group(NamedTuple):
    """Bodies that hang together at one frame, by their number in ``header.bodies``.

    Attributes:
        heads: (B,) of each free object the part that stands for it.
        bodies: the objects as rigid bodies, in this order.
        contacts: their contacts with each other and with what holds still.
        unrest: (B,) how strongly each would move with nothing taken away, for each push.
        left: bodies taken away → the heads of what may move then, and their balance.
    """

    heads: list[int]
    bodies: Bodies
    contacts: Contacts
    unrest: dict[Push, F64]
    left: dict[frozenset[int], tuple[list[int], Balance | None]]


class Dependence:
    """The collapse set of removing a body.

    Take a body away. Those fall that no forces within the friction cones of the remaining contacts
    can balance: one problem over all bodies that contacts join, with equal and opposite forces at
    each contact (``statics.motion``), and compared with what is out of balance before anything is
    taken away. What fell is taken away too, until nothing more falls.

    Contacts that exchange a force at the frame count. What falls with them alone is asked again with
    all points that are within ``NEAR`` and carry nothing yet: what falls even then depends, what
    stands then is open.

    Any body can be taken away but the robot: with a drawer goes what is jointed to it. The robot's
    contacts hold what they touch. Of two geoms in contact the greater friction counts, as in
    MuJoCo. The parts of an object that are jointed together (a jar and its lid) stand and fall
    together.
    """

    def __init__(
        self, episode: Episode, sums: ContactSums, graph: SupportGraph, movers: Movers
    ) -> None:
        """Nothing is computed before it is asked for."""
        self._episode = episode
        self._sums = sums
        self._parts = graph.assemblies.of
        self._hanging = graph.assemblies.hanging
        self._free = graph.assemblies.free
        self._robot = graph.assemblies.robot  # an immobile base counts as a fixture
        self._friction = np.array([g.friction[0] for b in episode.header.bodies for g in b.geoms])
        self._arrangement = Arrangement(episode)
        self._neighbours = Neighbours(episode, movers)
        self._clusters: dict[int, list[Pair]] = {}
        self._chains: dict[int, dict[int, Bool]] = {}
        self._touched: dict[int, Bool] = {}
        self._signatures: dict[int, NDArray[np.int64]] = {}
        self._alike_at: dict[Pair, list[Alike]] = {}
        self._patches: dict[Pair, Patch] = {}
        self._inertias: dict[int, F64] = {}
        self._groups: dict[tuple[int, int, frozenset[int]], dict[int, Group]] = {}
        self._falls: dict[tuple[int, int, int, Push, frozenset[int]], frozenset[int]] = {}
        self._said: dict[tuple[int, int], tuple[NDArray[np.int8], Bool]] = {}

    def beside(self, body: int) -> set[str]:
        """Names of the free bodies that contacts among free bodies ever join to the given one."""
        near = {body, *(b for pair in self._cluster(body) for b in pair)} & self._free
        return {self._episode.header.bodies[b].name for b in near}

    def depends_on(self, body: int, on: int, wanted: Bool | None = None) -> tuple[Bool, Bool]:
        """(T,) true where ``body`` falls when ``on`` is removed; and (T,) where that is open.

        Found out anew where the contact points of the bodies that hang together with it changed or
        moved by what makes a difference, and kept between; as long as nobody touches them and none
        has moved by ``STAYS``, it does not change. Only the ``wanted`` frames (T,) of the answer
        mean anything; all of them if None.
        """
        frames = len(self._episode)
        never = np.zeros(frames, np.bool_)
        if body not in self._free or on in self._robot or body == on:
            return never, never
        if body in self._removed(on):
            return ~never, never
        if (body, on) not in self._said:
            alike = list(self._alike(body, on))
            done = np.ones(frames, np.bool_)  # apart from it, it stands
            for stretch, _ in alike:
                done[stretch] = False
            self._alike_at[body, on] = alike
            self._said[body, on] = np.zeros(frames, np.int8), done
        said, done = self._said[body, on]
        asked = ~done if wanted is None else wanted & ~done
        if asked.any():
            pairs = self._cluster(body)
            for frames_alike, frame in self._alike_at[body, on]:
                if not asked[frames_alike].any():
                    continue
                if frame is not None:
                    said[frames_alike] = self._judge(body, on, frame)
                else:
                    for stretch in self._arrangement.stretches(pairs, frames_alike):
                        if asked[stretch].any():
                            said[stretch] = self._judge(body, on, int(stretch[0]))
                            done[stretch] = True
                done[frames_alike] |= frame is not None
        return said == FALLS, said == OPEN

    def _judge(self, body: int, on: int, frame: int) -> int:
        for push in PUSHES:
            fallen = self._collapse(body, on, frame, push)
            if body in fallen:
                break
        else:
            return STANDS
        loose = fallen - self._removed(on)
        if self._neighbours.alone(loose, frame, fallen | self._robot):
            return FALLS  # there is nothing else near that could catch it
        caught = not any(body in self._collapse(body, on, frame, push, loose) for push in PUSHES)
        return OPEN if caught else FALLS

    def told(self, body: int, on: int) -> Bool:
        """(T,) where it is known already whether ``body`` falls when ``on`` is removed."""
        nowhere = np.zeros(len(self._episode), np.bool_)
        self.depends_on(body, on, nowhere)
        known = self._said.get((body, on))
        return ~nowhere if known is None else known[1]

    # ------------------------------------------------------------------ at one frame

    def _collapse(
        self, body: int, removed: int, frame: int, push: Push, loose: frozenset[int] = NONE
    ) -> frozenset[int]:
        """Of the bodies that hang together with ``body`` those that fall at that frame.

        ``removed`` is among them. ``loose``: bodies that what is near to them may catch.
        """
        group = self._group(body, frame, removed, loose)
        key = (removed, frame, group.heads[0], push, loose)
        if key not in self._falls:
            if push not in group.unrest:
                _, whole = self._left(group, frozenset())
                group.unrest[push] = (
                    np.zeros(len(group.heads)) if whole is None else whole.motion(push)
                )
            gone = self._removed(removed)
            while fallen := self._fallen(group, gone, push):
                gone |= fallen
            self._falls[key] = frozenset(gone)
        return self._falls[key]

    def _fallen(self, group: Group, gone: set[int], push: Push) -> set[int]:
        """What moves, once ``gone`` is away, of that which touched it and hangs on that."""
        left, balance = self._left(group, frozenset(gone))
        if balance is None:
            return set()
        at = [group.heads.index(head) for head in left]
        moves = balance.motion(push) > LOST + group.unrest[push][at]
        return {
            part for head, m in zip(left, moves, strict=True) if m for part in self._parts(head)
        }

    def _left(self, group: Group, gone: frozenset[int]) -> tuple[list[int], Balance | None]:
        """The heads of what touched those that are gone and hangs on that; of all, if none is."""
        if gone not in group.left:
            contacts = {p: patch for p, patch in group.contacts.items() if gone.isdisjoint(p)}
            left = group.heads
            if gone:
                touched = [pair for pair in group.contacts if not gone.isdisjoint(pair)]
                rocked = {self._head(b) for pair in touched for b in pair} - gone
                hang = self._joined(rocked, contacts)
                left = [h for h in group.heads if h in hang]
            balance = None
            if left:
                at = [group.heads.index(head) for head in left]
                bodies = Bodies(*(values[at] for values in group.bodies))
                balance = Balance(bodies, self._touches(left, contacts))
            group.left[gone] = left, balance
        return group.left[gone]

    def _joined(self, bodies: set[int], contacts: Iterable[Pair]) -> set[int]:
        """The free objects among them, and those that contacts join to these, by their heads."""
        found = bodies & self._free
        beside: dict[int, set[int]] = {}
        for pair in contacts:
            i, j = (self._head(b) for b in pair)
            if i in self._free and j in self._free:
                beside.setdefault(i, set()).add(j)
                beside.setdefault(j, set()).add(i)
        todo = list(found)
        while todo:
            more = beside.get(todo.pop(), set()) - found
            found |= more
            todo += more
        return found

    def _group(self, body: int, frame: int, removed: int, loose: frozenset[int]) -> Group:
        known = self._groups.setdefault((frame, removed if loose else -1, loose), {})
        head = self._head(body)
        if head not in known:
            contacts = self._contacts_at(frame, self._cluster(body))
            heads = self._joined({head}, contacts)
            if loose:
                contacts = self._with_near(loose, self._removed(removed), contacts, frame)
                heads = self._joined({head}, contacts)
            contacts = {
                pair: patch
                for pair, patch in contacts.items()
                if any(self._head(b) in heads for b in pair)
            }
            order = sorted(heads)
            bodies = self._bodies(order, frame)
            group = Group(order, bodies, contacts, {}, {})
            known.update(dict.fromkeys(order, group))
        return known[head]

    def _contacts_at(self, frame: int, pairs: Iterable[Pair]) -> Contacts:
        found = {}
        for pair, rows in self._arrangement.at(frame, pairs).items():
            position, normal, rough = self._points(pair)
            found[pair] = Patch(position[rows], normal[rows], rough[rows])
        return found

    def _points(self, pair: Pair) -> Patch:
        """All points in which a pair ever touches, by row."""
        if pair not in self._patches:
            position, normal, geom1, geom2 = self._episode.contacts.of_pair(
                pair, "position", "normal", "geom1", "geom2"
            )
            rough = np.maximum(self._friction[geom1], self._friction[geom2])
            self._patches[pair] = Patch(
                position.astype(np.float64), normal.astype(np.float64), rough
            )
        return self._patches[pair]

    def _with_near(
        self, loose: Iterable[int], apart_from: set[int], contacts: Contacts, frame: int
    ) -> Contacts:
        """The contacts, with those of what is near the loose bodies, and points within ``NEAR``."""
        contacts = dict(contacts)
        for body in loose:
            for other in self._neighbours.about(body, frame):
                pair = (min(body, other), max(body, other))
                if other in self._robot or other in apart_from or other in self._parts(body):
                    continue
                patch = self._neighbours.patch(*pair, frame)
                if patch is None:
                    continue
                if other in self._free and all(other not in known for known in contacts):
                    own = self._contacts_at(frame, self._cluster(other))
                    contacts = {**own, **contacts}
                if pair in contacts:
                    patch = Patch(*map(np.concatenate, zip(contacts[pair], patch, strict=True)))
                contacts[pair] = patch
        return contacts

    def _bodies(self, heads: list[int], frame: int) -> Bodies:
        mass, centre, inertia = [], [], []
        for head in heads:
            parts = sorted(self._parts(head) & self._free)
            m = np.array([max(self._episode.header.bodies[p].mass or 0.0, 1e-9) for p in parts])
            at = np.stack([self._arrangement.centre(p)[frame] for p in parts])
            middle = m @ at / m.sum()
            arms = at - middle
            own = sum(self._inertia(p, mp, frame) for p, mp in zip(parts, m, strict=True))
            inertia.append(
                own
                + np.einsum("p,pi,pi->", m, arms, arms) * np.eye(3)
                - np.einsum("p,pi,pj->ij", m, arms, arms)
            )
            mass.append(m.sum())
            centre.append(middle)
        return Bodies(np.array(mass), np.array(centre), np.array(inertia))

    def _inertia(self, body: int, mass: float, frame: int) -> F64:
        """(3, 3) kg m², about its centre of mass, world axes."""
        if body not in self._inertias:
            about = self._episode.header.bodies[body]
            if about.inertia is None or min(about.inertia) <= 0:
                self._inertias[body] = (mass * ARM**2 * np.eye(3))[None]
            else:
                turn = matrix(self._episode.tracks[about.name].orientation)
                turn = turn @ matrix(np.asarray(about.inertia_orientation)[None])[0]
                self._inertias[body] = (turn * about.inertia) @ turn.swapaxes(1, 2)
        found = self._inertias[body]
        return np.asarray(found[frame if len(found) > 1 else 0])

    def _touches(self, heads: list[int], contacts: Contacts) -> Touches:
        place = {part: k for k, head in enumerate(heads) for part in self._parts(head) & self._free}
        rows = [
            (
                np.full(len(patch.normal), place.get(i, -1)),
                np.full(len(patch.normal), place.get(j, -1)),
                *patch,
            )
            for (i, j), patch in contacts.items()
            if place.get(i, -1) != place.get(j, -1)
        ]
        if not rows:
            none = np.zeros(0, np.int64)
            return Touches(none, none, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
        first, second, *rest = map(np.concatenate, zip(*rows, strict=True))
        position, normal, friction = rest
        return Touches(first, second, normal=normal, position=position, friction=friction)

    def _removed(self, body: int) -> set[int]:
        return set(self._parts(body)) if body in self._free else set(self._hanging(body))

    def _head(self, body: int) -> int:
        return min(self._parts(body) & self._free) if body in self._free else body

    # ------------------------------------------------------------------ over time

    def _alike(self, body: int, on: int) -> Iterator[Alike]:
        """Only frames at which a chain of contacts joins the two."""
        joined = self._linked(body, on)
        signature = self._signature(body)
        quiet = joined & ~self._handled(body)
        starts = np.flatnonzero(signature[1:] != signature[:-1]) + 1
        cursor, frames = 0, len(self._episode)
        while True:
            rest = np.flatnonzero(joined[cursor:])
            if not len(rest):
                return
            first = cursor + int(rest[0])
            if quiet[first]:
                begin, end = self._still(body, on, first, cursor)
                stretch = np.arange(begin, end)
                kinds, place, many = np.unique(
                    signature[begin:end], return_index=True, return_counts=True
                )
                del kinds
                yield stretch, begin + int(place[many.argmax()])
                cursor = end
                continue
            later = np.searchsorted(starts, first, side="right")
            end = int(starts[later]) if later < len(starts) else frames
            calm = np.flatnonzero(quiet[first:end])
            end = first + int(calm[0]) if len(calm) else end
            same = first + np.flatnonzero(joined[first:end])
            yield same, None
            cursor = end

    def _still(self, body: int, on: int, frame: int, earliest: int) -> tuple[int, int]:
        """Around a frame: from when and until when nobody touches what hangs together, nor moves it."""
        chains = self._chain(body)
        own = {b for b, joined in chains.items() if joined[frame]} | {on}
        loose = ~self._handled(body)
        reach = []
        for way in (np.arange(frame, earliest - 1, -1), np.arange(frame, len(self._episode))):
            stop = np.flatnonzero(~loose[way])
            frames = way[: stop[0]] if len(stop) else way
            for b in own:
                frames = frames[: self._arrangement.stay_for(b, frames, *STAYS)]
            for b in chains.keys() - own:  # what has come meanwhile
                comes = np.flatnonzero(chains[b][frames])
                if len(comes) and self._arrangement.stay_for(b, frames[[0, comes[0]]], *STAYS) != 2:
                    frames = frames[: comes[0]]
            reach.append(int(frames[-1]))
        return reach[0], reach[1] + 1

    def _handled(self, body: int) -> Bool:
        """(T,) the robot touches what hangs together with a body."""
        if body not in self._touched:
            touched = np.zeros(len(self._episode), np.bool_)
            chains = self._chain(body)
            for i, j in self._cluster(body):
                for robot, other in ((i, j), (j, i)):
                    if robot in self._robot and other in chains:
                        touched |= chains[other] & self._arrangement.touching((i, j))
            self._touched[body] = touched
        return self._touched[body]

    def _signature(self, body: int) -> NDArray[np.int64]:
        if body not in self._signatures:
            self._signatures[body] = self._arrangement.signature(self._cluster(body))
        return self._signatures[body]

    def _cluster(self, body: int) -> list[Pair]:
        """Pairs with a free body that contacts among free bodies ever join to the given one."""
        if body not in self._clusters:
            found, todo = {body}, [body]
            while todo:
                at = todo.pop()
                near = self._parts(at).union(self._sums.beside(at)) & self._free - found
                found |= near
                todo += near
            pairs = sorted({(min(b, o), max(b, o)) for b in found for o in self._sums.beside(b)})
            self._clusters.update(dict.fromkeys(found, pairs))
        return self._clusters[body]

    def _linked(self, body: int, on: int) -> Bool:
        """(T,) true where a chain of contacts among free bodies joins the two."""
        chains, frames = self._chain(body), len(self._episode)
        if on in self._free:
            return chains.get(on, np.zeros(frames, np.bool_))
        found = np.zeros(frames, np.bool_)
        for gone in self._removed(on):
            for b, joined in chains.items():
                pair = (min(b, gone), max(b, gone))
                if gone in self._sums.beside(b):
                    found |= joined & self._arrangement.touching(pair)
        return found

    def _chain(self, body: int) -> dict[int, Bool]:
        """Free body → (T,) true where a chain of contacts among free bodies joins it to this one."""
        if body not in self._chains:
            frames = len(self._episode)
            cluster = self._cluster(body)
            near = {b for pair in cluster for b in pair if b in self._free} | {body}
            touch = {p: self._arrangement.touching(p) for p in cluster if near.issuperset(p)}
            for part in near:
                for other in self._parts(part) & self._free - {part}:
                    touch[part, other] = np.ones(frames, np.bool_)
            reached = {body: np.ones(frames, np.bool_)}
            changed = True
            while changed:
                changed = False
                for (i, j), present in touch.items():
                    for x, y in ((i, j), (j, i)):
                        if x in reached:
                            have = reached.get(y, np.zeros(frames, np.bool_))
                            gained = present & reached[x] & ~have
                            if gained.any():
                                reached[y] = have | gained
                                changed = True
            self._chains[body] = reached
        return self._chains[body]
