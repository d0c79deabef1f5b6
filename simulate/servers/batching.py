"""A server between several environments and one GR00T: what waits goes on as one batch.

While the model thinks, requests gather; the next batch is all of them. So nothing ever waits for a
batch to become full, and the busier the model is, the larger the batches are.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any

from safestage_eval._serving.guard import Guard
from simulate.clients.address import Address
from simulate.clients.batch import join, kind, part, rows
from simulate.clients.line import ZeromqLine
from simulate.clients.message_arrays import pack, unpack
from simulate.policy import PolicyError

from .zeromq import Asked, Router


class GatheringServer(Router):
    """Hands requests on to a server of GR00T's protocol, and their answers back."""

    def __init__(
        self,
        behind: Address,
        most: int,
        host: str = "127.0.0.1",
        port: int = 0,
        guard: Guard | None = None,
    ) -> None:
        """Begin to serve.

        Args:
            behind: the server of the model.
            most: observations in a batch.
            host: to listen on.
            port: to listen on; any free one for 0.
            guard: how much it takes.

        Raises OSError.
        """
        self._behind, self._most = behind, most
        self._patience = behind.common.timeout or behind.dialect.patience
        self._line: ZeromqLine | None = None
        self.batches: Counter[int] = Counter()
        """Observations in a request → how many requests had so many."""
        super().__init__(host, port, guard)

    def answers(self, waiting: Sequence[Asked]) -> Iterator[Asked]:
        """Requests for actions in batches, everything else as it is."""
        together: list[tuple[bytes, dict[str, Any]]] = []
        for client, message in waiting:
            try:
                request = unpack(message)
                rows(request["data"]["observation"])
            except (ValueError, KeyError, TypeError):
                yield client, self._asked(message)
            else:
                together.append((client, request))

        def alike(one: tuple[bytes, dict[str, Any]]) -> str:
            return repr(kind({**one[1], "data": {**one[1]["data"], "observation": None}})) + repr(
                kind(one[1]["data"]["observation"])
            )

        for _, group in groupby(sorted(together, key=alike), alike):
            yield from self._in_batches([*group])

    def _in_batches(self, requests: list[tuple[bytes, dict[str, Any]]]) -> Iterator[Asked]:
        while requests:
            batch: list[tuple[bytes, dict[str, Any]]] = []
            total = 0
            for client, request in requests:
                total += rows(request["data"]["observation"])
                if batch and total > self._most:
                    break
                batch.append((client, request))
            requests = requests[len(batch) :]
            yield from self._as_one(batch)

    def _as_one(self, batch: list[tuple[bytes, dict[str, Any]]]) -> Iterator[Asked]:
        observations = [request["data"]["observation"] for _, request in batch]
        first = batch[0][1]
        whole = {**first, "data": {**first["data"], "observation": join(observations)}}
        answer = self._asked(pack(whole, self._behind.dialect.style))
        ends = [0]
        for observation in observations:
            ends.append(ends[-1] + rows(observation))
        try:
            actions, about = unpack(answer)
            if rows(actions) != ends[-1]:
                raise ValueError(f"{rows(actions)} answers to {ends[-1]} observations")
        except (ValueError, TypeError):
            if len(batch) == 1:
                yield batch[0][0], answer
                return
            for one in batch:  # what is wrong with one of them is not to be the others' trouble
                yield from self._as_one([one])
            return
        self.batches[ends[-1]] += 1
        for (client, _), begin, end in zip(batch, ends[:-1], ends[1:], strict=True):
            yield client, pack([part(actions, begin, end), about], self._behind.dialect.style)

    def finish(self) -> None:
        """Hang up."""
        if self._line is not None:
            self._line.close()
            self._line = None

    def _asked(self, message: bytes) -> bytes:
        try:
            self._line = self._line or ZeromqLine(self._behind.url)
            answer = self._line.ask(message, self._patience)
        except PolicyError as error:
            self.finish()
            return pack({"error": str(error)})
        return answer if isinstance(answer, bytes) else answer.encode()
