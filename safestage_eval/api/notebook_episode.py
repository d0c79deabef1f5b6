"""An episode in a notebook: its signals by name, drawn with their limits."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from safestage_eval import episode as model
from safestage_eval.formats import EpisodeRef
from safestage_eval.formats import load as load_stored
from safestage_eval.units import DIMENSIONS

from .notebook_cards import Picture, card, facts

if TYPE_CHECKING:
    import pandas as pd

    from safestage_eval.relations.relations import Relations
    from safestage_eval.rules import RuleSet


def si_unit(dimension: str) -> str:
    """SI unit of a dimension in Python: ``m``, ``rad``, ``N``; "" of a plain number."""
    return next((unit for unit, size in DIMENSIONS.get(dimension, {}).items() if size == 1), "")


EXACT = 1e-6
"""SI: bounds that are no further apart are rounding, not doubt."""


class Episode(model.Episode):
    """An episode that can be asked for its signals, relations and states by name."""

    def signals(
        self, expression: str, rules: str | Path | Sequence[str | Path] = ()
    ) -> pd.Series[float]:
        """One signal, relation or state over time, as rules see it.

        Args:
            expression: ``"clearance(target, protected)"``, ``"held(cup)"``,
                ``"contact(robot, protected)"``; arguments are bodies, the unions ``robot`` and
                ``gripper``, or roles that a single body plays.
            rules: rule files, folders or built-in names whose states may be asked for; all built-in
                ones if empty.

        Returns:
            (T,) in SI, indexed by time (s); a hole of the recording adds one value, NaN. NaN where rules take the value as unknown, be it that only
            bounds of it are known; a clearance beyond 10 cm is +inf, and a tilt or edge margin that
            does not exist -inf. Relations and states are 1.0, 0.0 or NaN.

        Raises InputError for a name that does not exist, RuleError for rules that make no sense.
        """
        import numpy as np
        import pandas as pd

        from safestage_eval.rules import builtin_names, load_rules
        from safestage_eval.signals import SIGNALS
        from safestage_eval.verdicts.ask import ask

        asked = tuple(map(str, [rules] if isinstance(rules, str | Path) else rules))
        if asked not in self._rules:
            self._rules[asked] = load_rules(list(asked) or builtin_names())
        seen = model.with_holes(self)
        series = ask(seen, expression, self._relations, self._rules[asked])
        lower, upper = series.lower, series.upper
        known = lower == upper
        known |= np.isfinite(lower) & np.isfinite(upper) & (upper - lower <= EXACT)
        signal = SIGNALS.get(expression.partition("(")[0].strip())
        if signal is not None and signal.capped:
            known |= np.isfinite(lower) & np.isposinf(upper)
        values = np.where(known, upper, np.nan)
        named = pd.Series(values, pd.Index(seen.t, name="time"), name=expression)
        named.attrs["unit"] = si_unit(series.dimension)
        return named

    def plot(
        self,
        *expressions: str,
        rules: str | Path | Sequence[str | Path] = (),
        **settings: str,
    ) -> Picture:
        """Draw signals over time with their units, the limits that rules set them, and verdicts.

        Args:
            expressions: as for ``signals``; those that decide the assigned rules if there are none.
            rules: rule files, folders or built-in names; all built-in ones if empty.
            settings: parameter values, ``edge="3 cm"``.

        Raises InputError for a name that does not exist, where nothing decides, or without matplotlib.
        """
        from safestage_eval.report.signal_plot import figure_of, panels
        from safestage_eval.rules import builtin_names, load_rules
        from safestage_eval.whatif.judge_again import Again

        specs = [rules] if isinstance(rules, str | Path) else list(rules)
        again = Again(self, load_rules(specs or builtin_names()), settings, None)
        return Picture(figure_of(again, panels(again, expressions)))

    def _repr_html_(self) -> str:
        header, roles = self.header, dict[str, list[str]]()
        for role, players in header.roles.items():
            for player in players:
                roles.setdefault(player, []).append(role)
        objects = [body for body in header.bodies if body.kind not in ("robot", "gripper")]
        said = {True: "success", False: "no success", None: "success unknown"}[header.success]
        when = "" if header.success_time is None else f" at {header.success_time:.2f} s"
        rows = {
            "task": header.task or "–",
            "instruction": header.instruction or "–",
            "policy": f"{header.policy or '–'}, prompt {header.prompt or '–'}",
            "frames": f"{len(self)} in {float(self.t[-1] - self.t[0]):.2f} s"
            if len(self)
            else "none",
            "goal": f"{said}{when}",
            "rules": ", ".join(header.rules) or "none assigned",
            "bodies": ", ".join(
                f"{body.name} ({', '.join(roles[body.name])})" if body.name in roles else body.name
                for body in objects
            ),
        }
        return card(header.episode_id, facts(rows))

    @cached_property
    def _relations(self) -> Relations:
        """Measurements, kept for later calls."""
        from safestage_eval.evidence.measure import Signals
        from safestage_eval.relations.relations import Relations

        return Relations(Signals(model.with_holes(self)))

    @cached_property
    def _rules(self) -> dict[tuple[str, ...], RuleSet]:
        return {}


def load(path: str | Path | EpisodeRef, episode: str | None = None) -> Episode:
    """Return one stored episode, by its path or as ``discover`` returns it.

    ``episode`` is its id where the path holds several.

    Raises TraceError when there is none, or it cannot be read.
    """
    stored = load_stored(path, episode)
    return Episode(
        **{field.name: getattr(stored, field.name) for field in dataclasses.fields(stored)}
    )
