"""The rule language as all parts of the evaluator see it: what values, durations and signals mean in an episode.

``Evaluator`` adds what conditions, states and events come to.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from safestage_eval.episode import Clock, Episode, Window
from safestage_eval.errors import did_you_mean
from safestage_eval.evidence.declare import Options, OptionValue, Signal, is_costly
from safestage_eval.evidence.intervals import F64, Bool, Interval, strict
from safestage_eval.relations.relations import Relations
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.digest import parameters_read
from safestage_eval.rules.names import derived_signal
from safestage_eval.rules.operations import OPERATIONS
from safestage_eval.signals import SIGNALS

from .events import Moment
from .players import Kept, kept
from .ranges import Range, Undecided
from .windows import NONE, ONE, lasting

Env = Mapping[str, str]
"""Role or formal argument → name of the body or union that plays it."""

Found = TypeVar("Found")
Node = ast.Alternative | ast.Atom | ast.Call

COSTLY = {name for name, operation in OPERATIONS.items() if operation.costly}


class Evaluated(NamedTuple):
    """A part of a rule over one episode.

    Attributes:
        node: the part; of a state or relation its call, with the names of the bodies.
        env: role → body.
        margin: (T,) how far it is from not holding; what is unknown is an interval.
        children: the parts that it was computed from, in the rule's order. Of a state its condition, or
            what stands in for that, and what it ``also`` holds by; of a signal the event that it is
            measured since.
        raw: of a declared state, its condition before ``for``, ``gap`` and ``until``.
        series: of a signal, its values.
    """

    node: Node
    env: Env
    margin: Interval
    children: tuple[Evaluated, ...] = ()
    raw: Interval | None = None
    series: Interval | None = None


class Meant(NamedTuple):
    """A call of a built-in signal or of a variant of one.

    Attributes:
        name: of the built-in signal, or of one that is computed from others.
        roles: those of its arguments that are roles or bodies.
        options: what the variant or the first argument says, sorted by name.
        columns: material columns that it reads besides.
        scale: SI size that counts as one in a normalised margin when the limit is 0.
    """

    name: str
    roles: tuple[str, ...]
    options: Options
    columns: tuple[str, ...]
    scale: float
    params: tuple[tuple[str, str], ...] = ()
    """Options that are parameters: option → name of the parameter."""


class Asked(NamedTuple):
    """The measurement that an atom compares, of certain bodies and under certain values.

    Attributes:
        name: of the built-in signal, or of one that is computed from others.
        bodies: names of bodies or unions, in the signal's order.
        options: what the signal's definition adds.
        limits: SI, in the order of the atom's limits.
        reach: up to where the signal is wanted exactly.
    """

    name: str
    bodies: tuple[str, ...]
    options: Options
    limits: tuple[float | Range, ...]
    reach: float


class Language(ABC):
    """Parameters, durations, columns and signals, and what was found out about parts of the rules."""

    frames: int
    causal: bool

    @abstractmethod
    def state(self, call: ast.Call, env: Env, frames: Bool | None = None) -> Evaluated:
        """A declared state or a built-in relation."""

    @abstractmethod
    def moments(self, event: ast.Event, env: Env) -> list[Moment]:
        """When an event happens."""

    @abstractmethod
    def measured_series(
        self, asked: Asked, atom: ast.SignalAtom, env: Env, frames: Bool | None
    ) -> Interval:
        """(T,) the signal of an atom, of a given measurement."""

    @abstractmethod
    def exempt(self, asked: Asked) -> bool:
        """The body has no such quantity: a ball has no tilt."""

    @property
    @abstractmethod
    def success_at_sample(self) -> bool:
        """Success came when a sample was taken."""

    def __init__(
        self,
        relations: Relations,
        rules: ast.RuleSet,
        params: ast.Params,
        memo: dict[tuple[Any, ...], Any] | None = None,
    ) -> None:
        """Prepare; nothing is computed yet.

        Args:
            relations: facts of the episode.
            rules: where states, phases, signals and materials are declared.
            params: name → value in SI, as they hold for the rule and episode.
            memo: what was found under other values, to be shared; everything is kept under the values
                that it reads.
        """
        self.relations = relations
        self.episode = relations.episode
        self.rules = rules
        self.params = params
        self.players: Mapping[str, Sequence[str]] = {}
        """Role → all bodies that play it, for ``at least K role``."""
        self.notes: dict[str, None] = {}
        """On what is being found out, in the order in which they came up."""
        self.ranges = {name for name, value in params.items() if isinstance(value, Range)}
        """Names of the parameters that may have any value of a range."""
        self._memo: dict[tuple[Any, ...], Any] = {} if memo is None else memo
        self._read: dict[Any, int] = {}
        self._limits: Kept[tuple[float | Range, ...]] = {}
        """Limits that depend on no body, of atoms."""

    @property
    def clock(self) -> Clock:
        """The episode's clock."""
        return self.episode.clock

    def setting(self, name: str) -> ast.Setting:
        """The value of a parameter; raises Undecided for one that is a range."""
        value: Any = self.params[name]
        if isinstance(value, Range):
            value.seen.exactly = True
            raise Undecided
        setting: ast.Setting = value
        return setting

    def ranged(self, part: object) -> bool:
        """A part of the rules reads a parameter that is a range."""
        return bool(self.ranges) and not self.ranges.isdisjoint(parameters_read(self.rules, part))

    def duration(self, duration: ast.Duration | ast.Parameter) -> ast.Duration:
        """A duration as it is given under these values."""
        value = self.setting(duration.name) if isinstance(duration, ast.Parameter) else duration
        return ast.Duration(value.value) if isinstance(value, ast.Quantity) else value

    def window(self, duration: ast.Duration | ast.Parameter | None) -> Window:
        """The samples that a duration takes in this episode; one where there is none."""
        return self.clock.window(lasting(self.duration(duration)) if duration else ONE)

    def open_gap(self, duration: ast.Duration | ast.Parameter | None) -> Window:
        """The samples of the shortest gap that is longer than may be closed."""
        return self.clock.gap(lasting(self.duration(duration), 0) if duration else NONE)

    def number(self, value: ast.Value, env: Env) -> float:
        """A limit's value in SI; a column is looked up for the body that plays its role."""
        if isinstance(value, ast.Quantity):
            return value.value
        if isinstance(value, ast.Parameter):
            number = ast.amount(self.setting(value.name))
        else:
            player = env.get(value.role, value.role)
            material = self.material(player)
            row = self.rules.materials.get(material, {})
            if not row and material not in self.rules.materials:
                self.notes[undeclared(material, player, self.rules)] = None
            default = self.rules.materials["default"]
            number = row.get(value.name, default[value.name]).value
        return -number if value.negative else number

    def limit(self, value: ast.Value, env: Env) -> float | Range:
        """``number``, of what a signal is compared with, which may be a range."""
        if isinstance(value, ast.Parameter) and value.name in self.ranges:
            known: Any = self.params[value.name]
            over: Range = -known if value.negative else known
            return over
        return self.number(value, env)

    def material(self, player: str) -> str:
        """The row that holds for a body, or for the body that a joint moves."""
        episode = self.episode
        moves = {joint.name: joint.body for joint in episode.header.joints}
        body = episode.bodies.get(player) or episode.bodies.get(moves.get(player) or "")
        return body.material if body is not None and body.material else "default"

    def measured(self, call: ast.Call, env: Env) -> tuple[str, tuple[str, ...], Options]:
        """The measurement behind a call: the built-in signal, its bodies, and all its options."""
        meant = self._meaning(call)
        bodies = tuple(map(env.get, meant.roles, meant.roles))
        plain = not meant.columns and not meant.params
        return meant.name, bodies, meant.options if plain else self._options(meant, env)

    def _meaning(self, call: ast.Call) -> Meant:
        return self.of_run("meant", call, lambda: _resolved(self.rules, call))

    def _options(self, meant: Meant, env: Env) -> Options:
        options = dict(meant.options)
        for column in meant.columns:
            options[column] = self.number(ast.Column(column, meant.roles[0]), env)
        for option, name in meant.params:
            value = self.setting(name)
            frames = isinstance(value, ast.Duration) and value.frames
            options[option] = ast.amount(value) * (self.episode.dt if frames else 1.0)
        return tuple(sorted(options.items(), key=lambda item: item[0]))

    def asked(self, atom: ast.SignalAtom, env: Env) -> Asked:
        """The measurement behind an atom, with the limits that it is compared with."""
        name, bodies, options = self.measured(atom.call, env)

        def find() -> tuple[float | Range, ...]:
            return tuple([self.limit(limit.value, env) for limit in atom.limits])

        of_bodies = any(isinstance(limit.value, ast.Column) for limit in atom.limits)
        limits = find() if of_bodies else kept(self._limits, atom, find)
        # a limit is never where a signal saturates
        return Asked(name, bodies, options, limits, max(map(abs, limits)) * (1 + 1e-6) + 1e-6)

    def signal(self, name: str) -> Signal:
        """Declaration of the signal of this name, built-in or computed."""
        built_in = SIGNALS.get(name)
        return derived_signal(self.rules.derived[name]) if built_in is None else built_in

    def scale(self, call: ast.Call) -> float:
        """SI size of the signal that counts as one in a normalised margin when the limit is 0."""
        return self._meaning(call).scale

    # ---- what was found out

    def once(self, node: object, key: tuple[Any, ...], compute: Callable[[], Found]) -> Found:
        """What ``compute`` finds about a part of the rules, with its notes; computed once.

        Args:
            node: the part, which names the parameters that the answer may depend on.
            key: what else it depends on, and what is asked.
            compute: finds it.
        """
        identity = _identity(node)
        values = self._read.get(identity)
        if values is None:
            values = self._read[identity] = self._values_read(node)
        key = (identity, values, *key)
        known = self._memo.get(key)
        if known is None:
            outer, self.notes = self.notes, {}
            try:
                known = self._memo[key] = compute(), self.notes, node
            finally:
                self.notes = outer
        if known[1]:
            self.notes.update(known[1])
        found: Found = known[0]
        return found

    def of_run(self, what: str, part: object, find: Callable[[], Found]) -> Found:
        """``kept``, for all episodes that are judged by these rules."""
        known: Kept[Found] = self.rules.known.setdefault(what, {})
        return kept(known, part, find)

    def _values_read(self, node: object) -> int:
        """A number for the values of the parameters that a part of the rules reads: alike for the same ones."""
        reads = () if node is None else sorted(parameters_read(self.rules, node))
        values = tuple([self.params[name] for name in reads])
        number: int = self._memo.setdefault(("values", values), len(self._memo))
        return number

    # ---- what is costly

    def is_costly(self, part: object) -> bool:
        """It asks for what is measured at the frames that matter alone, itself or through states."""

        def costly() -> bool:
            return any(is_costly(name) or name in COSTLY for name in self._asks(part))

        return self.of_run("costly", part, costly)

    def _asks(self, part: object) -> Iterator[str]:
        """Names of the built-in signals and relations, and of the operations, that a part asks for."""
        match part:
            case ast.StateDef():
                if part.fallback is None and part.also is None:  # else it is measured everywhere
                    yield from self._asks(part.when)
            case ast.Condition():
                for atom in part.atoms:
                    yield from self._asks(atom)
            case ast.AnyOf():
                for alternative in part.alternatives:
                    yield from self._asks(alternative)
            case ast.SignalAtom() | ast.StateAtom() | ast.CountAtom() | ast.Event():
                if part.call is not None:
                    yield from self._called(part.call.name)
            case ast.DerivedDef():
                yield from self._called(part.name)

    def _called(self, name: str) -> Iterator[str]:
        computed = self.rules.derived.get(name)
        if computed is not None:
            yield computed.operation
            for operand in computed.operands:
                yield from self._asks(operand)
        elif name in self.rules.states:
            yield from self._asks(self.rules.states[name])
        else:
            yield self.rules.signals[name].base if name in self.rules.signals else name


