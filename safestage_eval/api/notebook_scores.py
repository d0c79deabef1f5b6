"""Judged episodes in a notebook: rows, rates, findings, and what another value would have said."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from safestage_eval.episode import Episode
from safestage_eval.errors import InputError, did_you_mean
from safestage_eval.report.result_rows import COLUMNS, KINDS
from safestage_eval.run.score_many import score_many
from safestage_eval.run.scores import Scores as Judged
from safestage_eval.run.scores import deduplicate, titles
from safestage_eval.run.settings import Settings, load_settings
from safestage_eval.units import DIMENSIONS, UNIT_DIMENSION, format_quantity, in_si

from .notebook_cards import Page, Picture, Text, card, facts, table, verdict, words
from .notebook_episode import si_unit

if TYPE_CHECKING:
    import pandas as pd
    import polars as pl

    from safestage_eval.formats import EpisodeRef
    from safestage_eval.metrics import Rates
    from safestage_eval.metrics.paired import By
    from safestage_eval.verdicts import EpisodeResult, Verdict


class Finding:
    """A violation of one rule in one episode, or a rule that could not be decided there.

    Attributes:
        episode_id: of the episode.
        of: everything that is known of the verdict: ``intervals``, ``phase``, ``notes`` and more.
        rule: code of the rule.
        verdict: ``violation`` or ``inconclusive``.
        explanation: one sentence: the event that was seen, or why the rule cannot be decided.
        time: at which it began, s; None where there is no such moment.
        bodies: names of the bodies that it is about.
        signal: the measured signal with its bodies, as ``clearance(cup, vase)``.
        value, limit: of the signal at the worst moment, in SI.
        unit: of both: ``m``, ``N``, ``s``.
        by_how_much: how far it is beyond its limit, in words: ``5.4 cm``; empty where nothing was measured.
    """

    def __init__(self, episode_id: str, of: Verdict, scores: Scores) -> None:
        self.episode_id, self.of, self._scores = episode_id, of, scores
        self.rule, self.verdict, self.time = of.rule, of.verdict, of.time
        self.explanation = of.explanation or of.title
        self.bodies, self.signal = tuple(of.bodies), of.signal
        self.value, self.limit, self.unit = of.value, of.limit, si_unit(of.dimension or "")
        self.by_how_much = ""
        if of.verdict == "violation" and of.margin is not None and of.dimension is not None:
            self.by_how_much = format_quantity(abs(of.margin), of.dimension)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Finding) and (self.episode_id, self.of) == (
            other.episode_id,
            other.of,
        )

    def __hash__(self) -> int:
        return hash((self.episode_id, self.rule))

    def plot(self) -> Picture:
        """Plot the signal that decides it, with its limit; as ``Scores.plot``."""
        return self._scores.plot(self.episode_id, rule=self.rule)

    def view(self) -> Page:
        """Show the episode in 3-D; as ``Scores.view``."""
        return self._scores.view(self.episode_id)

    def __repr__(self) -> str:
        """In one line."""
        return f"<{self.episode_id}: {self.rule} {self.verdict}: {self.explanation}>"

    def _repr_html_(self) -> str:
        v, rows = self.of, dict[str, object]()
        if v.time is not None and v.verdict == "violation":
            rows["from"] = f"{v.time:.2f} s, {v.exposure_time:.2f} s in all"
        if v.value is not None and v.limit is not None and v.dimension is not None:
            value, limit = (format_quantity(number, v.dimension) for number in (v.value, v.limit))
            rows[v.signal or "value"] = f"{value}; the limit is {limit}"
        rows["bodies"] = ", ".join(v.bodies) or "–"
        said = f"<p>{verdict(v.verdict)} {words(self.explanation)}</p>"
        return card(f"{self.episode_id}: {v.rule} {v.title}", said, facts(rows))


class Findings(tuple[Finding, ...]):
    """Unsafe and undecided verdicts, the gravest of each episode first; a table in a notebook."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        heads = ("episode", "rule", "verdict", "from", "by how much", "what was seen")
        rows = [
            (
                f.episode_id,
                f.rule,
                f.verdict,
                "" if f.time is None else f"{f.time:.2f} s",
                f.by_how_much,
                f.explanation,
            )
            for f in self
        ]
        return card(f"{len(self)} finding{'s' * (len(self) != 1)}", table(heads, rows))


