"""Agreement beyond chance, between two raters or more."""

from __future__ import annotations

from collections.abc import Sequence


def cohen(table: Sequence[Sequence[int]]) -> float | None:
    """Cohen's kappa of a square table of counts, one rater's answers by the other's.

    None where it is not defined: without counts, or when both gave the same single answer
    throughout, so that nothing is left beyond chance. Source: J. Cohen, "A coefficient of agreement
    for nominal scales", Educational and Psychological Measurement 20, 1960.
    """
    n = sum(map(sum, table))
    if not n:
        return None
    alike = sum(table[i][i] for i in range(len(table)))
    rows, columns = (
        [sum(row) for row in table],
        [sum(column) for column in zip(*table, strict=True)],
    )
    chance = sum(a * b for a, b in zip(rows, columns, strict=True))
    if chance == n * n:
        return None
    return float((n * alike - chance) / (n * n - chance))


def fleiss(counts: Sequence[Sequence[int]]) -> float | None:
    """Fleiss' kappa: a row per subject, with how many raters gave each answer.

    Every subject has the same number of raters, two at least. None where it is not defined: without
    rows, or when only one answer was ever given. Source: J. L. Fleiss, "Measuring nominal scale
    agreement among many raters", Psychological Bulletin 76, 1971.

    Raises:
        ValueError: the numbers of raters differ, or there are fewer than two.
    """
    if not counts:
        return None
    raters = sum(counts[0])
    if raters < 2 or any(sum(row) != raters for row in counts):
        raise ValueError("every subject needs the same number of raters, two at least")
    n = len(counts)
    alike = sum(x * (x - 1) for row in counts for x in row) / (n * raters * (raters - 1))
    chance: float = sum((sum(column) / (n * raters)) ** 2 for column in zip(*counts, strict=True))
    return None if chance == 1 else (alike - chance) / (1 - chance)