def _resolved(rules: ast.RuleSet, call: ast.Call) -> Meant:
    """The built-in signal and options behind a call."""
    derived = rules.derived.get(call.name)
    if derived is not None:
        scales = [
            _resolved(rules, one.call).scale
            for one in derived.operands
            if isinstance(one, ast.SignalAtom)
        ]
        return Meant(call.name, call.args, (), (), max(scales, default=1.0))
    variant = rules.signals.get(call.name)
    spec = SIGNALS[variant.base if variant is not None else call.name]
    given = dict(variant.options) if variant is not None else {}
    roles, named = spec.variant(given).split(call.args)
    params = {o.name: o.name for o in spec.params(given) if o.name in rules.params}
    params |= {k: v.name for k, v in given.items() if isinstance(v, ast.Parameter)}
    usual = {o.name: o.default for o in spec.params(given) if o.default is not None}
    fixed = {k: v for k, v in given.items() if not isinstance(v, ast.Parameter)}
    options: dict[str, OptionValue] = {**usual, **fixed, **dict(named)}
    in_order = tuple(sorted(options.items(), key=lambda item: item[0]))
    columns = tuple(column for column, _ in spec.columns)
    return Meant(spec.name, roles, in_order, columns, spec.scale, tuple(params.items()))


UNDECLARED = "no rule file declares the material "