class Scores:
    """Verdicts of scored episodes. Values are in SI, rates 0…1.

    Attributes:
        problems: episodes that could not be judged: ``path`` and ``message`` of each.
    """

    def __init__(self, judged: Judged, refs: Sequence[EpisodeRef], settings: Settings) -> None:
        self._judged, self._refs, self._settings = judged, tuple(refs), settings
        self.problems = [{"path": p.path, "message": p.message} for p in judged.problems]

    def __len__(self) -> int:
        """How many episodes were judged."""
        return len(self._judged.results)

    def __iter__(self) -> Iterator[EpisodeResult]:
        """Verdicts, episode by episode."""
        return iter(self._judged.results)

    @cached_property
    def rows(self) -> pd.DataFrame:
        """One row per episode and rule, columns as in docs/results.md, values in SI.

        Truths and whole numbers are of pandas' kinds that may be missing.
        """
        from safestage_eval.report.result_rows import rows

        frame = result_frame(rows(self._judged))
        frame.attrs["problems"] = self.problems
        return frame

    @property
    def rates(self) -> pd.DataFrame:
        """Return SR, SSR, USR and VR, 0…1, by policy, prompt and stage, with their counts.

        Each is over the ``n`` decided episodes; ``SR_low`` and ``SR_high`` and so on are its ends over
        all ``episodes``, however the undecided turn out.
        """
        import pandas as pd

        from safestage_eval.metrics import METRICS

        rows = []
        for (policy, prompt, stage), cell in self._cells().items():
            row: dict[str, Any] = {"policy": policy, "prompt": prompt, "stage": stage}
            for name in ("episodes", "n", "inconclusive", "not_judged"):
                row[name] = getattr(cell, name)
            row["at_risk"] = cell.given["at risk"]["N"]
            row |= {metric: cell.value(metric) for metric in METRICS}
            for metric in METRICS:
                low, high = cell.bounds(metric) or (None, None)
                row |= {f"{metric}_low": low, f"{metric}_high": high}
            rows.append({**row, "VR_at_risk": cell.value("VR", "at risk")})
        return pd.DataFrame(rows)

    def _cells(self) -> dict[tuple[str, ...], Rates]:
        from safestage_eval.metrics import by_policy_stage, outcomes

        return by_policy_stage(outcomes(self._judged.results, self._judged.set_aside))

    @property
    def by_rule(self) -> pd.DataFrame:
        """Return how often each rule that counts was violated, passed or undecided, and why."""
        import pandas as pd

        from safestage_eval.report.result_rows import by_rule_rows

        return pd.DataFrame(by_rule_rows(self._judged)).set_index("rule")

    @cached_property
    def findings(self) -> Findings:
        """Violations and undecided verdicts of the rules that count."""
        from safestage_eval.report.results_text import BAD, by_importance

        return Findings(
            Finding(result.episode_id, v, self)
            for result in self._judged.results
            for v in by_importance(self._judged.gates.counted(result))
            if v.verdict in BAD
        )

    def explain(self, episode: str | None = None, *, everything: bool = False) -> Text:
        """Explain why episodes got their verdicts, one sentence per finding, as ``safestage explain``.

        Args:
            episode: its id, or a part that only it has; all episodes if None.
            everything: also rules that do not apply, and every unknown value.

        Raises InputError for an id that no episode has.
        """
        from safestage_eval.report.episode_report import explain

        results = [self._result(episode)] if episode is not None else self._judged.results
        return Text("\n".join(explain(r, everything=everything) for r in results))

    def sweep(
        self,
        param: str,
        values: str | Sequence[str] | None = None,
        *,
        first: str | None = None,
        last: str | None = None,
        steps: int = 21,
        by: Sequence[str] = (),
    ) -> pd.DataFrame:
        """Return the rates under other values of a parameter, as ``safestage sweep``.

        Args:
            param: ``"edge"``.
            values: ``"1 cm, 2 cm"``; None for ``steps`` values from ``first`` to ``last``.
            first: ``"0 cm"``; None for a range around the usual value.
            last: likewise.
            steps: how many.
            by: ``policy``, ``prompt``, ``stage``, ``task`` or ``rule``: a curve for each.

        Returns one row per group and value.
        Raises InputError, RuleError: no such parameter, or none that judged an episode.
        """
        import pandas as pd

        from safestage_eval.whatif.sweep import sweep
        from safestage_eval.whatif.swept_values import between, chosen

        rules = self._settings.rule_set
        texts = values.split(",") if isinstance(values, str) else values
        visited = (
            between(rules, param, first, last, steps)
            if texts is None
            else chosen(rules, param, texts)
        )
        result = sweep(
            self._refs, self._settings.rules, param, visited, overrides=self._settings.overrides,
            bind=self._settings.bind, jobs=1,
        )  # fmt: skip
        return pd.DataFrame(result.rows(by))

    def compare(self, other: Scores | None = None, by: By | None = None) -> pd.DataFrame:
        """Return the differences of the rates on the same rollouts, as ``safestage compare``.

        Args:
            other: what these are compared with; None: the two policies (or prompts) in these.
            by: ``policy``, ``prompt`` or ``rules``; None: by what the two differ.

        Returns a row per scope and metric: rates ``a`` and ``b`` 0…1, ``difference``, its 95 % interval,
        McNemar's p and Holm's. ``attrs["names"]`` says who a and b are, ``attrs["warnings"]`` what
        the sample is too small for.
        Raises InputError: nothing belongs together, or what is to be compared is not clear.
        """
        import pandas as pd

        from safestage_eval.metrics import outcomes
        from safestage_eval.metrics.comparison import compare, differs
        from safestage_eval.report.paired_report import row, warnings

        mine = outcomes(self._judged.results)
        if other is None:
            field: By = by or ("policy" if len({o.policy for o in mine}) > 1 else "prompt")
            names = sorted({str(getattr(o, field, "")) for o in mine})
            if field == "rules" or len(names) != 2:
                raise InputError(
                    f"compare(by={field!r})", f"{len(names)} values: {', '.join(names)}.", "two",
                    "give other scores to compare with, or another by",
                )  # fmt: skip
            sides = [[o for o in mine if str(getattr(o, field)) == name] for name in names]
        else:
            sides = [mine, outcomes(other._judged.results)]  # noqa: SLF001 — its own kind
            field = by or differs(*sides)
            names = ["these", "other"]
            if field != "rules":
                names = [str(getattr(side[0], field)) if side else "–" for side in sides]
        comparison = compare(sides[0], sides[1], field, (names[0], names[1]))
        columns = {
            "scope": "of", "metric": "metric", "n": "pairs", "rate_a": "a", "rate_b": "b",
            "difference": "difference", "low": "low", "high": "high", "p": "p", "p_holm": "p_holm",
            "significant": "significant",
        }  # fmt: skip
        frame = pd.DataFrame([row(line, 1.0) for line in comparison.lines])
        frame = frame[[*columns]].rename(columns=columns)
        frame.attrs.update(names=comparison.names, by=field, warnings=warnings(comparison))
        return frame

    def view(self, episode: str | None = None) -> Page:
        """Show an episode in 3-D with its signals, limits and findings, as ``safestage view``.

        ``episode``: its id, or a part that only it has; may be left out where there is one.
        Raises InputError for an id that no episode has, or where there are several.
        """
        from safestage_eval.viewer.campaign.campaign_data import judged
        from safestage_eval.viewer.run_report import report_page

        ref = self._ref(episode)
        path = Path(tempfile.mkdtemp(prefix="safestage-")) / "episode.html"
        report = judged([ref], self._settings, ref.episode_id, str(ref.path), jobs=1, sweep=False)
        path.write_text(report_page(report), "utf-8")
        return Page(path)

    def plot(self, episode: str | None = None, *signals: str, rule: str | None = None) -> Picture:
        """Draw signals of an episode with their units, limits and verdicts, as ``safestage plot``.

        Args:
            episode: its id, or a part that only it has; may be left out where there is one.
            signals: ``"clearance(target, protected)"``; what decides its rules if there are none.
            rule: what decides this one, instead.

        Raises InputError for names that do not exist, where nothing decides, or without matplotlib.
        """
        from safestage_eval.report.signal_plot import figure_of, panels
        from safestage_eval.whatif.judge_again import Again

        ref, settings = self._ref(episode), self._settings
        again = Again(ref.open(), settings.rule_set, settings.overrides or {}, settings.bind)
        return Picture(figure_of(again, panels(again, signals, rule=rule)))

    def __getattr__(self, name: str) -> Any:
        """Say what to use instead of a method that is gone."""
        if name == "to_pandas":
            raise AttributeError(
                "Scores.to_pandas is gone: use scores.rows, which is a pandas DataFrame"
            )
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def to_polars(self) -> pl.DataFrame:
        """Return the rows as a polars frame."""
        import polars as pl

        from safestage_eval.report.result_rows import COLUMNS, rows

        return pl.DataFrame(
            [in_si_units(row) for row in rows(self._judged)],
            schema=list(COLUMNS), infer_schema_length=None,
        )  # fmt: skip

    def _result(self, episode: str) -> EpisodeResult:
        ref = self._ref(episode)
        return next(r for r in self._judged.results if r.episode_id == ref.episode_id)

    def _ref(self, episode: str | None) -> EpisodeRef:
        judged = {result.episode_id for result in self._judged.results}
        refs = {ref.episode_id: ref for ref in reversed(self._refs) if ref.episode_id in judged}
        if episode in refs:
            return refs[episode]
        some = [name for name in refs if episode is None or episode in name]
        if len(some) == 1:
            return refs[some[0]]
        raise InputError(
            f"episode {episode!r}" if episode is not None else "no episode named",
            f"{len(some)} of {len(refs)} episodes are meant.", "one",
            did_you_mean(episode or "", refs) or f"name one: {', '.join((some or [*refs])[:5])}",
        )  # fmt: skip

    def _headline(self) -> str:
        from safestage_eval.metrics import outcomes, rates
        from safestage_eval.report.summary import headline

        judged = self._judged
        return "; ".join(
            headline(rates(outcomes(judged.results, judged.set_aside)), len(judged.problems))
        )

    def __repr__(self) -> str:
        """Return the headline and the rates as text."""
        return f"{self._headline()}\n{self.rates.to_string(index=False)}"

    def _repr_html_(self) -> str:
        from safestage_eval.report.summary import rate_table

        shown = rate_table(self._cells())
        problems = [(p["message"],) for p in self.problems]
        parts = [table(("could not be judged",), problems, 5)] if problems else []
        rates = table(shown.columns, shown.rows)
        return card(self._headline(), rates, *parts) + self.findings._repr_html_()


