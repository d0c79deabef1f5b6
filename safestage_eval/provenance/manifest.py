"""A manifest of an evaluation: an in-toto Statement with a predicate in the manner of SLSA's.

It names what judged (evaluator, its code, rules), how (settings) and what was judged (the digest of each
episode's content and header, computed from what was read). The same evaluation gives the same bytes
wherever and whenever it is run: there are no times and no machines in it.
https://github.com/in-toto/attestation/blob/main/spec/v1/statement.md
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

from safestage_eval._text.json_text import from_json
from safestage_eval.episode import Episode
from safestage_eval.errors import InputError
from safestage_eval.evidence.trace_identity import code_version
from safestage_eval.formats import EpisodeRef
from safestage_eval.formats.digests import computed
from safestage_eval.rules import RuleSet
from safestage_eval.rules.files import find
from safestage_eval.version import __version__

STATEMENT = "https://in-toto.io/Statement/v1"
PREDICATE = "urn:safestage:evaluation:v1"
ENDING = ".intoto.json"
"""File name of a manifest beside its results."""


def trace_digests(episode: Episode) -> dict[str, str]:
    """SHA-256 (hex) of the content, over all columns, and of the header with roles, goal and success.

    Raises TraceError for the first invariant that the episode breaks.
    """
    header = json.dumps(episode.header.model_dump(mode="json"), sort_keys=True)
    return {"content": computed(episode), "header": sha256(header.encode()).hexdigest()}


def opened(ref: EpisodeRef) -> dict[str, str]:
    """Digests of a stored episode, which is read whole. Raises TraceError."""
    return trace_digests(ref.open(checked=False))


def manifest(
    subject: Mapping[str, str],
    rules: RuleSet,
    settings: Mapping[str, Any],
    refs: Iterable[EpisodeRef],
    problems: Sequence[str] = (),
) -> dict[str, Any]:
    """The statement.

    Args:
        subject: name of each result file → its SHA-256.
        rules: that judged.
        settings: how, as JSON values: ``rules`` and ``bind`` name files, whose digests are added.
        refs: the episodes that were judged.
        problems: paths of those that could not be.

    Raises:
        TraceError: an episode cannot be read any more.
    """
    named = [path for spec in settings["rules"] for path in find(spec)]
    named += [Path(settings["bind"])] if settings.get("bind") else []
    episodes = [{"id": ref.episode_id, "digest": opened(ref)} for ref in refs]
    return {
        "_type": STATEMENT,
        "subject": [
            {"name": name, "digest": {"sha256": digest}} for name, digest in sorted(subject.items())
        ],
        "predicateType": PREDICATE,
        "predicate": {
            "evaluator": {"name": "safestage", "version": __version__, "code": code_version()},
            "rules": {
                "digest": rules.digest,
                "files": [{"name": path.name, "digest": {"sha256": digest_of(path)}} for path in named if path.is_file()],
            },
            "settings": dict(settings),
            "episodes": sorted(episodes, key=lambda episode: str(episode["id"])),
            "notJudged": sorted(problems),
        },
    }  # fmt: skip


def as_bytes(statement: Mapping[str, Any]) -> bytes:
    """The bytes that are signed: keys in order, one line for each part, ASCII."""
    return (json.dumps(statement, sort_keys=True, indent=1, allow_nan=False) + "\n").encode()


def read_manifest(path: Path) -> dict[str, Any]:
    """A manifest as it was written. Raises InputError for anything else."""
    try:
        statement = from_json(path.read_bytes())
        predicate = statement["predicate"]
        whole = all(
            isinstance(part, kind)
            for part, kind in (
                (statement["subject"], list),
                (predicate["evaluator"], dict),
                (predicate["rules"], dict),
                (predicate["settings"], dict),
                (predicate["episodes"], list),
            )
        )
        kinds = statement["_type"], statement["predicateType"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(str(path), f"no manifest: {type(error).__name__}: {error}.") from None
    if not whole or kinds != (STATEMENT, PREDICATE):
        raise InputError(
            str(path), "not the manifest of an evaluation.", f"a statement of {PREDICATE}"
        )
    manifest: dict[str, Any] = statement
    return manifest


def digest_of(path: Path) -> str:
    """SHA-256 (hex) of a file."""
    return sha256(path.read_bytes()).hexdigest()
