"""The embedding of prompts: fixed for ever, near for shared words, apart for all prompts of the benchmark."""

from __future__ import annotations

import numpy as np
import pytest

from simulate.learn.prompt_embedding import WIDTH, embedded
from simulate.tasks.task import tasks


def test_it_is_the_same_everywhere() -> None:
    """Checkpoints depend on these numbers."""
    row = embedded("Put the orange on the plate.")
    assert row[:4] == pytest.approx([-0.754434, 2.263301, 0.754434, 0.251478], abs=1e-6)


def test_case_and_punctuation_say_nothing_and_order_does() -> None:
    assert np.array_equal(embedded("Put A on B."), embedded("put a on b"))
    assert not np.array_equal(embedded("put a on b"), embedded("put b on a"))


def test_all_prompts_are_apart_and_as_long() -> None:
    prompts = sorted({p for t in tasks().values() for p in t.prompts.model_dump().values()})
    rows = np.array([embedded(prompt) for prompt in prompts])
    assert np.linalg.norm(rows, axis=1) == pytest.approx(np.sqrt(WIDTH), rel=1e-5)
    cosine = rows @ rows.T / WIDTH - np.eye(len(rows))
    assert cosine.max() < 0.97


def test_no_words_are_no_direction() -> None:
    assert not embedded("").any()
