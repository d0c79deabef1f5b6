"""For notebooks: load an episode, look at its signals, score many into a DataFrame."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from safestage_eval import episode as model
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
            (T,) in SI, indexed by time (s); NaN where it is not known (in a hole of the recording
            there is one value more, NaN); a clearance beyond 10 cm
            is +inf. Relations are 1, 0 or NaN.

        Raises InputError for a name that does not exist.
        """
        import numpy as np
        import pandas as pd

        from safestage_eval.verdicts.ask import ask

        seen = model.with_holes(self)
        series = ask(seen, expression)
        values = np.where(series.known, series.upper, np.nan)
        return pd.Series(values, pd.Index(seen.t, name="time"), name=expression)


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
