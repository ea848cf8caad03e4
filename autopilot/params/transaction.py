"""An upload that is wholly done or wholly undone: journal first, set, and the way back from wherever it ended."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import StrEnum

from autopilot.params.download import NamedDownload
from autopilot.params.firmware_file import Wanted
from autopilot.params.journal import Journal
from autopilot.params.outcome import Change, Outcome, enabled_group
from autopilot.params.protocol import ParameterValue
from autopilot.params.session import ParameterSession, Progress
from autopilot.params.upload import Upload
from autopilot.params.value_coding import same_value

Keep = Callable[[list[Change]], None]


class Holds(StrEnum):
    """Which set of values a vehicle holds after an upload that did not end well."""

    OLD = "old"
    NEW = "new"
    MIXED = "mixed"


def carry_out(session: ParameterSession, upload: Upload, keep: Keep, show: Progress) -> None:
    """Set everything that differs and read it back. `keep` gets every change before it is made.

    Raises LinkError when the vehicle falls silent; whatever ends it early, what `keep` got covers what was sent.
    """
    while not upload.is_over:
        keep(upload.changes())
        upload.proceed()
        session.run(upload, show)


def put(session: ParameterSession, journal: Journal, side: Holds, show: Progress) -> list[Outcome]:
    """Set every parameter of the journal to its old or new value and return what became of each."""
    wanted = [Wanted((change.name,), change.old if side is Holds.OLD else change.new) for change in journal.changes]
    upload = Upload(session.vehicle.target, wanted)
    session.run(upload, show)
    carry_out(session, upload, lambda changes: None, show)
    return upload.outcomes()


def look(session: ParameterSession, journal: Journal, show: Progress) -> Holds:
    """Return which of the journal's sets the vehicle holds; where both are the same, the new one."""
    client = NamedDownload(session.vehicle.target, [change.name for change in journal.changes])
    session.run(client, show)
    if holds_side(journal.changes, client.values, Holds.NEW):
        return Holds.NEW
    return Holds.OLD if holds_side(journal.changes, client.values, Holds.OLD) else Holds.MIXED


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
