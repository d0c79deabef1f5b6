"""Makes docs/signals.md and its pictures from docs/signals.toml, the vocabulary and the evaluator.

    python docs/figures.py            the page and all pictures
    python docs/figures.py --page     the page alone
    python docs/figures.py tilt turn  these pictures

Left, the scene at two moments; right, the signal over the scene's time, as the evaluator measures
it. Pictures need the plot extra (matplotlib).
"""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from drawing import draw_scene, frame_of_interest

import safestage_eval
from safestage_eval.api import Episode
from safestage_eval.evidence.measure import Signals
from safestage_eval.formats import discover
from safestage_eval.palette import SERIES
from safestage_eval.relations.relations import Relations
from safestage_eval.relations.vocabulary import RELATIONS
from safestage_eval.rules import string_parser
from safestage_eval.signals import SIGNALS
from safestage_eval.sketch import read
from safestage_eval.units import in_unit, unit_of

ROOT = Path(__file__).parent.parent
TABLE = ROOT / "docs" / "signals.toml"
PAGE = ROOT / "docs" / "signals.md"
OUT = ROOT / "docs" / "images" / "signals"

STYLE = {
    "svg.hashsalt": "safestage",
    "svg.fonttype": "none",
    "font.size": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
}
LEAST_RANGE = 1e-3
"""A smaller range of a drawn value is rounding, and is drawn as a level line."""
LINE, MOMENT = SERIES[0].light, SERIES[1].light


@cache
def scene(name: str) -> Episode:
    """A scene of docs/scenes by name, or a recorded episode by a part of its id."""
    sketch = ROOT / "docs" / "scenes" / f"{name}.toml"
    if not sketch.is_file():
        (found,) = (r.episode_id for r in discover([ROOT / "traces"]) if name in r.episode_id)
        return safestage_eval.load(ROOT / "traces", found)
    drawn = read(sketch)
    return Episode(**{field.name: getattr(drawn, field.name) for field in fields(drawn)})


def draw(entry: dict[str, Any], target: Path) -> None:
    """One figure: ``entry`` is its table in figures.toml."""
    import matplotlib as mpl
    from matplotlib import pyplot as plt

    episode = scene(entry["scene"])
    times = entry["times"]
    with mpl.rc_context(STYLE):
        figure, panels = plt.subplots(
            1, len(times) + 1, figsize=(7.4, 2.1), layout="constrained",
            width_ratios=[1.0] * len(times) + [1.7],
        )  # fmt: skip
        frames = [int(np.abs(episode.t - time).argmin()) for time in times]
        view = entry.get("view", "xz")
        kinds = ("robot", "gripper") if view == "xy" else ()
        bodies = [b.name for b in episode.header.bodies if b.geoms and b.kind not in kinds]
        named = [name for name in string_parser.call(entry["signal"]).args if name in bodies]
        wanted = entry.get("around") or named
        window = frame_of_interest(episode, frames, wanted, view)
        for panel, frame in zip(panels, frames, strict=False):
            draw_scene(panel, episode, frame, bodies, view, window)
            panel.set_title(f"{episode.t[frame]:.1f} s", fontsize=8, color=MOMENT)
        plot_series(panels[-1], episode, entry, frames)
        figure.savefig(target, metadata={"Date": None})
        plt.close(figure)


def plot_series(
    axes: Any, episode: Episode, entry: Mapping[str, Any], frames: Sequence[int]
) -> None:
    """The signal over time with the shown moments marked; what is not known leaves a gap."""
    call = string_parser.call(entry["signal"])
    facts = Relations(Signals(episode))
    if call.name in RELATIONS:
        told, unit = facts.told(call.name, call.args), "true or false"
        values = np.where(told.lower < told.upper, np.nan, told.lower)
        axes.set_yticks([0, 1], ["false", "true"])
    else:
        given = {
            name: tuple(v) if isinstance(v, list) else v
            for name, v in entry.get("options", {}).items()
        }
        arguments, named = SIGNALS[call.name].split(call.args)
        options = tuple(sorted((dict(named) | given).items()))
        series = facts.signal(call.name, arguments, options=options)
        unit = unit_of(series.dimension) or "a number"
        known = series.known & np.isfinite(series.upper)
        values = np.where(known, series.upper, 0.0)
        values = np.array([in_unit(value, series.dimension) for value in values])
        values[~known] = np.nan
    axes.plot(episode.t, values, color=LINE, linewidth=1.3)
    for frame in frames:
        axes.axvline(episode.t[frame], color=MOMENT, linewidth=0.7, linestyle=":")
        axes.plot(episode.t[frame], values[frame], "o", color=MOMENT, markersize=3.5)
    low, high = (-0.15, 1.15) if call.name in RELATIONS else axes.get_ylim()
    if high - low < LEAST_RANGE:
        low, high = (low + high) / 2 - 0.5, (low + high) / 2 + 0.5
    axes.set_ylim(low, high)
    axes.set_xlim(episode.t[0], episode.t[-1])
    axes.set_ylabel(unit)
    axes.set_xlabel("time, s")
    axes.set_title(entry["signal"], fontsize=8, family="monospace", loc="left")


def page(table: dict[str, dict[str, Any]]) -> str:
    """The text of docs/signals.md."""
    lines = [*HEAD]
    group = None
    for name, entry in table.items():
        if entry["group"] != group:
            group = entry["group"]
            lines += [f"## {group}", ""]
        spec = SIGNALS.get(name) or RELATIONS[name]
        facts = [f"needs {', '.join(spec.needs)}"]
        if name in SIGNALS:
            unit = unit_of(SIGNALS[name].dimension)
            facts.insert(0, f"{SIGNALS[name].dimension}, shown in {unit}" if unit else "a number")
            facts += ["may be taken `since` an event"] if SIGNALS[name].since else []
            options = [f"`{option.name}`" for option in SIGNALS[name].options]
            facts += [f"variants may say {', '.join(options)}"] if options else []
            columns = [f"`{column}`" for column, _ in SIGNALS[name].columns]
            facts += [f"reads the material columns {', '.join(columns)}"] if columns else []
        if spec.groups:
            facts.append("`robot` and `gripper` may stand for a body")
        text = "; ".join(facts)
        lines += [
            f"### `{name}`", "", f"{spec.meaning} *{text[0].upper()}{text[1:]}.*", "",
            entry["text"], "", f"![{entry['signal']}](images/signals/{name}.svg)", "",
        ]  # fmt: skip
    return "\n".join(lines).rstrip() + "\n"


HEAD = (
    "# Every signal and relation, in a picture",
    "",
    "A signal is one number per frame, without a threshold; a relation is true or false. Each is shown on a scene: left",
    "at two moments, right over time, as the evaluator measures it. Dots mark the two moments; in a gap the value is",
    "unknown. [rules.md](rules.md) says how rules use them; `safestage rules signals` lists them in the terminal. This",
    "page is made by `docs/figures.py`.",
    "",
)


def main() -> None:
    """Draw all figures, or the named ones, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="SIGNAL")
    parser.add_argument("--page", action="store_true", help="write the page, draw nothing")
    args = parser.parse_args()
    table = tomllib.loads(TABLE.read_text("utf-8"))
    PAGE.write_text(page(table), "utf-8")
    OUT.mkdir(parents=True, exist_ok=True)
    for name, entry in table.items():
        if not args.page and (not args.names or name in args.names):
            draw(entry, OUT / f"{name}.svg")
            print(f"docs/images/signals/{name}.svg")


if __name__ == "__main__":
    main()
