"""Sample of rollouts to label, in a mixed order."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence

from safestage_eval.formats import EpisodeRef


def sample(refs: Sequence[EpisodeRef], count: int | None = None, seed: int = 0) -> list[EpisodeRef]:
    """Draw a number of episodes, as evenly over the stages as possible, in a mixed order.

    Within a stage the combinations of policy, prompt and native success take turns. Which episodes
    of a combination are taken is decided by a hash of seed and id: another run chooses the same,
    whatever the order of files, and an episode that is added later displaces few.

    Args:
        refs: episodes that can be opened; of one id the first counts.
        count: how many; all if None.
        seed: of the choice.
    """
    by_id = {ref.episode_id: ref for ref in reversed(refs)}
    every = [by_id[name] for name in dict.fromkeys(ref.episode_id for ref in refs)]
    chosen = every if count is None else _chosen(every, min(count, len(every)), seed)
    return sorted(chosen, key=lambda ref: _rank(seed, "order", ref.episode_id))


def _chosen(refs: Iterable[EpisodeRef], count: int, seed: int) -> list[EpisodeRef]:
    stages: dict[str, list[EpisodeRef]] = {}
    for ref in refs:
        stages.setdefault(ref.fields.get("stage") or "", []).append(ref)
    queues = [_in_turn(_cells(stages[stage], seed)) for stage in sorted(stages)]
    turns = _in_turn([list(queue) for queue in queues])
    return [ref for ref, _ in zip(turns, range(count), strict=False)]


def _cells(refs: Iterable[EpisodeRef], seed: int) -> list[list[EpisodeRef]]:
    """Group episodes by policy, prompt and success; cells and their episodes ordered by hash."""
    cells: dict[str, list[EpisodeRef]] = {}
    for ref in sorted(refs, key=lambda ref: _rank(seed, "episode", ref.episode_id)):
        key = [ref.fields.get(name) for name in ("policy", "prompt", "success")]
        cells.setdefault(repr(key), []).append(ref)
    return [cells[key] for key in sorted(cells, key=lambda key: _rank(seed, "cell", key))]


def _in_turn(queues: Sequence[Sequence[EpisodeRef]]) -> Iterator[EpisodeRef]:
    """Yield the first of each queue, the second of each, … as long as there are any."""
    for turn in range(max(map(len, queues), default=0)):
        yield from (queue[turn] for queue in queues if turn < len(queue))


def _rank(seed: int, purpose: str, name: str) -> bytes:
    return hashlib.sha256(f"{seed}\n{purpose}\n{name}".encode()).digest()
