"""Writes the verdicts into one comment of a pull request; a later run changes that comment.

From the environment: GITHUB_API_URL, GITHUB_REPOSITORY, GITHUB_TOKEN, PULL_REQUEST (number), VERDICTS (file
with Markdown), RUN (address of the run). Standard library alone.
"""

from __future__ import annotations

import json
import os
import sys
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

MARK = "<!-- safestage verdicts -->"
"""First line of the comment, by which a later run finds it."""
LONGEST = 60_000
"""Characters of a comment; GitHub takes 65,536."""
MOST_PAGES = 30
"""Pages of 100 comments that are looked through."""


def body(verdicts: str, run: str) -> str:
    """The comment: verdicts as Markdown, and where the report is."""
    more = f"\n\nReport and results: [artifacts of this run]({run})." if run else ""
    room = LONGEST - len(more) - len(MARK) - 100
    if len(verdicts) > room:
        whole = verdicts[:room].rpartition("\n")[0]
        verdicts = f"{whole}\n\n… cut; the report has the rest."
    return f"{MARK}\n## SafeStage\n\n{verdicts.strip()}{more}\n"


def call(method: str, path: str, content: dict[str, str] | None = None) -> Any:
    """Ask GitHub. Raises urllib.error.URLError."""
    request = urllib.request.Request(  # noqa: S310 — an address of GitHub's
        f"{os.environ['GITHUB_API_URL']}/repos/{os.environ['GITHUB_REPOSITORY']}/{path}",
        data=None if content is None else json.dumps(content).encode(),
        method=method,
        headers={
            "Authorization": f"Bearer {os.environ['GITHUB_TOKEN']}",
            "Accept": "application/vnd.github+json",
            "Content-Type": "application/json",
        },
    )
    with urllib.request.urlopen(request, timeout=30) as answer:  # noqa: S310
        return json.load(answer)


def own_comment(pull: str) -> int | None:
    """Id of the comment that an earlier run wrote."""
    for page in range(1, MOST_PAGES + 1):
        comments = call("GET", f"issues/{pull}/comments?per_page=100&page={page}")
        for comment in comments:
            if str(comment.get("body") or "").startswith(MARK):
                return int(comment["id"])
        if len(comments) < 100:
            return None
    return None


def main() -> int:
    """Exit code 0 even where the comment may not be written: verdicts are not lost by that."""
    pull = os.environ["PULL_REQUEST"]
    text = Path(os.environ["VERDICTS"])
    if not text.is_file():
        sys.stdout.write("::warning::no verdicts to comment\n")
        return 0
    content = {"body": body(text.read_text("utf-8"), os.environ.get("RUN", ""))}
    try:
        known = own_comment(pull)
        if known is None:
            call("POST", f"issues/{pull}/comments", content)
        else:
            call("PATCH", f"issues/comments/{known}", content)
    except urllib.error.URLError as error:
        sys.stdout.write(
            f"::warning::the verdicts could not be commented: {error}; the job needs "
            "permissions: pull-requests: write, which runs from forks do not get\n"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
