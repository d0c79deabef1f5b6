"""The search for the measurement behind a margin."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safestage_eval.evidence.series import Series
from safestage_eval.rules import syntax as ast
from safestage_eval.signals import SIGNALS
from safestage_eval.states.band import Band, Bool

from . import hidden_start
from .evaluate import Evaluator
from .values import Env, limit_margin
from .witness import Witness

ALIKE = 1e-4
"""Normalised margins that differ by this share are alike: poses are stored as float32, and an ulp of
6e-8 m within the 0.1 s of a mean speed is 6e-5 of a limit of 1 cm/s."""

_OPPOSITE = {">=": "<", "<=": ">", ">": "<=", "<": ">="}


class Search(NamedTuple):
    """Follows one end of a margin band down to the atom it was selected from.

    And is a minimum, or a maximum, persistence a minimum or maximum over nearby frames: all of
    them only select, so the decisive margin is found again, bit for bit. Of atoms whose margins are
    alike the first one in the rule's order is taken, or rounding would choose between them.

    Attributes:
        evaluator: that computed the margin.
        upper: which end of the band is followed.
        sign: +1 where the atom should hold, −1 where it should not.
    """

    evaluator: Evaluator
    upper: bool
    sign: int = 1

    def end(self, band: Band, frame: int) -> float:
        """The margin that is followed, at one frame."""
        return float((band.upper if self.upper else band.lower)[frame])

    @property
    def asks(self) -> str:
        """``Witness.needs`` of a relation."""
        return "true" if self.sign > 0 else "false"

    def _only(self, frame: int) -> Bool:
        mask = np.zeros(self.evaluator.frames, np.bool_)
        mask[frame] = True
        return mask

    def _opposite(self) -> Search:
        return Search(self.evaluator, not self.upper, -self.sign)

    def alternative(self, node: ast.Alternative, env: Env, frame: int) -> Witness:
        """Witness of a condition or event at a frame."""
        if isinstance(node, ast.Condition):
            if len(node.atoms) == 1:
                return self.atom(node.atoms[0], env, frame)
            here = self._only(frame)
            margins = self._margins(node, env, frame, here)
            witness = self.atom(node.atoms[_least(margins)], env, frame)
            return witness.or_tied(margins, min(margins))
        if node.call is None:
            return Witness(node.kind, (), frame, needs=self.asks)
        if node.edge is None:
            return self.state(node.call, env, frame)
        bodies = tuple([env.get(arg, arg) for arg in node.call.args])
        event = f"{node.edge} of {ast.Call(node.call.name, bodies)}"
        return Witness(event, bodies, frame, needs=self.asks)

    def _margins(self, node: ast.Condition, env: Env, frame: int, here: Bool) -> list[float]:
        """The end that is followed, of each atom; a gate counts only where the rest holds."""
        plain, gates = self.evaluator.costly.split(node)
        if not gates:
            return [self._margin(a, env, frame, here) for a in node.atoms]
        margins = {id(a): self._margin(a, env, frame, here) for a in plain.atoms}
        holds = min(margins.values()) >= 0
        for gate in gates:
            margins[id(gate)] = self._margin(gate, env, frame, here) if holds else np.inf
        return [margins[id(a)] for a in node.atoms]

    def _margin(self, atom: ast.Atom, env: Env, frame: int, here: Bool) -> float:
        """The end that is followed, of an atom; ``here``: (T,) true at the frame alone."""
        return self.end(self.evaluator.atom(atom, env, here), frame)

    def atom(self, atom: ast.Atom, env: Env, frame: int) -> Witness:
        """Witness of one atom at a frame."""
        if isinstance(atom, ast.SignalAtom):
            return self._signal(atom, env, frame)
        if isinstance(atom, ast.StateAtom):
            search = self if atom.want else self._opposite()
            return search.state(atom.call, env, frame)
        if isinstance(atom, ast.CountAtom):
            search = self if atom.bound == "least" else self._opposite()
            count = atom.count if atom.bound == "least" else atom.count + 1
            bodies = list(self.evaluator.players.get(atom.role, ()))
            margins = [
                search.end(self.evaluator.state(atom.call, {**env, atom.role: b}), frame)
                for b in bodies
            ]
            if not 1 <= count <= len(bodies):
                return Witness(str(atom.call), tuple(bodies), frame, needs=search.asks)
            decisive = bodies[int(np.argsort(margins)[-count])]
            return search.state(atom.call, {**env, atom.role: decisive}, frame)
        if isinstance(atom, ast.PastAtom):
            return (self if atom.want else self._opposite()).as_it_was(atom, env, frame)
        if isinstance(atom, ast.PairAtom):
            return (self if atom.want else self._opposite()).compared(atom, env, frame)
        here = self._only(frame)
        margins = [
            self.end(self.evaluator.alternative(a, env, here), frame) for a in atom.alternatives
        ]
        greatest = _least([-margin for margin in margins])
        witness = self.alternative(atom.alternatives[greatest], env, frame)
        return witness.or_tied(margins, max(margins))

    def as_it_was(self, atom: ast.PastAtom, env: Env, frame: int) -> Witness:
        """Witness of a state as it was: at the latest sample that has the margin."""
        evaluator = self.evaluator
        margin = self.end(evaluator.of_states(atom, env), frame)
        firsts, stops = evaluator.looks(atom)
        first, stop = int(firsts[frame]), int(stops[frame])
        parts = [(atom.call, first, stop)]
        if atom.begun is not None:
            parts = [(atom.begun, first, stop), (atom.call, first + 1, frame + 1)]
        for call, begin, end in parts:
            band = evaluator.must_not(call, env)
            some = (band.upper if self.upper else band.lower)[begin:end]
            same = np.flatnonzero(some == margin)
            if len(same):
                return self.state(call, env, begin + int(same[-1]))
        return Witness(str(atom.call), self._bodies(atom.call, env), frame, needs=self.asks)

    def compared(self, atom: ast.PairAtom, env: Env, frame: int) -> Witness:
        """Witness of two states that are compared: the one whose margin it is."""
        margin = self.end(self.evaluator.of_states(atom, env), frame)
        for call in (atom.call, atom.other):
            band = self.evaluator.must_not(call, env)
            for upper, end in ((False, band.lower), (True, band.upper)):
                if end[frame] == margin:
                    return Search(self.evaluator, upper, self.sign).state(call, env, frame)
                if end[frame] == -margin:
                    return Search(self.evaluator, upper, -self.sign).state(call, env, frame)
        return Witness(str(atom.call), self._bodies(atom.call, env), frame, needs=self.asks)

    @staticmethod
    def _bodies(call: ast.Call, env: Env) -> tuple[str, ...]:
        return tuple([env.get(arg, arg) for arg in call.args])

    def state(self, call: ast.Call, env: Env, frame: int) -> Witness:
        """Witness of a state: of a declared one, what it was derived from."""
        evaluator = self.evaluator
        bodies = tuple([env.get(arg, arg) for arg in call.args])
        state = evaluator.rules.states.get(call.name)
        if state is None:
            return Witness(str(ast.Call(call.name, bodies)), bodies, frame, needs=self.asks)
        inner = dict(zip(state.of, bodies, strict=True))
        source = state.when
        if evaluator.asks_costly(ast.StateAtom(call, True)):
            return self.alternative(source, inner, self.source(state, call, env, inner, frame))
        margin = self.end(evaluator.must_not(call, env), frame)
        if state.fallback is None:
            band = evaluator.momentary(call.name, bodies)
        else:
            band = evaluator.condition(source, inner)
        if state.fallback is not None and not band.any_known:
            source = state.fallback
            if self.upper and state.perhaps is not None:
                source = state.perhaps
            band = evaluator.condition(source, inner)
        same = ((band.upper if self.upper else band.lower) == margin).nonzero()[0]
        brief = None if len(same) or evaluator.causal else state.also
        if brief is not None and self.end(evaluator.also(state, inner), frame) == margin:
            return self.alternative(brief, inner, frame)
        if len(same):
            frame = int(same[np.argmin(np.abs(same - frame))])
        return self.alternative(source, inner, frame)

    def source(self, state: ast.StateDef, call: ast.Call, env: Env, inner: Env, frame: int) -> int:
        """The nearest frame at which what a state is made of has its margin of a frame.

        As the state asks for something costly, it is looked for at the frame first, then as far
        around it as the state looks to make it last, and only then everywhere.
        """
        evaluator, here = self.evaluator, self._only(frame)
        margin = self.end(evaluator.must_not(call, env, wanted=here), frame)
        for wanted in (here, evaluator.around(state, here), np.ones(evaluator.frames, np.bool_)):
            band = evaluator.condition(state.when, inner, wanted)
            same = (wanted & ((band.upper if self.upper else band.lower) == margin)).nonzero()[0]
            if len(same):
                return int(same[np.argmin(np.abs(same - frame))])
        return frame

    def _signal(self, atom: ast.SignalAtom, env: Env, frame: int) -> Witness:
        series = self.evaluator.series(atom, env, self._only(frame)).at(frame)
        return self.of_signal(atom, env, series, frame)

    def of_signal(self, atom: ast.SignalAtom, env: Env, series: Series, frame: int) -> Witness:
        """Witness of a signal at a frame; ``series``: it at that frame alone."""
        evaluator = self.evaluator
        name, bodies, _, limits, _ = evaluator.asked(atom, env)
        margins = [
            self.end(limit_margin(series, limit.op, number, 1.0), 0)
            for limit, number in zip(atom.limits, limits, strict=True)
        ]
        i = int(np.argmin(margins)) if len(margins) > 1 else 0
        said = tuple([env.get(arg, arg) for arg in atom.call.args])
        value, limit = float(series.value[0]), limits[i]
        op = atom.limits[i].op
        direction = 1 if op[0] == ">" else -1
        finite = bool(np.isfinite(value))
        from_ = "" if self._not_yet(atom, env, frame) else since(atom, env)
        return Witness(
            f"{ast.Call(atom.call.name, said)}{from_}",
            bodies,
            frame,
            value if finite else None,
            limit,
            self.sign * direction * (value - limit) if finite else None,
            series.dimension,
            name,
            at_least=finite and bool(np.isposinf(series.upper[0])),
            needs=op if self.sign > 0 else _OPPOSITE[op],
            bearers=self._bearers(name, bodies, frame),
        )

    def _bearers(self, name: str, bodies: tuple[str, ...], frame: int) -> tuple[str, ...]:
        """Support of a body at a frame, for signals that measure against their support by default."""
        spec, relations = SIGNALS.get(name), self.evaluator.relations
        if spec is None or not spec.support or len(bodies) != 1 or len(spec.args) != 2:
            return ()
        return relations.bearers(bodies[0], frame)

    def _not_yet(self, atom: ast.SignalAtom, env: Env, frame: int) -> bool:
        """The robot has had nothing to do with the body: it is measured from the baseline."""
        if atom.since is None or not hidden_start.concerns(atom.since):
            return False
        frames = self.evaluator.since(atom.since, env)[0].since
        return frames is not None and bool(frames[frame] < 0)


def since(atom: ast.SignalAtom, env: Env) -> str:
    """`` since end of handled(can)``: what a change is measured from; empty for the baseline."""
    event = atom.since
    if event is None or event.call is None:
        return f" since {event.text}" if event is not None and event.text else ""
    bodies = tuple([env.get(arg, arg) for arg in event.call.args])
    edge = "" if event.edge is None else f"{event.edge} of "
    return f" since {edge}{ast.Call(event.call.name, bodies)}"


def _least(margins: list[float]) -> int:
    """Which margin is the least: the first of those alike."""
    least = min(margins)
    if np.isfinite(least):
        least += ALIKE * abs(least)
    return int(np.argmax(np.array(margins) <= least))
