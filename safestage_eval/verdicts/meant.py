"""The built-in signal and options behind a call: resolved once for all episodes of a run."""

from __future__ import annotations

from typing import NamedTuple

from safestage_eval.evidence.declare import Options, OptionValue
from safestage_eval.rules import syntax as ast
from safestage_eval.signals import SIGNALS

_MANY = 4096
"""Calls that are remembered at once; goals in headers are new with every episode."""


class Meant(NamedTuple):
    """A call of a built-in signal or of a variant of one.

    Attributes:
        call: as written; kept, so that no other comes to have its identity.
        name: of the built-in signal.
        roles: those of its arguments that are roles or bodies.
        options: what the variant or the first argument says, sorted by name.
        columns: material columns that it reads besides.
        scale: SI size that counts as one in a normalised margin when the limit is 0.
    """

    call: ast.Call
    name: str
    roles: tuple[str, ...]
    options: Options
    columns: tuple[str, ...]
    scale: float
    params: tuple[tuple[str, str], ...] = ()
    """Options that are parameters: option → name of the parameter."""


class Meanings:
    """Of the calls in one set of rules."""

    def __init__(self, rules: ast.RuleSet) -> None:
        """Answers are cached in ``rules.known``."""
        self._rules = rules
        self._known: dict[int, Meant] = rules.known.setdefault("meant", {})
        if len(self._known) > _MANY:
            self._known.clear()

    def of(self, call: ast.Call) -> Meant:
        """The meaning of a call."""
        known = self._known.get(id(call))
        if known is None or known.call is not call:
            known = self._known[id(call)] = self._found(call)
        return known

    def _found(self, call: ast.Call) -> Meant:
        variant = self._rules.signals.get(call.name)
        spec = SIGNALS[variant.base if variant is not None else call.name]
        given = dict(variant.options) if variant is not None else {}
        roles, named = spec.variant(given).split(call.args)
        params = {o.name: o.name for o in spec.params(given) if o.name in self._rules.params}
        params |= {k: v.name for k, v in given.items() if isinstance(v, ast.Parameter)}
        usual = {o.name: o.default for o in spec.params(given) if o.default is not None}
        fixed = {k: v for k, v in given.items() if not isinstance(v, ast.Parameter)}
        options: dict[str, OptionValue] = {**usual, **fixed, **dict(named)}
        in_order = tuple(sorted(options.items(), key=lambda item: item[0]))
        columns = tuple(column for column, _ in spec.columns)
        return Meant(call, spec.name, roles, in_order, columns, spec.scale, tuple(params.items()))
