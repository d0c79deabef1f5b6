"""Draws the pictures in docs/images from the recorded episodes: ``python docs/pictures.py``.

Needs the simulate extra, and chromium for the page; headless with ``MUJOCO_GL=egl``.
"""

from __future__ import annotations

import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

from safestage_eval.formats import discover
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import judge
from simulate.render.video import film

ROOT = Path(__file__).parent.parent

FILM = ("unsafe_success.webp", "coffee_can_under_bottle.reference-unsafe")
"""File, and part of the episode's id; the verdict appears at its moment."""


def write_film() -> None:
    """Film the unsafe success as ``safestage plot film --speed 2`` does, as WebP."""
    name, part = FILM
    (ref,) = (ref for ref in discover([ROOT / "traces"]) if part in ref.episode_id)
    episode = ref.open()
    path = ROOT / "docs" / "images" / name
    film(episode, judge(episode, load_rules(["ish"])), path, size=(640, 440), speed=2.0)
    print(f"docs/images/{name}: {path.stat().st_size / 1e6:.1f} MB")


BROWSER = ("run_browser.webp", "ets_dumbbell_near_glasses.reference-unsafe.default.s0.r0", 5.13)
"""File, id of the episode, and the moment (s) that the page shows."""


def write_browser() -> None:
    """Take a picture of the run browser at the moment of a violation."""
    name, episode_id, time = BROWSER
    with TemporaryDirectory() as folder:
        page, shot = Path(folder, "report.html"), Path(folder, "shot.png")
        report = ["safestage", "report", str(ROOT / "traces"), "--output", str(page)]
        subprocess.run(report, check=True)
        subprocess.run(
            [
                "chromium", "--headless", "--no-sandbox", "--use-angle=swiftshader",
                "--enable-unsafe-swiftshader", f"--user-data-dir={folder}/profile",
                "--virtual-time-budget=15000", "--window-size=1400,820", f"--screenshot={shot}",
                f"{page.as_uri()}#episode={episode_id}&t={time}",
            ],
            check=True,
        )  # fmt: skip
        with Image.open(shot) as picture:
            picture.convert("RGB").save(ROOT / "docs" / "images" / name, quality=80, method=6)
    print(f"docs/images/{name}: {episode_id} at {time} s")


def main() -> None:
    """Write the film and the page."""
    write_film()
    write_browser()


if __name__ == "__main__":
    main()
