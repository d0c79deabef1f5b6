"""``python -m safestage_record recover PLACE``: traces of what processes left unfinished."""

from __future__ import annotations

import argparse
import sys
from typing import Sequence

from .record_error import RecordError
from .rollout_log import recover


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line, and return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m safestage_record")
    commands = parser.add_subparsers(dest="command", required=True)
    command = commands.add_parser(
        "recover", help="make traces of recordings whose process died before their end"
    )
    command.add_argument("place", nargs="+", help="NAME.zip.unfinished, or a folder of them")
    given = parser.parse_args(arguments)
    try:
        traces = [trace for place in given.place for trace in recover(place)]
    except RecordError as error:
        print(error, file=sys.stderr)
        return 1
    for trace in traces:
        print(f"{trace}: what was recorded before the process died; termination is truncated")
    if not traces:
        print("nothing unfinished")
    return 0


if __name__ == "__main__":
    sys.exit(main())
