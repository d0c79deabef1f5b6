"""A prompt as numbers: its words and pairs of words, each hashed to a fixed vector of signs."""

from __future__ import annotations

import re
from functools import cache
from hashlib import shake_256
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

WIDTH = 128


@cache
def embedded(prompt: str) -> NDArray[np.float32]:
    """(WIDTH,) of a prompt, of norm √WIDTH: the same on every machine, and it needs no model.

    The sum of one random vector of ±1 per word and per pair of neighbouring words (a random projection
    of the bag of words; Kanerva et al. 2000, "Random indexing of text samples"). Prompts that share words are
    near each other, and what words mean is not in it.
    """
    words = re.findall(r"\w+", prompt.lower())
    tokens = [*words, *(f"{a} {b}" for a, b in pairwise(words))]
    total = np.zeros(WIDTH)
    for token in tokens:
        bits = np.unpackbits(np.frombuffer(shake_256(token.encode()).digest(WIDTH // 8), np.uint8))
        total += 2.0 * bits - 1.0
    norm = float(np.linalg.norm(total))
    return (total * (np.sqrt(WIDTH) / norm if norm else 0.0)).astype(np.float32)
