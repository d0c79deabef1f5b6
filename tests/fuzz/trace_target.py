"""A damaged trace taken for other ends than scoring."""

from __future__ import annotations

from pathlib import Path
from random import Random

from safestage_eval.errors import InputError
from safestage_eval.formats import load, save, validate


def used(rng: Random, path: Path, folder: Path) -> None:
    """Validate, load and save it; raises what nobody foresaw."""
    try:
        validate(path)
        episode = load(path, checked=rng.random() < 0.5)
        save(episode, folder / rng.choice(("other", "other.mcap")))
    except InputError:
        pass
