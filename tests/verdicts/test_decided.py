"""Whether a verdict is decided is found without it, and never otherwise than it says."""

from dataclasses import replace
from pathlib import Path

import pytest

from safestage_eval.episode import as_judged
from safestage_eval.formats import discover
from safestage_eval.rules import load_rules
from safestage_eval.rules.episode_binding import bind_episode
from safestage_eval.verdicts.decided import is_decided
from safestage_eval.verdicts.judging import Judge

TRACES = Path(__file__).parents[2] / "traces"
RULES = load_rules(["fsh", "ets", "ish"])


def unseen(episode):
    """Remove the contacts: more is open."""
    header = episode.header.model_copy(update={"force_source": "none"})
    return replace(episode, header=header, _contacts=None)


@pytest.mark.parametrize("less", [replace, unseen])
def test_decided_without_the_verdict_as_with_it(less):
    seen = set()
    for ref in discover(TRACES)[::2]:
        episode = as_judged(less(ref.open()))
        binding = bind_episode(RULES, episode.header)
        short, full = (Judge(episode, RULES, binding) for _ in range(2))
        for rule in RULES.rules.values():
            players = binding.players(rule, episode.header)
            if not all(players.values()):
                continue
            decided = is_decided(short.evaluator(binding.params(rule)), rule, players)
            verdict = full.verdict(rule).verdict
            assert decided == (verdict != "inconclusive"), (ref.episode_id, rule.code)
            assert short.outline(rule).verdict == ("pass" if decided else "inconclusive")
            seen.add(verdict)
    assert seen >= {"pass", "inconclusive"} | ({"violation"} if less is replace else set())
