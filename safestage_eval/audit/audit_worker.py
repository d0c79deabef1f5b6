"""A process that audits what it is sent, one episode after the other."""

from __future__ import annotations

from multiprocessing.connection import Connection

from safestage_eval.run.settings import Settings
from safestage_eval.run.worker import serve

from .audit_episode import audit_episode
from .choose import choose


def work(pipe: Connection, settings: Settings, *, codes: tuple[str, ...], **_: object) -> None:
    """Audit lists of episodes until None comes; answers in the order of the questions.

    Args:
        pipe: to the process that started this one.
        settings: of the run: rules and bind file.
        codes: of the checks to be carried out.
    """
    checks, rules = choose(codes), settings.rule_set
    serve(pipe, lambda ref: audit_episode(ref, checks, rules, settings.bind))
