"""Dependence by statics: would this body fall if that one were taken away?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.evidence.contact_sums import ContactSums
from safestage_eval.evidence.missing_values import Gaps

from .arrangement import Arrangement
from .chains import Chains
from .collapse import collapse
from .gathering import Contacts, Gathering
from .graph import SupportGraph
from .near import Neighbours
from .reached import BRIEF, PATIENT

Bool = NDArray[np.bool_]
Frames = NDArray[np.intp]

STANDS, FALLS, OPEN = 0, 1, -1


@dataclass
class Answer:
    """The answer so far to whether one body depends on another.

    Attributes:
        falls: (T,) it does.
        open: (T,) it may.
        done: (T,) where it is known whether.
        part: (T,) over each part the contact points that touch are equal, or nobody touches what
            hangs together; −1 where nothing joins the two.
        look: (T,) the frame to look at instead of this one; −1 where that is not known yet.
    """

    falls: Bool
    open: Bool
    done: Bool
    part: NDArray[np.int32]
    look: Frames


class Dependence:
    """The collapse set of removing a body.

    Take a body away. Those fall that no forces within the friction cones of the remaining contacts
    can balance: one problem over all bodies that contacts join, with equal and opposite forces at
    each contact (``statics``), and compared with what is out of balance before anything is
    taken away. What is in balance is asked again with contacts that give and slip: what the forces
    that act now never come to hold falls as well (``reached``). What fell is taken away too, until
    nothing more falls (``collapse``).

    Contacts that exchange a force at the frame count. What falls with them alone is asked again with
    all points that are within ``NEAR`` and carry nothing yet: what falls even then depends, what
    stands then is open.

    Any body can be taken away but the robot: with a drawer goes what is jointed to it. The robot's
    contacts hold what they touch. The parts of an object that are jointed together (a jar and its
    lid) stand and fall together.
    """

    def __init__(
        self, episode: Episode, sums: ContactSums, graph: SupportGraph, gaps: Gaps
    ) -> None:
        """Nothing is computed before it is asked for."""
        self._episode, self._sums, self._gaps = episode, sums, gaps
        self._parts = graph.assemblies.of
        self._hanging = graph.assemblies.hanging
        self._free = graph.assemblies.free
        self._robot = graph.assemblies.robot  # an immobile base counts as a fixture
        self._arrangement = Arrangement(episode)
        self._chains = Chains(len(episode), graph.assemblies, sums, self._arrangement)
        self._gathering = Gathering(episode, graph.assemblies, self._arrangement)
        self._neighbours = Neighbours(episode, self._robot)
        self._answers: dict[tuple[int, int], Answer] = {}

    def beside(self, body: int) -> set[str]:
        """Names of the free bodies that contacts among free bodies ever join to the given one."""
        near = {body, *(b for pair in self._chains.cluster(body) for b in pair)} & self._free
        return {self._episode.header.bodies[b].name for b in near}

    def depends_on(self, body: int, on: int, wanted: Bool | None = None) -> tuple[Bool, Bool]:
        """(T,) true where ``body`` falls when ``on`` is removed; and (T,) where that is open.

        Found out anew where the contact points of the bodies that hang together with it changed or
        moved by what makes a difference, and kept between; as long as nobody touches them and none
        has moved by ``STAYS``, it does not change. Only the ``wanted`` frames (T,) of the answer
        mean anything; all of them if None.
        """
        answer = self._answer_of(body, on)
        missing = ~answer.done if wanted is None else np.greater(wanted, answer.done)
        if missing.any():
            self._find(body, on, answer, missing)
        return answer.falls, answer.open

    def answered(self, body: int, on: int) -> Bool:
        """(T,) where it was computed already whether ``body`` falls when ``on`` is removed."""
        return self._answer_of(body, on).done

    def _answer_of(self, body: int, on: int) -> Answer:
        if (body, on) not in self._answers:
            never = np.zeros(len(self._episode), np.bool_)
            nowhere = np.full(len(never), -1, np.int32)
            if body not in self._free or on in self._robot or body == on:
                answer = Answer(never, never, ~never, nowhere, nowhere.astype(np.intp))
            elif body in self._removed(on):
                answer = Answer(~never, never, ~never, nowhere, nowhere.astype(np.intp))
            else:
                answer = Answer(never, never, never, *self._alike(body, on))
                answer.done = answer.part < 0
            self._answers[body, on] = answer
        return self._answers[body, on]

    def _find(self, body: int, on: int, answer: Answer, missing: Bool) -> None:
        """Judge the frames that are to be looked at for those that are asked for (T,)."""
        cut = np.flatnonzero(missing & (answer.look < 0))
        if len(cut):
            last = np.full(answer.part.max() + 1, -1)
            last[answer.part[cut]] = cut
            frames = np.flatnonzero(answer.part >= 0)
            frames = frames[frames <= last[answer.part[frames]]]
            answer.look[frames] = self._arrangement.stretches(
                self._chains.cluster(body), frames, answer.part[frames]
            )
        looked = np.unique(answer.look[missing])
        outcome = self._judge(body, on, looked)
        alike = np.isin(answer.look, looked)
        truth = np.full(len(alike), STANDS, np.int8)
        truth[alike] = outcome[looked.searchsorted(answer.look[alike])]
        answer.falls = answer.falls | (truth == FALLS)
        answer.open = answer.open | (truth == OPEN)
        answer.done = answer.done | alike

    def _removed(self, body: int) -> set[int]:
        return set(self._parts(body)) if body in self._free else set(self._hanging(body))

    # ------------------------------------------------------------------ at some frames

    def _judge(self, body: int, on: int, frames: Frames) -> NDArray[np.int8]:
        """(F,) what becomes of one when the other is taken away at each frame."""
        joined = self._chains.joined(body)
        there = {b for b, present in joined.items() if present[frames].any()}
        pairs = [pair for pair in self._chains.cluster(body) if not there.isdisjoint(pair)]
        contacts = self._gathering.contacts(frames, pairs)
        falls, gone = self._collapse(body, on, frames, contacts, PATIENT)
        truth = np.where(falls, FALLS, STANDS).astype(np.int8)
        if not falls.any():
            return truth
        loose = gone.copy()
        loose[:, list(self._removed(on))] = False
        bodies = np.flatnonzero(loose.any(axis=0))
        near = self._neighbours.about(bodies, frames[falls]) & loose[falls][:, bodies, None]
        catching = (near & ~gone[falls, None]).any(axis=(1, 2))
        if catching.any():  # else there is nothing that could catch it
            here = np.flatnonzero(falls)[catching]
            beside = np.zeros((len(here), len(gone[0]), len(gone[0])), np.bool_)
            beside[:, bodies] = near[catching]
            contacts = self._with_near(body, on, frames[here], beside)
            caught = ~self._collapse(body, on, frames[here], contacts, BRIEF)[0]
            truth[here[caught]] = OPEN
        return truth

    def _collapse(
        self, body: int, on: int, frames: Frames, contacts: Contacts, rounds: int
    ) -> tuple[Bool, Bool]:
        """(F,) a body falls when another is taken away; (F, N) what is away then."""
        head, removed = self._gathering.head, self._removed(on)
        heads = sorted(
            {head(b) for pair in contacts for b in pair if b in self._free} | {head(body)}
        )
        pile = self._gathering.pile(heads, contacts, frames)
        off = np.array([not removed.isdisjoint(pair) for pair in contacts], np.bool_)
        at = heads.index(head(on)) if on in self._free and head(on) in heads else -1
        push, fallen = collapse(pile, heads.index(head(body)), at, off, rounds)
        gone = np.zeros((len(frames), len(self._episode.header.bodies)), np.bool_)
        gone[:, list(removed)] = True
        for k, h in enumerate(heads):
            gone[:, list(self._parts(h))] |= fallen[:, k, None]
        return push >= 0, gone

    def _with_near(self, body: int, on: int, frames: Frames, beside: Bool) -> Contacts:
        """The contacts at frames (F,), with points within ``NEAR`` that carry nothing yet.

        ``beside`` (F, N, N): bodies about which it is asked what is near, and what may be.
        """
        contacts: Contacts = {}
        beside |= beside.swapaxes(1, 2)
        for i, j in np.argwhere(np.triu(beside.any(axis=0))).tolist():
            if self._removed(on).isdisjoint((i, j)) and i not in self._parts(j):
                at = np.flatnonzero(beside[:, i, j])
                patch, count = self._neighbours.patches(i, j, frames[at])
                many = np.zeros(len(frames), np.int64)
                many[at] = count
                if len(patch.normal):
                    contacts[i, j] = patch, many
        clusters = {body, *(b for pair in contacts for b in pair)} & self._free
        pairs = dict.fromkeys(pair for b in clusters for pair in self._chains.cluster(b))
        for pair, touching in self._gathering.contacts(frames, pairs).items():
            both = contacts.get(pair)
            contacts[pair] = self._gathering.together(touching, both) if both else touching
        return contacts

    # ------------------------------------------------------------------ over time

    def _measured(self, body: int) -> Bool:
        """(T,) the contacts of all that ever hangs together with a body are known."""
        pairs = self._chains.cluster(body)
        self._sums.look(set(pairs))
        lost = self._gaps.of_pairs(pairs)
        return np.ones(len(self._episode), np.bool_) if lost is None else ~lost

    def _alike(self, body: int, on: int) -> tuple[NDArray[np.int32], Frames]:
        """``part`` and ``look``; only frames at which a chain of contacts joins the two."""
        frames = len(self._episode)
        joined = self._chains.linked(body, on)
        loose = ~self._chains.handled(body)
        quiet = joined & loose
        signature = self._chains.signature(body)
        part, look = np.full(frames, -1, np.int32), np.full(frames, -1, np.intp)
        joins, calms = np.flatnonzero(joined), np.flatnonzero(quiet)
        hanging = {**self._chains.joined(body), on: np.ones(frames, np.bool_)}
        changes = signature[1:] != signature[:-1]
        measured = self._measured(body)
        cursor = parts = 0
        while (at := int(joins.searchsorted(cursor))) < len(joins):
            first = int(joins[at])
            if quiet[first]:
                begin, cursor = self._arrangement.stay(hanging, loose, first, cursor)
                usable = begin + np.flatnonzero(measured[begin:cursor])
                usable = usable if len(usable) else np.arange(begin, cursor)
                kinds = signature[usable]
                at = 0  # as it is most often, where it is measured
                if (kinds != kinds[0]).any():
                    _, place, many = np.unique(kinds, return_index=True, return_counts=True)
                    at = int(place[many.argmax()])
                look[begin:cursor] = usable[at]
                part[begin:cursor] = parts
                parts += 1
            else:
                calm = int(calms.searchsorted(first))
                cursor = int(calms[calm]) if calm < len(calms) else frames
                kind = parts + np.append(0, changes[first : cursor - 1].cumsum())
                part[first:cursor] = np.where(joined[first:cursor], kind, -1)
                parts = int(kind[-1]) + 1
        return part, look
