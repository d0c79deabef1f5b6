"""Which verdicts count where a build may fail."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from safestage_eval.verdicts import EpisodeResult, Verdict


@dataclass(frozen=True)
class Gates:
    """Which verdicts count where a build may fail: ``--fail-on``, golden files, JUnit, annotations.

    Those of assigned rules always do; besides, those of rules that the user named (docs/ci.md).

    Attributes:
        named: codes of rules whose file was named: they count in every episode.
        chosen: codes of rules of a folder or built-in set that was named: they count in episodes
            to which nothing is assigned.
    """

    named: frozenset[str] = frozenset()
    chosen: frozenset[str] = frozenset()

    def counted(self, result: EpisodeResult) -> tuple[Verdict, ...]:
        """The verdicts that count."""
        assigned = bool(result.assigned or result.not_loaded)
        extra = self.named if assigned else self.named | self.chosen
        return tuple(v for v in result.verdicts if v.assigned or v.rule in extra)

    def violation(self, result: EpisodeResult) -> bool | None:
        """Whether any of them is a violation; None where that is open, or nothing was judged."""
        counted = self.counted(result)
        if any(v.verdict == "violation" for v in counted):
            return True
        open_ = any(v.violation is None or v.vacuity == "unbound" for v in counted)
        return None if not counted or open_ or result.not_loaded else False

    @classmethod
    def of(cls, rules: Sequence[str | Path]) -> Gates:
        """Gates for rule files as given; the default, all built-in sets, names none."""
        from safestage_eval.rules import builtin_names
        from safestage_eval.rules.files import codes_of

        if list(rules) == builtin_names():
            return cls()
        files = [spec for spec in rules if Path(spec).is_file()]
        named = codes_of(files)
        return cls(named, codes_of([spec for spec in rules if spec not in files]) - named)
