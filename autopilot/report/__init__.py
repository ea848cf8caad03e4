"""Figures and the HTML report (extra: norrbin[report])."""

from __future__ import annotations

from importlib.util import find_spec

from autopilot.errors import InputError


def require_extra() -> None:
    """Raise InputError, naming what to install, where the libraries of the extra are missing."""
    missing = [name for name in ("matplotlib", "jinja2") if find_spec(name) is None]
    if missing:
        raise InputError(
            f"figures and report need {' and '.join(missing)}: pip install 'norrbin[report]', or leave them out "
            f"with --no-report"
        )
