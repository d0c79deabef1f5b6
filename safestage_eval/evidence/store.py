"""The store that answers queries about one episode; this one keeps the answers in memory.

Signals and relations ask a store and hand it the function that measures. Which store it is they do
not know: others keep answers on disk (``disk_store``) or extend them as the episode grows
(``growing_store``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from .partial import Partial
from .query import Growth, Query
from .series import Series

Bool = NDArray[np.bool_]
Column = NDArray[Any]
Item = TypeVar("Item")

_NOT_ASKED = object()


class Store:
    """Answers queries about one episode; each is measured once.

    Measuring functions take the relations (with signals) of a stretch of frames to measure at, or
    None for the whole episode; only a store of a growing episode hands them a stretch.

    Attributes:
        lasting: answers outlive the process, so that whole series are worth measuring.
        sparse_count: how often something was measured at chosen frames.
    """

    lasting = False

    def __init__(self) -> None:
        """Start empty."""
        self.sparse_count = 0
        self._known: dict[Query, Any] = {}

    def series(
        self, query: Query, measure: Callable[[Any], Series], growth: Growth = Growth.WHOLE
    ) -> Series:
        """(T,) the signal that answers a query."""
        return cast(Series, self._answer(query, measure, growth))

    def column(
        self, query: Query, measure: Callable[[Any], Column | None], growth: Growth = Growth.WHOLE
    ) -> Column | None:
        """(T,) of any type: where a relation holds, say; None where the trace does not tell."""
        return cast("Column | None", self._answer(query, measure, growth))

    def value(self, query: Query, measure: Callable[[Any], Any]) -> Any:
        """A single JSON value about the whole episode."""
        return self._answer(query, measure, Growth.WHOLE)

    def items(self, query: Query, measure: Callable[[Any], Iterable[Item]]) -> list[Item]:
        """Everything that occurs at any frame of the episode, sorted."""
        return cast("list[Item]", self._answer(query, measure, Growth.WHOLE))

    def partial(
        self,
        query: Query,
        wanted: Bool,
        measure: Callable[[Any, NDArray[np.int64]], tuple[NDArray[np.int64], Series]],
        growth: Growth = Growth.PER_FRAME,
    ) -> Partial:
        """A costly measurement, done at least at the wanted frames (T,).

        ``measure`` takes the frames (N,) that are missing and returns frames (M,), these and
        possibly more, with the values there.
        """
        partial = self._partial(query, len(wanted))
        missing = partial.missing(wanted)
        if len(missing):
            self.sparse_count += 1
            partial.add(*self._measure_at(missing, measure, growth))
            self._added(query)
        return partial

    def unmeasured(
        self,
        query: Query,  # noqa: ARG002
        measure: Callable[[Any], Column | None],
    ) -> Column | None:
        """(T,) where something was not measured, None if nowhere, as far as was read by now.

        As more may have been read since it was last asked, it is found anew each time.
        """
        return measure(None)

    def answer(self, question: str, find: Callable[[], Any]) -> Any:  # noqa: ARG002
        """The JSON answer to a question that names all that it depends on besides the trace."""
        return find()

    @property
    def opened(self) -> bool:
        """Something was read from the trace, and not known from an earlier process."""
        return True

    def _answer(
        self,
        query: Query,
        measure: Callable[[Any], Any],
        growth: Growth,  # noqa: ARG002
    ) -> Any:
        found = self._known.get(query, _NOT_ASKED)
        if found is _NOT_ASKED:
            found = self._known[query] = self._first(query, measure)
        return found

    def _first(self, query: Query, measure: Callable[[Any], Any]) -> Any:  # noqa: ARG002
        """The answer to a query that was not asked before."""
        return measure(None)

    def _partial(self, query: Query, frames: int) -> Partial:
        if query not in self._known:
            self._known[query] = Partial.blank(frames)
        return cast(Partial, self._known[query])

    def _measure_at(
        self,
        at: NDArray[np.int64],
        measure: Callable[[Any, NDArray[np.int64]], tuple[NDArray[np.int64], Series]],
        growth: Growth,  # noqa: ARG002
    ) -> tuple[NDArray[np.int64], Series]:
        return measure(None, at)

    def _added(self, query: Query) -> None:
        """Take note that a partial answer has grown."""
