"""One verdict that is not safe, as a notebook shows it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from safestage_eval.units import format_quantity

from .notebook_cards import Page, Picture, card, facts, verdict, words
from .notebook_episode import si_unit

if TYPE_CHECKING:
    from safestage_eval.verdicts import Verdict


class Shown(Protocol):
    """An object that can show an episode: ``Scores``."""

    def plot(self, episode: str | None = None, *signals: str, rule: str | None = None) -> Picture:
        """Draw signals, or what decides a rule."""

    def view(self, episode: str | None = None) -> Page:
        """Show an episode in 3-D."""


@dataclass(frozen=True, repr=False)
class Finding:
    """A violation of one rule in one episode, or a rule that could not be decided there.

    Attributes:
        episode_id: of the episode.
        of: everything that is known of the verdict: ``intervals``, ``phase``, ``notes`` and more.
    """

    episode_id: str
    of: Verdict
    _scores: Shown = field(compare=False)

    @property
    def rule(self) -> str:
        """Code of the rule."""
        return self.of.rule

    @property
    def verdict(self) -> str:
        """``violation`` or ``inconclusive``."""
        return self.of.verdict

    @property
    def explanation(self) -> str:
        """One sentence: the event that was seen, or why the rule cannot be decided."""
        return self.of.explanation or self.of.title

    @property
    def time(self) -> float | None:
        """Time at which it began, s."""
        return self.of.time

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies that it is about."""
        return tuple(self.of.bodies)

    @property
    def signal(self) -> str | None:
        """The measured signal with its bodies, as ``clearance(cup, vase)``."""
        return self.of.signal

    @property
    def value(self) -> float | None:
        """Value of the signal at the worst moment, in SI."""
        return self.of.value

    @property
    def limit(self) -> float | None:
        """Limit of the rule at the worst moment, in SI."""
        return self.of.limit

    @property
    def unit(self) -> str:
        """Unit of ``value`` and ``limit``: ``m``, ``N``, ``s``."""
        return si_unit(self.of.dimension or "")

    @property
    def by_how_much(self) -> str:
        """How far it is beyond its limit, in words: ``5.4 cm``; empty where nothing was measured."""
        if self.verdict != "violation" or self.of.margin is None or self.of.dimension is None:
            return ""
        return format_quantity(abs(self.of.margin), self.of.dimension)

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
        head = f"{self.episode_id}: {v.rule} {v.title}"
        said = f"<p>{verdict(v.verdict)} {words(self.explanation)}</p>"
        return card(head, said, facts(rows))
