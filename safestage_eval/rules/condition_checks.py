"""Checks of conditions in rule files: grammar, names, dimensions, depth."""

from __future__ import annotations

import re
from typing import Any

from safestage_eval.signals import SIGNALS

from . import string_parser
from . import syntax as ast
from .locate import Keys
from .names import Near, a_dimension
from .reference_checks import References, Scope, literal


class Usage(References):
    """Checks conditions, and all that may stand in them."""

    def condition(self, table: Any, keys: Keys, scope: Scope, depth: int = 1) -> None:
        """A table whose entries must all hold."""
        if not isinstance(table, dict) or not table or depth > 2:
            scope.unreadable()
        if not isinstance(table, dict):
            self.report(
                "R203", keys, f"a condition is a table, not {literal(table)}",
                '{ "moved(target)" = true, "tilt(target)" = "<= 15 deg" }',
            )  # fmt: skip
        elif not table:
            self.report("R203", keys, "an empty condition says nothing", "at least one entry")
        elif depth > 2:
            self.report(
                "R207", keys, "nested more than two levels deep",
                fix="give the inner part a name: [state.NAME]",
            )  # fmt: skip
        else:
            self._twice(table, keys)
            for key, value in table.items():
                self._entry(key, value, (*keys, key), scope, depth)

    def alternative(self, value: Any, keys: Keys, scope: Scope, depth: int = 1) -> None:
        """An event or state as a string, or a condition as a table."""
        if isinstance(value, str):
            self.event(value, keys, scope)
        else:
            self.condition(value, keys, scope, depth)

    def _twice(self, table: dict[str, Any], keys: Keys) -> None:
        """TOML refuses a key that stands twice, but not one that is only spaced differently."""
        seen: dict[str, str] = {}
        for key in table:
            first = seen.setdefault(re.sub(r"\s+", "", key), key)
            if first != key:
                self.report(
                    "R211", (*keys, key), f'"{first}" and "{key}" are one entry, written twice',
                    fix="leave one out; several limits on one signal are a list", key=True,
                )  # fmt: skip

    def _entry(self, key: str, value: Any, keys: Keys, scope: Scope, depth: int) -> None:
        if key == "any":
            if not isinstance(value, list) or not value:
                self.report("R203", keys, '"any" takes a list of alternatives', '["a(x)", { … }]')
                return
            for index, item in enumerate(value):
                self.alternative(item, (*keys, index), scope, depth + 1)
            return
        if key in scope.siblings:
            self.report(
                "R204", keys, f'"{key}" is a key of {scope.label}, but stands inside a condition',
                fix=f'write "{key} = …" before the sub-table that swallowed it', key=True,
            )  # fmt: skip
            return
        if re.match(r"(once|always)\b(?!\()|.*\) (iff|xor) |.* since\[", key):
            of_states = self.parsed("R307", keys, _of_states, key, key=True)
            if of_states is None:
                scope.unreadable()
            else:
                self._of_states(of_states, value, keys, scope)
            return
        atom = self.parsed("R307", keys, string_parser.atom_key, key, key=True)
        if atom is None:
            scope.unreadable()
            return
        call, since = atom
        if since is not None:
            self.moment(since, keys, scope, key=True)
        kind = self.call(call, keys, scope, key=True)
        if kind == "signal":
            self._limits(call, since, value, keys, scope)
        elif kind == "state":
            self._truth(call, since, value, keys, scope)

    def _of_states(
        self, atom: ast.PastAtom | ast.PairAtom, value: Any, keys: Keys, scope: Scope
    ) -> None:
        """States as they were, and two that are compared."""
        other = atom.begun if isinstance(atom, ast.PastAtom) else atom.other
        for call in (atom.call, *([] if other is None else [other])):
            self._state(call, "this", keys, scope, key=True)
        if isinstance(atom, ast.PastAtom):
            for lasting in (atom.recent, atom.far):
                if lasting is not None:
                    self._lasting(lasting, keys, scope)
        if not isinstance(value, bool):
            self.report(
                "R405", keys, f"{literal(value)} does not fit: states hold or do not", "true, false"
            )

    def _limits(
        self, call: ast.Call, since: ast.Event | None, value: Any, keys: Keys, scope: Scope
    ) -> None:
        spec = self.names.signal(call.name)
        if spec is None:
            return
        if since is not None:
            self.since(call, keys, key=True)
        limits = value if isinstance(value, list) else [value]
        for index, item in enumerate(limits):
            at = (*keys, index) if isinstance(value, list) else keys
            if not isinstance(item, str) or item.startswith("at "):
                self.report(
                    "R405", at, f"{call.name}() is a signal: it needs a limit, not {literal(item)}",
                    f'">= …" with {a_dimension(spec.dimension)}, or a list of limits',
                )  # fmt: skip
                continue
            limit = self.parsed("R301", at, string_parser.limit, item)
            if limit is not None:
                self.limit_value(limit.value, spec.dimension, f"{call.name}()", at, scope)

    def since(self, call: ast.Call, keys: Keys, *, key: bool = False) -> None:
        """Whether a signal can be taken since an event."""
        spec = self.names.signal(call.name)
        if spec is not None and not spec.since:
            self.report(
                "R406", keys, f'{call.name}() has no reference, so it cannot be taken "since"',
                "signals with a reference: "
                + ", ".join(one.name for one in SIGNALS.values() if one.since), key=key,
            )  # fmt: skip

    def _truth(
        self, call: ast.Call, since: ast.Event | None, value: Any, keys: Keys, scope: Scope
    ) -> None:
        allowed = 'true, false, "at least 2 role", "at most 1 role"'
        if since is not None:
            self.report(
                "R406", keys, f"{call.name}() is a state: only signals are taken since", key=True
            )
        if isinstance(value, bool):
            return
        try:
            counted = string_parser.count(value) if isinstance(value, str) else None
        except string_parser.GrammarError as problem:
            self.report("R301", keys, problem.what, problem.allowed)
            return
        if counted is None:
            self.report(
                "R405", keys, f"{call.name}() is a state, not a signal: {literal(value)} does not fit",
                allowed,
            )  # fmt: skip
        elif not scope.counting:
            self.report(
                "R405",
                keys,
                "bodies can be counted in rules and goals only, where roles are",
                "true, false",
            )
        elif counted[2] not in call.args:
            self.report(
                "R403", keys, f'"{counted[2]}" is not an argument of {call}', ", ".join(call.args),
                Near(counted[2], call.args),
            )  # fmt: skip


def _of_states(key: str) -> ast.PastAtom | ast.PairAtom:
    """See ``string_parser.of_states``. Raises GrammarError."""
    atom = string_parser.of_states(key)
    if atom is None:
        raise string_parser.GrammarError(
            f"{key!r} does not say of which states, and when",
            "once[DUR, DUR] state(role, …), always[DUR, DUR] state(…), "
            "state(…) since[DUR, DUR] state(…), state(…) iff state(…), state(…) xor state(…)",
        )
    return atom
