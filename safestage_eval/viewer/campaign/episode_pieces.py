"""The evidence of many episodes, each opened once, in one process or several."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from safestage_eval.formats import EpisodeRef
from safestage_eval.rules import RuleSet
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.syntax import amount
from safestage_eval.run.settings import Settings
from safestage_eval.verdicts.players import nodes
from safestage_eval.verdicts.problem import Problem
from safestage_eval.viewer.camera_film import film_of
from safestage_eval.viewer.episode.episode_data import (
    StoredVerdicts,
    differences,
    episode_data,
    listed,
)
from safestage_eval.viewer.packed import packed, script
from safestage_eval.whatif.each_episode import each_episode
from safestage_eval.whatif.judge_again import Again
from safestage_eval.whatif.sweep import Sweep, Swept, sweep_episode, swept_over
from safestage_eval.whatif.swept_values import between

from .run_list import piece_name

STEPS = 41
"""Values of a limit that are visited, from nothing to twice its default."""

DRAWN = 4
"""Limits whose sensitivity is drawn: those near whose values rates move most."""


@dataclass(frozen=True)
class Pieces:
    """The evidence of episodes, for the browser.

    Attributes:
        packed: name of a piece → its content, compressed; empty where they were written to a folder.
        names: episode id → name of its piece.
        films: name of a piece → camera film of the episode.
        sweeps: limits against rates.
        differing: ids of the episodes of which results and rules do not agree.
        problems: what could not be opened or judged.
        bytes: of all pieces.
    """

    packed: Mapping[str, str]
    names: Mapping[str, str]
    films: Mapping[str, Path]
    sweeps: tuple[Sweep, ...]
    differing: tuple[str, ...]
    problems: tuple[Problem, ...]
    bytes: int = 0


class Drawn(NamedTuple):
    """One episode: its pieces unless they were written, and by parameter its verdicts under other limits."""

    episode_id: str
    packed: Mapping[str, str]
    bytes: int
    film: Path | None
    differs: bool
    swept: Mapping[str, Swept]


@dataclass(frozen=True)
class Drawing:
    """Draws episodes, in this process or in others.

    Attributes:
        settings: how they are judged.
        said: episode id → what the results say of it.
        names: episode id → name of its piece.
        folder: where the pieces are written, each as a script; None: they are kept.
        everything: rules that pass without being assigned as well.
        visited: parameter → the values of it under which episodes are judged.
    """

    settings: Settings
    said: Mapping[str, StoredVerdicts]
    names: Mapping[str, str]
    folder: Path | None
    everything: bool
    visited: Mapping[str, tuple[ast.Setting, ...]]

    def __call__(self, ref: EpisodeRef) -> Drawn:
        """Write the evidence of one episode, and sweep it. Raises TraceError if it cannot be read."""
        episode, settings, folder = ref.open(), self.settings, self.folder
        again = Again(episode, settings.rule_set, settings.overrides or {}, settings.bind)
        name = episode.header.episode_id
        stored = self.said.get(name, {})
        meshes: dict[str, bytes] = {}
        content = episode_data(again, stored, everything=self.everything, shared=meshes)
        made = {self.names[ref.episode_id]: packed(content)}
        for key, mesh in meshes.items():
            if folder is None or not (folder / f"{key}.js").exists():
                made[key] = packed(mesh)
        if folder is not None:
            for key, data in made.items():
                write_piece(folder, key, data)
        read = {
            param for rule in again.assigned if isinstance(rule, ast.Rule) for param in limits(rule)
        }
        return Drawn(
            name,
            made if folder is None else {},
            sum(map(len, made.values())),
            film_of(ref, episode.header.video),
            bool(differences([v for _, v in listed(again) if v.assigned], stored)),
            {
                param: sweep_episode(again, param, self.visited[param])
                for param in sorted(read & self.visited.keys())
            },
        )


def pieces(
    refs: Sequence[EpisodeRef],
    said: Mapping[str, StoredVerdicts],
    settings: Settings,
    *,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    folder: Path | None = None,
    everything: bool = False,
    sweep: bool = True,
) -> Pieces:
    """Gather evidence of episodes, and determine on which limits their verdicts depend.

    Arguments as of ``Drawing``; ``sweep``: find out on which limits verdicts depend; those that are set are
    not moved. Raises RuleError, InputError as ``score_many``.
    """
    rules = settings.rule_set
    visited = {
        name: tuple(sorted(between(rules, name, None, None, STEPS), key=amount))
        for name in {name for rule in rules.rules.values() for name in limits(rule)}
        if sweep and amount(rules.params[name]) > 0 and name not in (settings.overrides or {})
    }
    names = {ref.episode_id: piece_name(place) for place, ref in enumerate(refs)}
    work = Drawing(settings, dict(said), names, folder, everything, visited)
    drawn, problems = each_episode(refs, work, jobs=jobs, progress=progress)
    return Pieces(
        {name: data for item in drawn for name, data in item.packed.items()},
        {item.episode_id: names[item.episode_id] for item in drawn},
        {names[item.episode_id]: item.film for item in drawn if item.film is not None},
        _sweeps(rules, visited, drawn),
        tuple(item.episode_id for item in drawn if item.differs),
        tuple(problems),
        sum(item.bytes for item in drawn),
    )


def write_piece(folder: Path, name: str, data: str) -> None:
    """Write a packed piece as a script; several processes may write the same one."""
    own = folder / f"{name}.{os.getpid()}.tmp"
    own.write_text(script(name, data), "ascii")
    own.replace(folder / f"{name}.js")


def limits(rule: ast.Rule) -> set[str]:
    """Parameters that a rule compares a measurement with."""
    return {
        node.name
        for clause in rule.clauses
        for atom in nodes(clause.what)
        if isinstance(atom, ast.SignalAtom)
        for limit in atom.limits
        for node in [limit.value]
        if isinstance(node, ast.Parameter)
    }


def _sweeps(
    rules: RuleSet, visited: Mapping[str, tuple[ast.Setting, ...]], drawn: Sequence[Drawn]
) -> tuple[Sweep, ...]:
    """The limits near whose values rates move most; of like ones those at which most verdicts flip."""
    ranked = []
    for param, values in visited.items():
        swept = [item.swept[param] for item in drawn if param in item.swept]
        sweep = swept_over(rules, param, values, swept)
        if flips := len(sweep.flips()):
            ranked.append((-moved_near(sweep), -flips, param, sweep))
    ranked.sort(key=lambda each: each[:3])
    return tuple(sweep for *_, sweep in ranked[:DRAWN])


def moved_near(sweep: Sweep) -> float:
    """How far a policy's violation rate, 0…1, moves while the limit goes from half to one and a half of its value."""
    default = amount(sweep.default)
    near = [
        i for i, value in enumerate(sweep.values) if abs(amount(value) - default) <= 0.5 * default
    ]
    most = 0.0
    for cells in sweep.curves(("policy",)).values():
        bounds = [found for i in near if (found := cells[i].bounds("VR")) is not None]
        for ends in zip(*bounds, strict=True):
            most = max(most, max(ends) - min(ends))
    return most
