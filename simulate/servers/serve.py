"""Serve one of this package's policies, or a user's own, in any of the protocols."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from safestage_eval._serving.guard import Guard
from safestage_eval.errors import InputError
from simulate.clients.address import dialect_of, is_address
from simulate.policies.policy_names import policy_name

from .served_answers import Desk
from .served_episode import is_own
from .websocket import WebsocketServer
from .zeromq import ZeromqServer


def serve(
    policy: str,
    protocol: str,
    *,
    host: str = "127.0.0.1",
    port: int | None = None,
    seed: int = 0,
    task: str | None = None,
    guard: Guard | None = None,
    tell: Callable[[str], None] = lambda _line: None,
) -> WebsocketServer | ZeromqServer:
    """A server that is answering already.

    Args:
        policy: as ``--policy`` takes it, but none that is served already.
        protocol: its name, and what a client's address sets of it: ``openpi?actions=velocity``.
        host: to listen on.
        port: to listen on; the protocol's own where None, any free one for 0.
        seed: the environment seed that clients roll out.
        task: the task that they roll out; found by its prompt where None.
        guard: whom it answers, and how much it takes.
        tell: hears of every episode that begins.

    Raises InputError for what cannot be served, or not there.
    """
    dialect = dialect_of(protocol)
    if is_address(policy):
        raise InputError(
            f"policy {policy!r}", "is served already.", fix="name it in record --policy"
        )
    policy_name(policy)
    desk = partial(Desk, dialect, policy, seed, task, tell)
    at = dialect.port if port is None else port
    try:
        if dialect.schemes[0] == "tcp":
            return ZeromqServer(desk, host, at, guard)
        return WebsocketServer(desk, host, at, asks_setting=not is_own(policy), guard=guard)
    except OSError as error:
        raise InputError(f"{host}, port {port}", f"cannot be listened on: {error}") from None
