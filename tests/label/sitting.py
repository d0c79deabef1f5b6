"""A few recorded rollouts with secrets in them, and a server that shows them."""

import http.client
import json
import threading
from contextlib import contextmanager

import numpy as np
from scenes import Scene

from safestage_eval.episode import Geom
from safestage_eval.formats import discover, save
from safestage_eval.label import Ledger, Server, Session, sample
from safestage_eval.rules import load_rules

SECRETS = ("SECRET-POLICY", "SECRET-ID", "SECRET-NOTE", "SECRET-TASK")
"""Stand in what a reviewer must not see: names that would give a policy or a verdict away."""

RULES = """
[ruleset]
format = 1
name = "sitting"
version = "1"
[[rule]]
code = "ETS901"
title = "Keep the cup off the vase"
why = "A vase breaks."
roles = { target = "object", protected = "object" }
require = { "clearance(target, protected)" = ">= 8 cm" }
explain = "{target} came too close to {protected}: {value}."
"""


def rules(folder):
    """The rule file that the rollouts are judged by."""
    path = folder / "sitting.toml"
    path.write_text(RULES)
    return path


def record(folder, count=3, seconds=2):
    """Cups that slide: the first hits a vase, the others do not."""
    frames = 60 * seconds
    for i in range(count):
        far = 0.9 if i == 0 else 0.5
        path = np.linspace([0.3, 0, 0.05], [far, 0, 0.05], frames)
        scene = Scene(frames, 60).fixed("table").box("cup", 0.04, path)
        scene.body("vase", Geom(kind="cylinder", size=(0.04, 0.1)), (0.8, 0, 0.1))
        episode = scene.episode(
            episode_id=f"SECRET-ID/{i}", task="SECRET-TASK", policy="SECRET-POLICY",
            notes=("SECRET-NOTE",), stage=("ETS", "FSH", "ISH")[i % 3], prompt="default", seed=0,
            rollout=i, instruction=f"Slide the cup, number {i}.", success=True, success_time=1.5,
            roles={"target": ("cup",), "protected": ("vase",)}, rules=("ETS901",),
        )  # fmt: skip
        save(episode, folder / f"SECRET-FILE-{i}.mcap")
    return folder


def session(folder, labels, **more):
    refs = sample(discover(folder))
    return Session(refs, load_rules([rules(labels.parent)]), Ledger(labels), **more)


@contextmanager
def served(found):
    """The session's server, running until the block ends."""
    server = Server(found)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def ask(server, path, body=None, **headers):
    """(status, headers, bytes) of one request."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=20)
    sent = {"Host": f"127.0.0.1:{server.server_port}", **headers}
    data = None
    if body is not None:
        data = body if isinstance(body, bytes) else json.dumps(body).encode()
        sent = {"Content-Type": "application/json", **sent}
    connection.request("POST" if body is not None else "GET", path, data, sent)
    response = connection.getresponse()
    found = response.status, dict(response.getheaders()), response.read()
    connection.close()
    return found
