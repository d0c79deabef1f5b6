"""A run as files: one page that carries everything, or a folder that is loaded piece by piece."""

from __future__ import annotations

import shutil
from pathlib import Path

from safestage_eval.errors import InputError

from .browser_page import SCRIPTS, browser_page, run_data
from .campaign.episode_pieces import write_piece
from .campaign.overview import Report, overview
from .campaign.run_list import of_outcomes, of_results
from .html_page import LIBRARIES, part
from .packed import packed

DATA, FILMS, LIBRARY = "data", "films", "lib"
"""Folders of a report."""


def report_list(report: Report, films: dict[str, str] | None = None) -> str:
    """The list of a report's episodes as JSON; ``films``: piece → address of a camera film."""
    names = report.pieces.names if report.pieces is not None else {}
    tables = of_results(report.rows, names) if report.rows else of_outcomes(report.outcomes)
    return run_data(report.title, tables, films=films or {}, traces=report.pieces is not None)


def report_page(report: Report) -> str:
    """One page that carries everything but camera films. The same report gives the same bytes."""
    carried = dict(report.pieces.packed) if report.pieces is not None else {}
    carried["run"] = packed(report_list(report))
    return browser_page(report.title, _results(report), "file", carried)


def prepared(folder: Path) -> Path:
    """Make the folder of a report; returns where its pieces go.

    Raises InputError for a folder with other things in it.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(str(folder), "is a file.", "a new folder, or NAME.html for one file")
    if folder.exists() and any(folder.iterdir()) and not (folder / DATA / "run.js").exists():
        raise InputError(str(folder), "has other files in it.", fix="name a new folder")
    shutil.rmtree(folder / DATA, ignore_errors=True)
    shutil.rmtree(folder / FILMS, ignore_errors=True)
    (folder / DATA).mkdir(parents=True)
    return folder / DATA


def write_folder(report: Report, folder: Path) -> Path:
    """Write a report whose pieces are in its folder already; returns the page."""
    films: dict[str, str] = {}
    for name, film in (report.pieces.films if report.pieces is not None else {}).items():
        (folder / FILMS).mkdir(exist_ok=True)
        films[name] = f"{FILMS}/{name}{film.suffix.lower()}"
        shutil.copyfile(film, folder / films[name])
    write_piece(folder / DATA, "run", packed(report_list(report, films)))
    (folder / LIBRARY).mkdir(exist_ok=True)
    for name in SCRIPTS:
        (folder / LIBRARY / name).write_text(part(name, LIBRARIES), "utf-8")
    page = folder / "index.html"
    page.write_text(browser_page(report.title, _results(report), "folder"), "utf-8")
    return page


def _results(report: Report) -> list[str]:
    """The results; of a single rollout there are none."""
    return overview(report) if len(report.counts.outcomes) > 1 else []