def undeclared(material: str, player: str, rules: ast.RuleSet) -> str:
    """The note on a body whose material has no row: the default row holds for it."""
    meant = did_you_mean(material, rules.materials, 0.75)
    return ", ".join(
        [f'{UNDECLARED}"{material}" of {player}: default values hold', *filter(None, [meant])]
    )


def ends_early(episode: Episode) -> bool:
    """The trace stops before its rollout did: it says so, or its success lies beyond its end."""
    header = episode.header
    beyond = header.success_time is not None and header.success_time > episode.t[-1] + 1e-6
    return header.termination in ("truncated", "error") or beyond


def lacks_its_success(episode: Episode) -> bool:
    """Its rollout ended because the goal was reached, and that is all the trace says of success.

    Where the goal is not seen to be reached, the trace stops before its rollout did.
    """
    return episode.header.success is None and episode.header.termination == "success"


def ends_with_success(episode: Episode) -> bool:
    """Nothing was recorded after success: what was under way then is not followed to its end."""
    reached = episode.header.success_time
    return reached is not None and reached >= episode.t[-1] - 1e-6


def limit_margin(series: Interval, op: str, limit: float | Range, scale: float) -> Interval:
    """Normalised margin of a comparison: (value − limit) / |limit|, or / scale when it is 0.

    Args:
        series: the signal.
        op: ``>=``, ``<=``, ``>`` or ``<``; the strict ones are not satisfied at the limit.
        limit: SI.
        scale: SI size that counts as one when the limit is 0.
    """
    if isinstance(limit, Range):
        return limit.margin(series, op)
    size, up, open_ = abs(limit) or scale, op[0] == ">", len(op) == 1

    def margin(end: F64) -> F64:
        found = end - limit if up else limit - end
        with np.errstate(over="ignore"):  # of a limit next to nothing
            found /= size
        return strict(found) if open_ else found

    first, second = (series.lower, series.upper) if up else (series.upper, series.lower)
    lower = margin(first)
    return Interval(lower, lower if first is second else margin(second))


def _identity(node: object) -> object:
    """Parts of rules are told apart by their identity: hashing one takes long."""
    return tuple(map(id, node)) if isinstance(node, tuple) else id(node)
