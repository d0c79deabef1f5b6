"""Whoever waits for a server hears that it ended by itself; when it is closed, nothing is said."""

import threading

import pytest

from safestage_eval._serving.listener import Listener
from safestage_eval.errors import InputError


class Toy(Listener):
    url = "toy://here"

    def __init__(self, loop):
        self._begin(loop)

    def close(self): ...


def test_a_loop_that_breaks_is_reported():
    def breaks():
        raise OSError(28, "No space left on device")

    with pytest.raises(InputError, match=r"toy://here: the server ended: OSError: .*No space"):
        Toy(breaks).wait()


def test_a_loop_that_is_closed_is_no_failure():
    stop = threading.Event()
    with Toy(lambda: stop.wait(20)) as toy:
        stop.set()
        toy.wait()
