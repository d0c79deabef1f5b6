"""For notebooks: load an episode, look at its signals, score many into a DataFrame."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from safestage_eval import episode as model
from safestage_eval.formats import EpisodeRef
from safestage_eval.formats import load as load_stored
from safestage_eval.run.score_many import score_paths

if TYPE_CHECKING:
    import pandas as pd

    from safestage_eval.relations.relations import Relations
    from safestage_eval.rules import RuleSet


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
        return pd.Series(values, pd.Index(seen.t, name="time"), name=expression)

    @cached_property
    def _relations(self) -> Relations:
        """What was measured stays."""
        from safestage_eval.evidence.measure import Signals
        from safestage_eval.relations.relations import Relations

        return Relations(Signals(model.with_holes(self)))

    @cached_property
    def _rules(self) -> dict[tuple[str, ...], RuleSet]:
        return {}


def load(path: str | Path | EpisodeRef, episode: str | None = None) -> Episode:
    """One stored episode, by its path or as ``discover`` returns it.

    ``episode`` is its id where the path holds several.

    Raises TraceError when there is none, or it cannot be read.
    """
    stored = load_stored(path, episode)
    return Episode(
        **{field.name: getattr(stored, field.name) for field in dataclasses.fields(stored)}
    )


def score(
    paths: str | Path | Sequence[str | Path],
    rules: str | Path | Sequence[str | Path] = (),
    *,
    bind: str | Path | None = None,
    assign: str | Sequence[str] = (),
    roles: Mapping[str, str | Sequence[str]] | None = None,
    jobs: int | None = 1,
    **settings: str,
) -> pd.DataFrame:
    """Judge episodes: one row per episode and rule, columns as in docs/results.md.

    Args:
        paths: files and folders.
        rules: rule files, folders or built-in names; all built-in ones if empty.
        bind: a bind file: roles, goal, rules and values that the traces' headers lack.
        assign: codes of the rules that every episode is judged by, or patterns of codes.
        roles: role → names of bodies or patterns, for every episode; [] for none.
        jobs: worker processes; scripts that use several need the usual ``__main__`` guard.
        settings: parameter values, ``edge="3 cm"``.

    Episodes that could not be judged are listed in ``frame.attrs["problems"]``.
    """
    import pandas as pd

    from safestage_eval.report.result_rows import COLUMNS, rows

    def several(value: str | Path | Sequence[str | Path]) -> list[str | Path]:
        return [value] if isinstance(value, str | Path) else list(value)

    def joined(bodies: str | Sequence[str]) -> str:
        return bodies if isinstance(bodies, str) else ",".join(bodies)

    scores = score_paths(
        several(paths),
        several(rules),
        overrides=settings,
        bind=bind,
        assign=[assign] if isinstance(assign, str) else assign,
        roles=[f"{role}={joined(bodies)}" for role, bodies in (roles or {}).items()],
        jobs=jobs,
    )
    frame = pd.DataFrame(rows(scores), columns=list(COLUMNS))
    problems: list[dict[str, Any]] = [dataclasses.asdict(p) for p in scores.problems]
    frame.attrs["problems"] = problems
    return frame
