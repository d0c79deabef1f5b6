"""What can be wrong with a task file, an object catalogue or an arm model."""

from __future__ import annotations

from safestage_eval.errors import InputError


class SceneError(InputError):
    """A task, catalogue or robot model that no scene can be built from."""
