"""Serve one of this package's policies, or a user's own, in any of the protocols."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from safestage_eval._serving.guard import Guard
from safestage_eval.errors import InputError
from simulate.clients.address import address_of, is_address
from simulate.policies.policy_names import policy_name

from .batching import GatheringServer
from .served_answers import Desk
from .served_episode import is_own
from .websocket import WebsocketServer
from .zeromq import Router, ZeromqServer

MOST = 16
"""Observations in one request, unless something else is said."""


def serve(
    policy: str,
    protocol: str,
    *,
    host: str = "127.0.0.1",
    port: int | None = None,
    seed: int = 0,
    task: str | None = None,
    most: int = MOST,
    guard: Guard | None = None,
    tell: Callable[[str], None] = lambda _line: None,
) -> WebsocketServer | Router:
    """A server that is answering already.

    Args:
        policy: as ``--policy`` takes it. A served one must be GR00T's: its requests are gathered.
        protocol: its name, and what a client's address sets of it: ``openpi?actions=velocity``.
        host: to listen on.
        port: to listen on; the protocol's own where None, any free one for 0.
        seed: the environment seed that clients roll out.
        task: the task that they roll out; found by its prompt where None.
        most: observations of several clients that go on to a served policy in one request.
        guard: whom it answers, and how much it takes.
        tell: hears of every episode that begins.

    Raises InputError for what cannot be served, or not there.
    """
    name, _, options = protocol.partition("?")
    dialect = address_of(f"{name}:talk:none?{options}").dialect
    if is_address(policy):
        return _gathering(policy, name, host, dialect.port if port is None else port, most, guard)
    policy_name(policy)
    desk = partial(Desk, dialect, policy, seed, task, tell)
    at = dialect.port if port is None else port
    try:
        if dialect.schemes[0] == "tcp":
            return ZeromqServer(desk, host, at, guard)
        return WebsocketServer(desk, host, at, asks_setting=not is_own(policy), guard=guard)
    except OSError as error:
        raise _unheard(host, port, error) from None


def _gathering(
    policy: str, protocol: str, host: str, port: int, most: int, guard: Guard | None
) -> GatheringServer:
    behind = address_of(policy)
    if not behind.dialect.batches or behind.dialect.protocol != protocol:
        raise InputError(
            f"policy {policy!r}", "is served already.",
            fix="name it in record --policy; only requests of groot can be gathered, by groot",
        )  # fmt: skip
    try:
        return GatheringServer(behind, most, host, port, guard)
    except OSError as error:
        raise _unheard(host, port, error) from None


def _unheard(host: str, port: int | None, error: OSError) -> InputError:
    return InputError(f"{host}, port {port}", f"cannot be listened on: {error}")
