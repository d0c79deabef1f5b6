"""A server in a thread of its own, which tells whoever waits for it how it ended."""

from __future__ import annotations

import threading
from abc import abstractmethod
from collections.abc import Callable

from safestage_eval._process.closing import Closing
from safestage_eval.errors import InputError


class Listener(Closing):
    """Serves from when it is made until it is closed. A context manager.

    Attributes:
        url: its address.
    """

    url: str

    def _begin(self, loop: Callable[[], None]) -> None:
        """Run the loop of messages until it returns."""
        self._failure: BaseException | None = None

        def run() -> None:
            try:
                loop()
            except BaseException as error:  # noqa: BLE001 - raised again where somebody waits
                self._failure = error

        self._thread = threading.Thread(target=run, daemon=True)
        self._thread.start()

    @abstractmethod
    def close(self) -> None:
        """Stop answering."""

    def wait(self) -> None:
        """Serve until somebody closes it. Raises InputError where it ended by itself."""
        self._thread.join()
        if self._failure is not None:
            error = self._failure
            raise InputError(
                self.url, f"the server ended: {type(error).__name__}: {error}.",
                fix="start it again",
            ) from error  # fmt: skip