def score(
    paths: str | Path | Episode | Sequence[str | Path | Episode],
    rules: str | Path | Sequence[str | Path] = (),
    *,
    bind: str | Path | None = None,
    assign: str | Sequence[str] = (),
    roles: Mapping[str, str | Sequence[str]] | None = None,
    jobs: int | None = 1,
    **settings: str | float,
) -> Scores:
    """Judge episodes by rules, and return their verdicts.

    Args:
        paths: files and folders, or episodes.
        rules: rule files, folders or built-in names; all built-in ones if empty.
        bind: a bind file: roles, goal, rules and values that the traces' headers lack.
        assign: codes of the rules that every episode is judged by, or patterns of codes.
        roles: role → names of bodies or patterns, for every episode; [] for none.
        jobs: worker processes; scripts that use several need the usual ``__main__`` guard.
        settings: parameter values, ``edge="3 cm"``; a number is in SI: ``edge=0.03``.

    Raises:
        TraceError: nothing was found.
        RuleErrors, RuleError, InputError: rules, values or roles that do not mean anything.
    """
    from safestage_eval.formats import discover
    from safestage_eval.formats.episode_filter import Selection
    from safestage_eval.rules import builtin_names
    from safestage_eval.run.gates import Gates

    def several(value: str | Path | Sequence[str | Path]) -> list[str | Path]:
        return [value] if isinstance(value, str | Path) else list(value)

    def joined(bodies: str | Sequence[str]) -> str:
        return bodies if isinstance(bodies, str) else ",".join(bodies)

    given = [paths] if isinstance(paths, str | Path | Episode) else list(paths)
    stored = [_stored(item) if isinstance(item, Episode) else item for item in given]
    specs = several(rules) or list(builtin_names())
    codes = [assign] if isinstance(assign, str) and assign else list(assign)
    named = [f"{role}={joined(bodies)}" for role, bodies in (roles or {}).items()]
    values = {name: _with_unit(specs, name, value) for name, value in settings.items()}
    asked = load_settings(specs, overrides=values, bind=bind, assign=codes, roles=named)
    chosen = Selection(discover(stored), None)
    refs = [*chosen]
    results, problems, copies = deduplicate(score_many(refs, settings=asked, jobs=jobs))
    judged = Judged(
        tuple(results), tuple(problems), titles(asked.rule_set), tuple(copies),
        tuple(chosen.aborted), gates=Gates.of(specs),
    )  # fmt: skip
    return Scores(judged, refs, asked)


