"""What is known of a signal before it is measured: arguments, dimension, options, needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from safestage_eval.units import UNIT_DIMENSION

from . import options as opt


@dataclass(frozen=True)
class SignalSpec:
    """What the rule checker and the documentation know about one signal.

    Attributes:
        name: as written in rules, ``name(role, …)``.
        args: the numbers of arguments it takes.
        dimension: of its value, as in ``units.DIMENSIONS``.
        meaning: one sentence, in SI and world frame.
        needs: what the trace must hold: poses, twists, geometry, forces, masses, joints, channel,
            gripper; touch: forces or, less well, geometry.
        since: may be taken relative to an event instead of the baseline.
        groups: ``robot`` and ``gripper`` (unions of bodies) are allowed as arguments.
        scale: SI size that counts as "one" in a normalised margin when the limit is 0.
        options: what a ``[signal.NAME]`` with this base may add.
        columns: material columns that it reads, with their dimensions.
        joints: its arguments are joints, or bodies that have just one.
        named: its first argument is the value of this option, not a role.
    """

    name: str
    args: tuple[int, ...]
    dimension: str
    meaning: str
    needs: tuple[str, ...]
    since: bool = False
    groups: bool = False
    scale: float = 0.01
    options: tuple[opt.OptionSpec, ...] = ()
    columns: tuple[tuple[str, str], ...] = ()
    joints: bool = False
    named: str = ""

    def variant(self, given: Mapping[str, object]) -> SignalSpec:
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
            args=tuple(n - 1 for n in self.args) if named else self.args,
            named="" if named else self.named,
            options=tuple(o for o in self.options if o.name not in given),
        )

    def params(self, given: Mapping[str, object]) -> tuple[opt.OptionSpec, ...]:
        """Options that parameters of their names stand in for, where they are not given."""
        return tuple(o for o in self.options if o.param and o.name not in given)

    def split(self, args: tuple[str, ...]) -> tuple[tuple[str, ...], opt.Options]:
        """Arguments as written → those that are roles, and the option that the first may be."""
        if not self.named:
            return args, ()
        return args[1:], ((self.named, args[0]),)
