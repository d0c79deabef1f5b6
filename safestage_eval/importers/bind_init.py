"""A bind file of guesses for episodes whose headers say too little."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from safestage_eval._text.plural import count as plural
from safestage_eval._text.printable import printable
from safestage_eval.episode import Episode
from safestage_eval.errors import TraceError
from safestage_eval.formats import EpisodeRef

from .guess_roles import guess_bodies, guess_roles, stated_roles
from .toml_lines import guess_line, toml_key, toml_value

MOST = 10
"""Episodes of a task that are looked at."""

COLUMN = 30
"""Characters of a line before its comment."""


def bind_init(refs: Iterable[EpisodeRef], name: str = "TRACES") -> str:
    """The text of a bind file that names what the headers of some episodes leave open.

    Every guess stands on a line of its own, with its confidence and its reason. Episodes of one task
    share their roles; those without a task are guessed one by one, up to ``MOST``, or together under
    ``[every]`` where they have the same bodies.

    Args:
        refs: the episodes; those that cannot be read are left out.
        name: of the traces, for the comment.

    Raises:
        TraceError: none of them can be read.
    """
    tasks: dict[str | None, list[Episode]] = {}
    counts: dict[str | None, int] = {}
    failure: TraceError | None = None
    for ref in refs:
        task = ref.fields.get("task")
        counts[task] = counts.get(task, 0) + 1
        if counts[task] > MOST:
            continue
        try:
            tasks.setdefault(task, []).append(ref.open())
        except TraceError as error:
            failure = failure or error
    if not tasks and failure is not None:
        raise failure
    lines = [
        f"# Guesses for {plural(sum(counts.values()), 'episode')} of {printable(name)}. Correct them, then:",
        f"#   safestage score {printable(name)} --bind THIS_FILE",
        "# Each line ends with how sure the guess is, and why. Delete what is wrong: a role without",
        "# bodies leaves its rules unjudged, and an empty list says that no body plays it.",
        '# Without a line rules = ["FSH101", …] every rule judges that has a body for each role.',
    ]
    for task, episodes in tasks.items():
        lines += _task(task, episodes, counts[task])
    lines += _bodies([episode for some in tasks.values() for episode in some])
    return "\n".join(lines) + "\n"


def _task(task: str | None, episodes: Sequence[Episode], count: int) -> Iterator[str]:
    if task is not None:
        yield from _roles(f"task.{toml_key(task)}", episodes, plural(count, "episode"))
        return
    scenes = {tuple(body.name for body in episode.header.bodies) for episode in episodes}
    if len(scenes) == 1:
        yield from _roles("every", episodes, plural(count, "episode") + " without a task")
        return
    for episode in episodes:
        yield from _roles(f"episode.{toml_key(episode.header.episode_id)}", [episode], "no task")


def _roles(table: str, episodes: Sequence[Episode], comment: str) -> Iterator[str]:
    stated = stated_roles(episodes)
    rules = sorted({rule for episode in episodes for rule in episode.header.rules})
    guesses = guess_roles(episodes)
    yield ""
    yield f"[{table}.roles]  # {comment}" if guesses else f"# [{table}.roles]  # {comment}"
    for role, players in stated.items():
        yield f"# {toml_key(role)} = {toml_value([*players])}  # in the headers"
    for role, guess in guesses.items():
        yield guess_line(toml_key(role), guess, COLUMN)
    if not guesses:
        yield "# nothing to guess" if stated else '# target = "…"  # no guess: nothing moved'
    if rules:
        yield f"# rules in the headers: {printable(', '.join(rules))}"


def _bodies(episodes: Sequence[Episode]) -> Iterator[str]:
    for name, guesses in guess_bodies(episodes).items():
        yield ""
        yield f"[body.{toml_key(name)}]"
        for key, guess in guesses.items():
            yield guess_line(toml_key(key), guess, COLUMN)
