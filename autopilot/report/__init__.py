"""Figures and the HTML report (extra: norrbin[report])."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from autopilot.errors import InputError

NO_PAGES = (".pdf", ".png", ".svg", ".md", ".docx", ".txt", ".json", ".yaml", ".csv", ".tlog")


def require_extra(without: str = "with --no-report", page: str | Path = "") -> None:
    """Raise InputError, naming what to install and how to do `without`, where the libraries are missing; or where the
    name of the `page` promises another kind of file."""
    if (wanted := Path(page)).suffix.lower() in NO_PAGES:
        html = wanted.with_suffix(".html")
        raise InputError(f"--report {page}: a report is a page; write {html}, which a browser prints as PDF")
    missing = [name for name in ("matplotlib", "jinja2") if find_spec(name) is None]
    if missing:
        raise InputError(
            f"figures and report need {' and '.join(missing)}: pip install '.[report]', or leave them out {without}"
        )
