"""Figures and the HTML report (extra: norrbin[report])."""

from __future__ import annotations

from importlib.util import find_spec

from autopilot.errors import InputError


def require_extra(without: str = "with --no-report") -> None:
    """Raise InputError, naming what to install and how to do `without`, where the libraries are missing."""
    missing = [name for name in ("matplotlib", "jinja2") if find_spec(name) is None]
    if missing:
        raise InputError(
            f"figures and report need {' and '.join(missing)}: pip install '.[report]', or leave them out {without}"
        )
