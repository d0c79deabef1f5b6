"""The server tells a browser on this machine what it needs, and nothing else to nobody else."""

import gzip
import json

import pytest
from sitting import SECRETS, ask, record, rules, served, session

from safestage_eval.formats import discover
from safestage_eval.run.score_traces import score_paths


@pytest.fixture(scope="module")
def traces(tmp_path_factory):
    return record(tmp_path_factory.mktemp("traces"))


@pytest.fixture
def server(traces, tmp_path):
    with served(session(traces, tmp_path / "labels.csv")) as found:
        yield found


def everything(server, reviewer="ada"):
    """All bytes, header and body, of a whole sitting."""
    answer = [ask(server, "/"), ask(server, f"/state?reviewer={reviewer}")]
    for i in range(len(server.session.refs)):
        answer += [ask(server, f"/rollout/{i}{what}") for what in ("", "/film", "/video")]
    for i in range(len(server.session.refs)):
        answer.append(ask(server, "/answer", {"rollout": i, "label": "safe", "reviewer": reviewer}))
    answer.append(ask(server, "/state?reviewer=somebody"))
    bodies = []
    for _, headers, body in answer:
        bodies.append(gzip.decompress(body) if headers.get("Content-Encoding") else body)
        headers.pop("Date")
        bodies.append(json.dumps(headers).encode())
    return b"\n".join(bodies)


def test_nothing_of_the_verdict_nor_of_the_policy_is_shown(traces, server, monkeypatch, tmp_path):
    scores = score_paths([traces], [rules(tmp_path)])
    rows = [row for result in scores.results for row in result.rows() if row["assigned"]]
    assert {row["verdict"] for row in rows} == {"pass", "violation"}

    def judged(*_, **__):
        raise AssertionError("the page must not judge")

    monkeypatch.setattr("safestage_eval.verdicts.judge", judged)
    monkeypatch.setattr("safestage_eval.verdicts.judging.judge", judged)
    answer = everything(server)
    for row in rows:
        for name in ("explanation", "rule_digest", "trace_hash", "episode_id", "path", "policy"):
            assert str(row[name]).encode() not in answer, name
    for secret in (*SECRETS, "SECRET-FILE"):
        assert secret.encode() not in answer


def test_what_is_shown_is_the_same_whatever_the_results_say(traces, tmp_path):
    from safestage_eval.cli.label_command import _episodes

    answer = []
    for verdict in ("pass", "violation"):
        results = tmp_path / f"{verdict}.jsonl"
        ids = [ref.episode_id for ref in discover(traces)][:2]
        rows = [
            {"episode_id": name, "verdict": verdict, "violation": verdict != "pass"} for name in ids
        ]
        results.write_text("\n".join(map(json.dumps, rows)))
        refs = _episodes([str(traces)], (), [results])
        assert [ref.episode_id for ref in refs] == ids
        found = session(traces, tmp_path / f"{verdict}.csv")
        found.refs = refs
        with served(found) as server:
            answer.append(everything(server))
    assert answer[0] == answer[1]


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1", "[::1]:{port}"]
)
def test_a_foreign_name_is_refused(server, host):
    """Against DNS rebinding: a stranger's page whose name was pointed at this machine."""
    host = host.format(port=server.server_port)
    answer = {"rollout": 0, "label": "safe", "reviewer": "eve"}
    for path, body in (
        ("/", None),
        ("/state?reviewer=ada", None),
        ("/rollout/0", None),
        ("/answer", answer),
    ):
        status, _, answers = ask(server, path, body, Host=host)
        assert status == 403
        assert b"Slide" not in answers
    assert not server.session.ledger.path.exists()


def test_a_foreign_page_cannot_answer(server):
    answer = {"rollout": 0, "label": "safe", "reviewer": "eve"}
    assert ask(server, "/answer", answer, Origin="http://evil.example")[0] == 403
    assert ask(server, "/answer", answer, Origin="null")[0] == 403
    plain = {"Content-Type": "text/plain"}  # what a form may send without asking first
    assert ask(server, "/answer", answer, **plain)[0] == 415
    assert not server.session.ledger.path.exists()
    own = f"http://localhost:{server.server_port}"
    assert ask(server, "/answer", answer, Origin=own, Host=own[7:])[0] == 200


@pytest.mark.parametrize(
    ("body", "status"),
    [
        ({"rollout": 99, "label": "safe", "reviewer": "a"}, 404),
        ({"rollout": -1, "label": "safe", "reviewer": "a"}, 404),
        ({"rollout": True, "label": "safe", "reviewer": "a"}, 404),
        ({"rollout": 0, "label": "fine", "reviewer": "a"}, 422),
        ({"rollout": 0, "label": "safe", "reviewer": " "}, 422),
        ({"rollout": 0, "label": "safe", "reviewer": "a\x1bb"}, 422),
        ({"rollout": 0, "label": "safe", "reviewer": "a", "note": "\0"}, 400),
        (b'{"rollout": 0, "label": "safe", "reviewer": "a", "note": "\\ud800"}', 400),
        ({"rollout": 0, "label": "safe", "reviewer": "a", "note": "x" * 5000}, 422),
        ([], 400),
        (b"{", 400),
        (b"x" * 70000, 413),
    ],
)  # fmt: skip
def test_what_is_no_answer_is_refused_and_kept_nowhere(server, body, status):
    found, _, answer = ask(server, "/answer", body)
    assert found == status
    assert json.loads(answer)["error"]
    assert not server.session.ledger.path.exists()


def test_reviewers_see_their_own_answers_alone(server):
    for who, label in (("ada", "safe"), ("bob", "unsafe")):
        ask(server, "/answer", {"rollout": 1, "label": label, "reviewer": f" {who} ", "note": who})
    answer = json.loads(ask(server, "/state?reviewer=bob")[2])["answers"]
    assert answer == [None, {"label": "unsafe", "note": "bob"}, None]
    assert json.loads(ask(server, "/state?reviewer=eve")[2])["answers"] == [None] * 3


def test_an_answer_that_cannot_be_written_is_an_error(server, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    status, _, answer = ask(server, "/answer", {"rollout": 0, "label": "safe", "reviewer": "ada"})
    assert status == 500
    assert "No space left" in json.loads(answer)["error"]
