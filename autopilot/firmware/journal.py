"""The journal of an upload: what it changes, on disk before the first parameter is set, gone when all is well.

It outlives a kill or a power cut, so that `restore` knows what the vehicle held and what it was to hold.

An upload that is wholly done or wholly undone: journal first, set, and the way back from wherever it ended.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

from autopilot.errors import InputError
from autopilot.files.outside import read_regular
from autopilot.files.saving import FULL, alone, replace_file, sync_folder
from autopilot.firmware.file import Wanted
from autopilot.firmware.metadata import Kept, Marks, kept_by_firmware
from autopilot.firmware.protocol import Number, ParameterValue, same_value
from autopilot.firmware.session import ParameterSession, Progress, Vehicle
from autopilot.firmware.upload import Change, Outcome, Upload, enabled_group

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
    """Return the folder of journals: NORRBIN_STATE, else norrbin/ in XDG_STATE_HOME or ~/.local/state. InputError."""
    if chosen := os.environ.get("NORRBIN_STATE"):
        return Path(chosen)
    base = os.environ.get("XDG_STATE_HOME")
    try:
        return (Path(base) if base else Path.home() / ".local" / "state") / "norrbin"
    except RuntimeError as error:
        raise _no_folder(Path("~/.local/state/norrbin"), OSError(errno.ENOENT, str(error))) from None


def journal_path(vehicle: Vehicle) -> Path:
    """Return where the journal of an upload to `vehicle` is."""
    return state_folder() / f"upload-{vehicle.system}-{vehicle.component}.json"


@contextlib.contextmanager
def only_writer(vehicle: Vehicle) -> Iterator[None]:
    """Keep every other upload and restore of ours off the vehicle: its one journal leads back from one of them.

    The lock is the system's and ends with the process, however that ends. Raises RefusedError where another holds it.
    """
    path = journal_path(vehicle).with_suffix(".lock")
    _make_folder(path.parent)
    refusal = (
        f"another autopilot params is writing to vehicle {vehicle.system} just now; wait until it has ended, then run "
        "this command again. Nothing was sent."
    )
    try:
        descriptor = alone(path, refusal)
    except OSError as error:
        raise _no_folder(path.parent, error) from None
    try:
        yield
    finally:
        os.close(descriptor)


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _no_folder(folder, error) from None


def _no_folder(folder: Path, error: OSError) -> InputError:
    cure = "Free the disk, or name" if error.errno in FULL else "Name"
    return InputError(
        f"{folder}: cannot be written into ({error.strerror}); the old values are kept there, so that an upload can "
        f"be undone after a power cut. {cure} another folder in the environment variable NORRBIN_STATE."
    )


def write_journal(path: Path, journal: Journal) -> None:
    """Put the journal on disk, whole or not at all; raises InputError where that is impossible."""
    _make_folder(path.parent)
    document = {"format": FORMAT, **asdict(journal), "changes": [change._asdict() for change in journal.changes]}
    try:
        replace_file(path, json.dumps(document, indent=1))
    except OSError as error:
        raise _no_folder(path.parent, error) from None


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


Save = Callable[[list[Change]], None]


class Holds(StrEnum):
    """Which set of values a vehicle holds after an upload that did not end well."""

    OLD = "old"
    NEW = "new"
    MIXED = "mixed"


def carry_out(session: ParameterSession, upload: Upload, save: Save, progress: Progress) -> None:
    """Set everything that differs and read it back. `save` gets every change before it is made.

    Raises LinkError when the vehicle falls silent; whatever ends it early, what `save` got covers what was sent.
    """
    while not upload.is_over:
        save(upload.changes())
        upload.proceed()
        session.run(upload, progress)


def put(
    session: ParameterSession, journal: Journal, side: Holds, progress: Progress, *, settles: bool = True
) -> list[Outcome]:
    """Set every parameter of the journal to its old or new value and return what became of each.

    settles: what the upload sent last may still be on the way; on a link that reorders, a set may be behind the answer
    to a read.
    """
    upload = _read(session, journal, side, progress, settles)
    carry_out(session, upload, lambda changes: None, progress)
    return upload.outcomes()


def held_values(session: ParameterSession, journal: Journal, progress: Progress) -> dict[str, ParameterValue]:
    """Return what the vehicle holds of the journal's parameters, once the upload's last sets have settled."""
    return _read(session, journal, Holds.NEW, progress, settles=True).held


def held_side(changes: tuple[Change, ...], held: Mapping[str, ParameterValue]) -> Holds:
    """Return which set of values `held` are; where both are the same, the new one."""
    if holds_side(changes, held, Holds.NEW):
        return Holds.NEW
    return Holds.OLD if holds_side(changes, held, Holds.OLD) else Holds.MIXED


def _read(session: ParameterSession, journal: Journal, side: Holds, progress: Progress, settles: bool) -> Upload:
    """Return an upload of one side of the journal that has read what the vehicle holds, and set nothing."""
    wanted = [Wanted((change.name,), _value(change, side)) for change in journal.changes]
    upload = Upload(session.vehicle.target, wanted, settles=settles)
    session.run(upload, progress)
    return upload


def holds_side(changes: tuple[Change, ...], held: Mapping[str, ParameterValue], side: Holds) -> bool:
    """Return whether `held` are the old or the new values of all `changes`.

    A parameter that does not answer because its group is switched off on this side is as it should be: an upload
    sets the group before it switches it off, and the way back does the same.
    """
    off = [
        group
        for change in changes
        if (group := enabled_group(change.name)) and not _value(change, side) and change.name in held
    ]
    for change in changes:
        if change.name not in held:
            if not change.name.startswith(tuple(off)) or not off:
                return False
        elif not same_value(held[change.name].value, _value(change, side), held[change.name].kind):
            return False
    return True


def _value(change: Change, side: Holds) -> int | float:
    return change.old if side is Holds.OLD else change.new
