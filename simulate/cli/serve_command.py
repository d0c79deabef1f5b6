"""``safestage bench serve``."""

from __future__ import annotations

from safestage_eval.cli.command_options import command, option
from safestage_eval.cli.shared_options import allow_host_option
from safestage_eval.cli.terminal import say

from .simulate_options import explains


@command("serve")
@explains
def serve(
    policy: str,
    protocol: str = option(
        "Protocol: openpi, groot, dreamzero or cosmos3, with options as in an address: "
        "openpi?actions=velocity.",
        required=True,
    ),
    host: str = option("Address to listen on.", default="127.0.0.1"),
    port: int | None = option("Port, instead of the protocol's own.", least=0, most=65535),
    seed: int = option("Environment seed that clients roll out.", default=0),
    task: str | None = option("Task to serve, where several tasks have the same prompt."),
    allow_host: tuple[str, ...] = allow_host_option,
    largest: str = option(
        "Hang up on a caller whose message is larger.",
        "--max-message",
        default="64 MB",
        metavar="SIZE",
    ),
) -> None:
    """Serve a policy in a model's protocol, to test a client, a campaign or a network.

    POLICY is reference:safe, reference:unsafe, learned:act, idle or another as in `record --policy`:
    these act in their own simulation with the client's task and seed, so that the client's rollout
    really succeeds. Your own my_module:MyPolicy receives the contents of each request.

    Answers requests under loopback names and under the address itself, not under names that were
    pointed at it, and no web pages. Ends with 0 on Ctrl+C, and with 2 if it cannot go on.

    \b
    Examples:
      safestage bench serve reference:safe --protocol openpi
      safestage bench record fsh_orange_on_plate --seeds 0 --policy openpi:ws://127.0.0.1:8000
      safestage bench serve my_module:MyPolicy --protocol "groot?horizon=16" --port 5556
    """
    from safestage_eval._serving.guard import Guard
    from safestage_eval.size_limits import size
    from simulate.servers.serve import serve as start

    with start(
        policy, protocol, host=host, port=port, seed=seed, task=task,
        guard=Guard(allow_host, size(largest)),
        tell=lambda line: say(f"episode: {line}", err=True),
    ) as server:  # fmt: skip
        name, mark, options = protocol.partition("?")
        say(f"{policy} is served at {name}:{server.url}{mark}{options}")
        try:
            server.wait()
        except KeyboardInterrupt:
            say("stopped", err=True)