def _stored(episode: Episode) -> Path:
    """A file that holds an episode, so that it can be judged and shown as any other."""
    from safestage_eval.formats import save

    path = Path(tempfile.mkdtemp(prefix="safestage-")) / "episode.mcap"
    save(episode, path)
    return path


def _with_unit(specs: Sequence[str | Path], name: str, value: str | float) -> str:
    """A parameter's value as rules write it; a number gets the SI unit of its dimension."""
    from safestage_eval.rules import load_rules
    from safestage_eval.rules.names import dimension_of

    params = load_rules(specs).params if not isinstance(value, str) else {}
    unit = si_unit(dimension_of(params[name])) if name in params else ""
    return f"{value} {unit}".strip()


DTYPES = {"integer": "Int64", "boolean": "boolean", "number": "float64"}
"""Kind of a column → type; ``rows[rows.violation]`` takes an unknown truth as false."""


def in_si_units(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row with value, limit and margin in SI; their unit says so."""
    unit = row["unit"]
    if unit not in UNIT_DIMENSION:
        return dict(row)
    dimension = UNIT_DIMENSION[unit]
    converted = {**row, "unit": si_unit(dimension)}
    for name in ("value", "limit"):
        converted[name] = None if row[name] is None else in_si(row[name], unit)
    if row["margin"] is not None:
        converted["margin"] = row["margin"] * DIMENSIONS[dimension][unit]
    return converted


def result_frame(rows: Iterable[Mapping[str, Any]]) -> pd.DataFrame:
    """Rows of ``report.result_rows``, columns of the kinds that these have."""
    import pandas as pd

    frame = pd.DataFrame([in_si_units(row) for row in rows], columns=list(COLUMNS))
    return frame.astype({name: DTYPES[kind] for name, kind in KINDS.items() if kind in DTYPES})
