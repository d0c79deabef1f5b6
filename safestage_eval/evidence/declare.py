"""How a signal or relation is declared: once, above the function that measures it.

The rule checker, the schema for editors, the documentation, the evaluator and the monitor
read the declaration; there are no other lists of names. A declaration imports no geometry,
because rule files are checked without it: the function imports geometry when it is called.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from safestage_eval.episode import Body
from safestage_eval.units import UNIT_DIMENSION

from .intervals import Interval

OptionValue = float | str | tuple[float, ...]

Options = tuple[tuple[str, OptionValue], ...]
"""Option → value in SI, sorted by name: from the signal's definition and the body's material."""

Reads = Literal[
    "", "com", "origin", "velocity", "orientation", "up axis", "angular velocity", "shape", "robot"
]
"""Recorded quantities of each body that a signal needs; it is unknown where one is missing.

``com`` and ``velocity`` are those of the centre of mass, ``origin`` is the body frame's, ``up axis`` is the orientation of a body that
has one, ``shape`` the pose of a body with geometry, ``robot`` the poses of all bodies of the robot.
Empty: the function itself says what is unknown.
"""


@dataclass(frozen=True)
class Option:
    """Options that a ``[signal.NAME]`` may add to a built-in signal.

    Attributes:
        name: key under ``[signal.NAME]``.
        kind: ``time`` (s), ``length`` (m), ``channel`` (name of a recorded one), ``unit``, ``box``
            (two corners, m) or ``choice``.
        meaning: one sentence.
        required: there is no sensible default.
        choices: the values that a unit or choice may have; empty for any unit.
        default: the number that is meant where it is left out, if there is one.
        param: it may be the name of a parameter, so that it can be swept; left out, it is the value of
            the parameter of its own name, where the rules declare one, and only then the default.
        looks: of a time: the value at a frame depends on that much time ``back``.
        reads: what the signal is measured from where this option is given, if that differs; of a
            choice, with the value for which it does.
    """

    name: str
    kind: Literal["time", "length", "channel", "unit", "box", "choice"]
    meaning: str
    required: bool = False
    choices: tuple[str, ...] = ()
    default: float | None = None
    param: bool = False
    looks: Literal["", "back"] = ""
    reads: Reads | tuple[tuple[str, Reads], ...] = ""

    def reads_at(self, value: OptionValue) -> Reads:
        """Quantities that the signal needs at this value of the option; empty for the default ones."""
        return self.reads if isinstance(self.reads, str) else dict(self.reads).get(str(value), "")


@dataclass(frozen=True)
class Signal:
    """One signal: a number per frame.

    Attributes:
        name: as written in rules, ``name(role, …)``.
        dimension: of its value, as in ``units.DIMENSIONS``.
        args: names of its arguments, as the documentation shows them.
        needs: what the trace must hold: poses, twists, geometry, forces, masses, joints, channel,
            gripper; touch: forces or, less well, geometry.
        measure: the declared function. Takes a ``Request``; returns a (T,) series in SI, of a
            ``costly`` one (N,) at N frames.
        meaning: one sentence: the first paragraph of the function's docstring.
        optional: how many of the last arguments may be left out.
        since: may be taken relative to an event.
        from_start: measures a change since the start of the episode where no event is named.
        groups: ``robot`` and ``gripper`` (unions of bodies) are allowed as arguments.
        scale: SI size that counts as "one" in a normalised margin when the limit is 0.
        options: what a ``[signal.NAME]`` with this base may add.
        columns: material columns that it reads, with their dimensions.
        joints: its arguments are joints, or bodies that have just one.
        named: its first argument is the value of this option, not a role.
        reads: see ``Reads``.
        ahead: looks one frame ahead where no velocities were recorded; a note says where.
        sums: adds up what was: it can only go ``up`` or ``down`` by what happened unseen.
        symmetric: its two arguments may be exchanged.
        metric: a distance between states, which obeys the triangle inequality.
        capped: a distance that is exact only as far as a limit needs, and may be measured roughly.
        support: needs relations or the support graph.
        costly: clips polygons or solves statics: measured only at the frames that matter.
        exempt: whether a body has no such quantity, and is not judged by it.
    """

    name: str
    dimension: str
    args: tuple[str, ...]
    needs: tuple[str, ...]
    measure: Callable[[Any], Interval]
    meaning: str
    optional: int = 0
    since: bool = False
    from_start: bool = False
    groups: bool = False
    scale: float = 0.01
    options: tuple[Option, ...] = ()
    columns: tuple[tuple[str, str], ...] = ()
    joints: bool = False
    named: str = ""
    reads: Reads = "shape"
    ahead: bool = False
    sums: Literal["", "up", "down"] = ""
    symmetric: bool = False
    metric: bool = False
    capped: bool = False
    support: bool = False
    costly: bool = False
    exempt: Callable[[Body], bool] | None = None

    @property
    def arities(self) -> tuple[int, ...]:
        """The numbers of arguments it takes."""
        return tuple(range(len(self.args) - self.optional, len(self.args) + 1))

    @property
    def far_back(self) -> bool:
        """Its value at a frame may depend on any frame before, without a reference to an event."""
        return self.from_start or bool(self.sums) or (self.support and not self.costly)

    def variant(self, given: Mapping[str, object]) -> Signal:
        """The signal with some options given: its dimension and arguments may change with them."""
        if not given:
            return self
        known = {option.name: option for option in self.options}
        unit = given.get("unit")
        dimension = UNIT_DIMENSION.get(str(unit), "number") if unit is not None else self.dimension
        named = bool(self.named and self.named in given)
        return replace(
            self,
            dimension=dimension if "unit" in known else self.dimension,
            args=self.args[1:] if named else self.args,
            named="" if named else self.named,
            options=tuple(o for o in self.options if o.name not in given),
        )

    def params(self, given: Mapping[str, object]) -> tuple[Option, ...]:
        """Options that parameters of their names stand in for, where they are not given."""
        return tuple(o for o in self.options if o.param and o.name not in given)

    def split(self, args: tuple[str, ...]) -> tuple[tuple[str, ...], Options]:
        """Arguments as written → those that are roles, and the option that the first may be."""
        if not self.named:
            return args, ()
        return args[1:], ((self.named, args[0]),)

    def looks_back(self, given: Mapping[str, OptionValue]) -> float | None:
        """Seconds before a frame that its value depends on; None if it looks at no such time."""
        for option in self.options:
            if option.looks == "back":
                value = given.get(option.name)
                if value is None or (not value and option.default is not None):
                    value = option.default
                return float(value) if isinstance(value, float | int) else None
        return None

    def reads_of(self, given: Mapping[str, OptionValue]) -> Reads:
        """Quantities that the signal needs with these options."""
        differ = (o.reads_at(given[o.name]) for o in self.options if o.reads and o.name in given)
        return next(filter(None, differ), self.reads)


@dataclass(frozen=True)
class Relation:
    """One relation: true, false or unknown at every frame.

    Attributes:
        name: as written in rules.
        args: names of its arguments.
        needs: as in ``Signal``.
        decide: the declared function. Takes the ``Relations`` of an episode and names of bodies, of a
            costly one the wanted frames (T,) too; returns an interval from 0 to 1.
        meaning: one sentence: the first paragraph of the function's docstring.
        groups: ``robot`` and ``gripper`` are allowed as arguments.
        costly: solves statics: decided only at the frames that matter.
        gate: says whether something else counts at all; takes no part in how close it came.
    """

    name: str
    args: tuple[str, ...]
    needs: tuple[str, ...]
    decide: Callable[..., Interval]
    meaning: str
    groups: bool = False
    costly: bool = False
    gate: bool = False

    @property
    def arities(self) -> tuple[int, ...]:
        """The number of arguments it takes, as in ``Signal``."""
        return (len(self.args),)


SIGNALS: dict[str, Signal] = {}
"""Every declared signal by name, sorted; complete once ``safestage_eval.signals`` is imported."""

RELATIONS: dict[str, Relation] = {}
"""Every declared relation by name, sorted; complete once ``relations.vocabulary`` is imported."""


def signal(
    name: str, dimension: str, args: tuple[str, ...], needs: tuple[str, ...], **more: Any
) -> Callable[[Callable[[Any], Interval]], Callable[[Any], Interval]]:
    """Declare a signal by the function below; see ``Signal``. Raises ValueError for a taken name."""

    def declare(measure: Callable[[Any], Interval]) -> Callable[[Any], Interval]:
        _add(SIGNALS, Signal(name, dimension, args, needs, measure, _meaning(measure), **more))
        return measure

    return declare


def relation(
    name: str, args: tuple[str, ...], needs: tuple[str, ...], **more: Any
) -> Callable[[Callable[..., Interval]], Callable[..., Interval]]:
    """Declare a relation by the function below; see ``Relation``."""

    def declare(decide: Callable[..., Interval]) -> Callable[..., Interval]:
        _add(RELATIONS, Relation(name, args, needs, decide, _meaning(decide), **more))
        return decide

    return declare


def is_costly(name: str) -> bool:
    """A signal or relation of that name is measured only at the frames that matter."""
    one = SIGNALS.get(name) or RELATIONS.get(name)
    return one is not None and one.costly


def is_gate(name: str) -> bool:
    """A relation of that name says whether something else counts at all."""
    return name in RELATIONS and RELATIONS[name].gate


def _add(known: dict[str, Any], new: Signal | Relation) -> None:
    if new.name in SIGNALS or new.name in RELATIONS:
        raise ValueError(f"{new.name}() is declared already")
    known[new.name] = new
    for name in sorted(known):  # independent of the order of imports
        known[name] = known.pop(name)


def _meaning(function: Callable[..., Any]) -> str:
    text = inspect.getdoc(function) or ""
    return " ".join(text.partition("\n\n")[0].split())
