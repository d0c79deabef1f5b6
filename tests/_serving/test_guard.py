"""Strangers' names and pages are refused under whatever spelling; one message ends no loop."""

import re
from pathlib import Path

import pytest

from safestage_eval._serving.guard import Guard, isolated
from safestage_eval.errors import InputError

HERE = ("127.0.0.1", 8000)


@pytest.mark.parametrize("host", ["127.0.0.1:8000", "localhost:8000", "LOCALHOST:8000"])
def test_loopback_names_are_answered(host):
    assert Guard().refusal(HERE, [host]) is None


@pytest.mark.parametrize(
    "hosts",
    [
        [], ["evil.example"], ["evil.example:8000"], ["127.0.0.1"], ["127.0.0.1:8001"], [""],
        ["localhost:8000@evil.example"], ["localhost:8000", "evil.example"], ["127.0.0.1:8000 "],
        ["localhost.evil.example:8000"], ["127.0.0.1.evil.example:8000"], ["localhost:٨٠٠٠"],
        ["192.168.1.5:8000"], ["x" * 10**6],
    ],
)  # fmt: skip
def test_other_names_are_not(hosts):
    """Against DNS rebinding: a stranger's name that was pointed at this machine."""
    why = Guard().refusal(HERE, hosts)
    assert why
    assert len(why) < 200


def test_the_address_that_was_reached_is_answered_as_no_name_can_be_pointed_at_it():
    assert Guard().refusal(("192.168.1.5", 8000), ["192.168.1.5:8000"]) is None
    assert Guard().refusal(("::1", 8000), ["[::1]:8000"]) is None
    assert Guard().refusal(("192.168.1.5", 8000), ["gpu:8000"])


def test_names_are_added_with_any_port_or_one():
    guard = Guard(("gpu", "localhost:9000"))
    assert guard.refusal(HERE, ["gpu:8000"]) is guard.refusal(HERE, ["GPU.:31000"]) is None
    assert guard.refusal(HERE, ["localhost:9000"]) is None
    assert guard.refusal(HERE, ["localhost:9001"])
    assert guard.refusal(HERE, ["gpu.evil.example:8000"])
    with pytest.raises(InputError, match="leave out http"):
        Guard(("http://gpu",))


@pytest.mark.parametrize(
    "origins",
    [
        ["http://evil.example"], ["null"], [""], ["file://"], ["http://localhost"],
        ["http://localhost:3000"], ["http://[", "x"], ["http://["], ["ftp://localhost:8000"],
        ["http://localhost:8000", "http://evil.example"],
    ],
)  # fmt: skip
def test_pages_from_elsewhere_are_refused(origins):
    assert Guard().refusal(HERE, ["localhost:8000"], origins)


def test_own_pages_and_those_of_added_names_may_ask():
    for origin in ("http://localhost:8000", "http://127.0.0.1:8000", "https://gpu"):
        assert Guard(("gpu",)).refusal(HERE, ["localhost:8000"], [origin]) is None


def test_what_a_browser_says_of_another_page_counts_where_it_sends_no_origin():
    refusal = Guard().refusal
    assert refusal(HERE, ["localhost:8000"], [], "cross-site", "no-cors")
    assert refusal(HERE, ["localhost:8000"], [], "same-site", "cors")
    assert refusal(HERE, ["localhost:8000"], [], "cross-site", "navigate") is None
    assert refusal(HERE, ["localhost:8000"], [], "same-origin", "cors") is None


def test_places_are_counted_and_given_back():
    guard = Guard(callers=1)
    with guard.place() as first:
        assert first
        with guard.place() as second:
            assert not second
        with guard.place() as third:
            assert not third
    with guard.place() as again:
        assert again


def test_whatever_listens_has_a_guard():
    listens = re.compile(
        r"http\.server|socketserver|websockets\.\w+\.server import serve|zmq\.(ROUTER|REP|PULL)\b|start_server\("
    )
    checkout = Path(__file__).resolve().parents[2]
    found = [
        path
        for package in ("safestage_eval", "simulate", "recorder/safestage_record")
        for path in (checkout / package).rglob("*.py")
        if listens.search(path.read_text("utf-8"))
    ]
    assert {path.name for path in found} >= {"guarded_http.py", "websocket.py", "zeromq.py"}
    assert all("guard import Guard" in path.read_text("utf-8") for path in found)


def test_one_message_ends_nothing():
    def deep():
        return deep()

    assert isolated(lambda: 1, lambda _: 2) == 1
    assert isolated(deep, lambda error: type(error).__name__) == "RecursionError"
    with pytest.raises(KeyboardInterrupt):
        isolated(lambda: (_ for _ in ()).throw(KeyboardInterrupt), str)
