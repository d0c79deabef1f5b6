"""The server of a run: what it hands out, and to whom."""

import http.client
import json
import threading
import zlib
from base64 import b64decode

import pytest
from studio import safe_and_unsafe

from safestage_eval.formats import discover
from safestage_eval.run.settings import load_settings
from safestage_eval.viewer.live_run import LiveRun
from safestage_eval.viewer.run_server import RunServer


@pytest.fixture(scope="module")
def traces(tmp_path_factory):
    return safe_and_unsafe(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def server(traces):
    run = LiveRun("a run", discover(traces), load_settings(["fsh"]))
    run.judge_all()
    server = RunServer(run)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield server
    server.shutdown()
    server.server_close()


def ask(server, path, method="GET", **headers):
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=30)
    connection.request(method, path, headers=headers)
    response = connection.getresponse()
    answer = response.status, dict(response.getheaders()), response.read()
    connection.close()
    return answer


def content(script):
    return zlib.decompress(b64decode(script.decode().split('"')[3]))


def test_the_list_says_what_was_judged(server):
    status, headers, script = ask(server, "/data/run.js")
    assert status == 200 and headers["Content-Type"].startswith("text/javascript")
    data = json.loads(content(script))
    assert data["episodes"]["id"] == ["safe", "unsafe"]
    assert data["episodes"]["verdict"] == ["pass", "violation"]
    assert data["state"] == {"left": 0, "problems": None}


def test_the_evidence_of_an_episode_is_made_when_it_is_asked_for(server):
    data = content(ask(server, "/data/e1.js")[2])
    head = json.loads(data[4 : 4 + int.from_bytes(data[:4], "little")])
    assert head["id"] == "unsafe"
    assert head["findings"][0]["verdict"] == "violation"


def test_the_page_has_the_results_once_all_is_judged(server, traces):
    assert b'id="headline"' in ask(server, "/")[2]
    waiting = LiveRun("a run", discover(traces), load_settings(["fsh"]))
    assert waiting.left == 2
    assert b'id="headline"' not in waiting.page()


@pytest.mark.parametrize(
    "path",
    ["/data/e2.js", "/data/e99999999.js", "/data/mabc.js", "/data/../../etc/passwd", "/lib/README.md",
     "/films/0", "/films/9", "/index.html", "/data/run.json"],
)  # fmt: skip
def test_nothing_else_is_there(server, path):
    assert ask(server, path)[0] == 404


def test_only_its_own_page_may_ask(server):
    own = f"127.0.0.1:{server.server_port}"
    assert server.server_address[0] == "127.0.0.1"
    assert ask(server, "/data/run.js", Host="evil.example")[0] == 403
    assert ask(server, "/data/run.js", Origin="http://evil.example")[0] == 403
    asked = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors"}
    assert ask(server, "/data/run.js", **asked)[0] == 403  # a <script> on another page
    assert ask(server, "/data/run.js", Origin=f"http://{own}")[0] == 200
    headers = ask(server, "/data/run.js")[1]
    assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
    assert headers["Cache-Control"] == "no-store"
    assert "Access-Control-Allow-Origin" not in headers


def test_nothing_can_be_sent(server):
    assert ask(server, "/", "POST")[0] == 404


def test_a_broken_trace_is_reported_and_stops_no_other(traces, tmp_path):
    (tmp_path / "broken.mcap").write_bytes((traces / "safe.mcap").read_bytes()[:5000])
    run = LiveRun("a run", discover([tmp_path, traces]), load_settings(["fsh"]))
    run.judge_all()
    assert run.left == 0
    data = json.loads(content(run.piece("run")))
    assert "1 episodes cannot be judged" in data["state"]["problems"]
    assert [v for v in data["episodes"]["verdict"] if v] == ["pass", "violation"]
    broken = data["episodes"]["verdict"].index(None)
    head = content(run.piece(f"e{broken}"))
    assert "problem" in json.loads(head[4 : 4 + int.from_bytes(head[:4], "little")])
