"""Records how the published package openpi-client talks, for test_published_client.py.

Run in an environment of its own, as the package wants numpy below 2:

    python -m venv /tmp/openpi && /tmp/openpi/bin/pip install openpi-client typing_extensions msgpack-numpy zstandard
    /tmp/openpi/bin/python tests/simulate/clients/record_openpi_client.py

Writes ``openpi_client.talk`` beside this file: what the package's client sent and was sent over a
real websocket, and messages that the package and msgpack-numpy wrote of the same arrays.
"""

from __future__ import annotations

import threading
from pathlib import Path

import msgpack
import msgpack_numpy
import numpy as np
import zstandard
from openpi_client import image_tools, websocket_client_policy
from openpi_client import msgpack_numpy as openpi_numpy
from websockets.sync.server import serve


def picture(seed, height=360, width=640):
    """See served.py."""
    y, x = np.mgrid[:height, :width]
    parts = [(x // 3 + seed) % 256, (y // 2 + 2 * seed) % 256, (x + y) // 8 % 256]
    return np.stack(parts, -1).astype(np.uint8)


def actions():
    """(15, 8), as in test_published_client.py."""
    return (np.arange(120).reshape(15, 8) / 64).astype(np.float32)


ARRAYS = {
    "bytes": np.arange(6, dtype=np.uint8).reshape(1, 2, 3),
    "floats": np.linspace(0, 1, 7, dtype=np.float32),
    "doubles": np.array(2.5),
    "flags": np.array([True, False]),
    "scalar": np.float32(0.25),
}

said = []


def handler(connection):
    """A server: greets, notes what comes, answers."""
    greeting = openpi_numpy.packb({"model": "recorded"})
    said.append(("greeting", greeting))
    connection.send(greeting)
    for message in connection:
        answer = openpi_numpy.packb({"actions": actions(), "server_timing": {"infer_ms": 1.5}})
        said.extend([("asked", message), ("answered", answer)])
        connection.send(answer)


server = serve(handler, "127.0.0.1", 0, compression=None, max_size=None)
threading.Thread(target=server.serve_forever, daemon=True).start()
port = server.socket.getsockname()[1]
client = websocket_client_policy.WebsocketClientPolicy("127.0.0.1", port)
found = client.infer(
    {
        "observation/exterior_image_1_left": image_tools.resize_with_pad(picture(0), 224, 224),
        "observation/wrist_image_left": image_tools.resize_with_pad(picture(60), 224, 224),
        "observation/joint_position": (
            np.array([0, -0.2, 0, -0.8, 0, 0.6, 0]) * np.pi + 0.25
        ).astype(np.float32),
        "observation/gripper_position": np.array([0.25], np.float32),
        "prompt": "Put the orange on the plate.",
    }
)
assert np.array_equal(found["actions"], actions())
said.append(("openpi", openpi_numpy.packb(ARRAYS)))
said.append(("nd", msgpack.packb(ARRAYS, default=msgpack_numpy.encode)))
path = Path(__file__).with_name("openpi_client.talk")
data = b"".join(msgpack.packb(each) for each in said)
path.write_bytes(zstandard.ZstdCompressor(level=19).compress(data))
