"""The journal of an upload: what it changes, on disk before the first parameter is set, gone when all is well.

It outlives a kill or a power cut, so that `restore` knows what the vehicle held and what it was to hold.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from autopilot.errors import InputError
from autopilot.params.firmware_owned import Kept, Marks, kept_by_firmware
from autopilot.params.outcome import Change
from autopilot.params.saving import save_text, sync_folder
from autopilot.params.session import Vehicle
from autopilot.params.value_coding import Number
from autopilot.regular_file import read_regular

FORMAT = 1
LONGEST = 16 << 20
"""Bytes; every parameter that a vehicle has fills 300 kB."""


@dataclass(frozen=True)
class Journal:
    """An upload under way: of which file, to which vehicle (`uid` of its board where it tells), and each change."""

    file: str
    date: str
    system: int
    firmware: str
    uid: str
    backup: str
    changes: tuple[Change, ...]


def state_folder() -> Path:
    """Return the folder of journals: NORRBIN_STATE, else norrbin/ in XDG_STATE_HOME or ~/.local/state."""
    if chosen := os.environ.get("NORRBIN_STATE"):
        return Path(chosen)
    base = os.environ.get("XDG_STATE_HOME")
    return (Path(base) if base else Path.home() / ".local" / "state") / "norrbin"


def journal_path(vehicle: Vehicle) -> Path:
    """Return where the journal of an upload to `vehicle` is."""
    return state_folder() / f"upload-{vehicle.system}-{vehicle.component}.json"


def write_journal(path: Path, journal: Journal) -> None:
    """Put the journal on disk, whole or not at all; raises InputError where that is impossible."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{path.parent}: cannot be made ({error.strerror}); the old values are kept there, so that an upload can "
            "be undone after a power cut. Name another folder in the environment variable NORRBIN_STATE."
        ) from None
    document = {"format": FORMAT, **asdict(journal), "changes": [change._asdict() for change in journal.changes]}
    save_text(path, json.dumps(document, indent=1))


def read_journal(path: Path) -> Journal | None:
    """Return the journal at `path`, None where there is none; raises InputError where it cannot be used."""
    try:
        document = json.loads(read_regular(path, LONGEST).decode())
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError, RecursionError) as error:
        raise _unusable(path, str(error)) from None
    try:
        if document.pop("format") != FORMAT:
            raise _unusable(path, "another version of Norrbin wrote it")
        changes = tuple(_change(each) for each in document.pop("changes"))
        journal = Journal(**document, changes=changes)
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise _unusable(path, f"{type(error).__name__} {error}") from None
    return journal


def _change(fields: dict[str, Any]) -> Change:
    change = Change(**fields)
    numbers = (change.old, change.new)
    if not isinstance(change.name, str) or not all(isinstance(number, int | float) for number in numbers):
        raise ValueError(f"change {fields}")
    return change


def of_settings(journal: Journal, marks: Marks) -> Journal:
    """Return the journal without what the firmware moves by itself: it holds neither the old nor the new value."""
    owned = (Kept.STATE, Kept.READ_ONLY, Kept.DEVICE)
    kept = [each for each in journal.changes if kept_by_firmware(journal.firmware, each.name, marks) not in owned]
    return replace(journal, changes=tuple(kept))


def continued(earlier: Journal, changes: tuple[Change, ...], goal: Mapping[str, Number]) -> tuple[Change, ...]:
    """Return `changes` on top of an upload that was cut off: the way back leads to what was before that.

    goal: the value that each parameter of the earlier one is to have now.
    """
    before = {each.name: each.old for each in earlier.changes}
    named = {each.name for each in changes}
    mine = [each._replace(old=before.get(each.name, each.old)) for each in changes]
    rest = [each._replace(new=goal.get(each.name, each.new)) for each in earlier.changes if each.name not in named]
    return (*mine, *rest)


def discard_journal(path: Path) -> None:
    """Remove the journal for good."""
    path.unlink(missing_ok=True)
    sync_folder(path.parent)


def _unusable(path: Path, reason: str) -> InputError:
    return InputError(
        f"{path}: this journal of an upload cannot be used ({' '.join(reason.split())}); remove it, then restore the "
        "backup file of that upload: autopilot params restore BACKUP."
    )
