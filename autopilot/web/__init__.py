"""The live helm page and what the terminal helm shares with it: one more MAVLink client of a running pilot."""

from __future__ import annotations

from importlib.resources import files

from autopilot.errors import InputError


def page_files() -> dict[str, bytes]:
    """Return the page and all it loads, by name."""
    folder = files("autopilot.web").joinpath("page")
    return {entry.name: entry.read_bytes() for entry in folder.iterdir() if entry.is_file()}


def require_extra() -> None:
    """Raise InputError with the sentence that names the extra, where the page's libraries are missing."""
    try:
        import starlette
        import uvicorn  # noqa: F401 - only whether it is there
    except ImportError as error:
        raise InputError(
            f"autopilot web needs the extra `web` ({error.name} is missing): install it with "
            "`pip install '.[web]'`, or use `autopilot helm` in a terminal"
        ) from None
    del starlette
