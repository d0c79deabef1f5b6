"""For notebooks: load an episode, look at its signals, score many into a DataFrame."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from safestage_eval import episode as model
from safestage_eval.errors import InputError
from safestage_eval.formats import load as load_stored
from safestage_eval.scoring import score_paths

if TYPE_CHECKING:
    import pandas as pd


class Episode(model.Episode):
    """An episode that can be asked for its signals by name."""

    def signals(self, expression: str) -> pd.Series[float]:
        """One signal or relation over time.

        Args:
            expression: ``"clearance(target, protected)"``, ``"held(cup)"``; arguments are bodies,
                the unions ``robot`` and ``gripper``, or roles that a single body plays.

        Returns:
            (T,) in SI, indexed by time (s); NaN where it is not known; a clearance beyond 10 cm
            is +inf. Relations are 1, 0 or NaN.

        Raises InputError for a name that does not exist.
        """
        import numpy as np
        import pandas as pd

        from safestage_eval.relations.measure import Relations
        from safestage_eval.relations.vocabulary import RELATIONS
        from safestage_eval.rules import parse
        from safestage_eval.signals.measure import Signals
        from safestage_eval.signals.vocabulary import SIGNALS

        try:
            call = parse.call(expression)
        except parse.GrammarError as problem:
            raise InputError(expression, problem.what, problem.allowed) from None
        spec = SIGNALS.get(call.name)
        arguments, options = spec.split(call.args) if spec is not None else (call.args, ())
        joints = spec is not None and spec.joints
        bodies = [self._body(argument, expression, joints) for argument in arguments]
        relations = Relations(Signals(self))
        index = pd.Index(self.t, name="time")
        if call.name in RELATIONS:
            _check_count(expression, len(bodies), (RELATIONS[call.name].args,))
            truth = relations.get(call.name, bodies)
            values = np.full(len(self), np.nan) if truth is None else truth.astype(float)
            return pd.Series(values, index, name=expression)
        if spec is None:
            raise InputError(
                expression, f"no signal {call.name!r}.", ", ".join([*SIGNALS, *RELATIONS])
            )
        _check_count(expression, len(call.args), spec.args)
        series = relations.signal(call.name, bodies, options=options)
        values = np.where(series.known, series.upper, np.nan)
        return pd.Series(values, index, name=expression)

    def _body(self, argument: str, expression: str, joints: bool) -> str:
        players = self.header.roles.get(argument, ())
        named = [joint.name for joint in self.header.joints] if joints else []
        if len(players) == 1:
            argument = players[0]
        if argument in self.bodies or argument in named or argument in ("robot", "gripper"):
            return argument
        if players:
            raise InputError(
                expression, f"several bodies play {argument!r}.", ", ".join(players), "name one"
            )
        names = [*self.header.roles, *self.bodies, *named, "robot", "gripper"]
        raise InputError(expression, f"no role or body {argument!r}.", ", ".join(names))


def load(path: str | Path, episode: str | None = None) -> Episode:
    """One stored episode; ``episode`` is its id where the path holds several.

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
    jobs: int | None = 1,
    **settings: str,
) -> pd.DataFrame:
    """Judge episodes: one row per episode and rule, columns as in docs/results.md.

    Args:
        paths: files and folders.
        rules: rule files, folders or built-in names; all built-in ones if empty.
        bind: a bind file: roles, goal, rules and values that the traces' headers lack.
        jobs: worker processes; scripts that use several need the usual ``__main__`` guard.
        settings: parameter values, ``edge="3 cm"``.

    Episodes that could not be judged are listed in ``frame.attrs["problems"]``.
    """
    import pandas as pd

    from safestage_eval.report.rows import COLUMNS, rows

    def several(value: str | Path | Sequence[str | Path]) -> list[str | Path]:
        return [value] if isinstance(value, str | Path) else list(value)

    scores = score_paths(several(paths), several(rules), overrides=settings, bind=bind, jobs=jobs)
    frame = pd.DataFrame(rows(scores), columns=list(COLUMNS))
    problems: list[dict[str, Any]] = [dataclasses.asdict(p) for p in scores.problems]
    frame.attrs["problems"] = problems
    return frame


def _check_count(expression: str, given: int, allowed: Sequence[int]) -> None:
    if given not in allowed:
        counts = " or ".join(map(str, allowed))
        raise InputError(expression, f"takes {counts} arguments, not {given}.")
