"""`autopilot params upload` and `restore`: what writes to a vehicle, wholly or not at all."""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from pathlib import Path

from autopilot.cli.params_reading import (
    Report,
    opened_session,
    own_marks,
    refuse_other_firmware,
    settled_table,
    upload_json,
    upload_table,
)
from autopilot.cli.terminal import ProgressBar
from autopilot.errors import ExitCode, InputError, RefusedError
from autopilot.files.saving import save_unused
from autopilot.firmware.file import Heading, TypedValue, Wanted, dump_firmware
from autopilot.firmware.foreign_files import load_parameters
from autopilot.firmware.journal import (
    Holds,
    Journal,
    carry_out,
    continued,
    discard_journal,
    held_side,
    held_values,
    journal_path,
    of_settings,
    only_writer,
    put,
    read_journal,
    write_journal,
)
from autopilot.firmware.metadata import Marks, settings_of
from autopilot.firmware.protocol import Number, ParameterValue
from autopilot.firmware.session import ParameterSession, Vehicle
from autopilot.firmware.upload import Change, Outcome, Upload, Verdict
from autopilot.links.base import LinkError

INTERRUPTED = 130
OWN_ID = ("SYSID_THISMAV", "MAV_SYSID")
"""ArduPilot takes a new system id within a second (Rover.cpp, one_second_loop), and is another vehicle from then on."""


def upload(arguments: argparse.Namespace, *, settles: bool = False) -> int:
    """Write a file to a vehicle, read every value back, and go back where that fails.

    settles: a file that holds all that an upload which was cut off has changed settles that.
    """
    file = load_parameters(arguments.file, vessel_too=True)
    if settles and not file.is_counted:
        print(
            f"autopilot: {arguments.file} does not say how many parameters it was written with, so nobody can tell "
            "whether it was cut off.",
            file=sys.stderr,
        )
    with opened_session(arguments, arguments.link) as session:
        refuse_other_firmware(arguments.file, file, session.vehicle)
        marks = own_marks(session)
        wanted, left = settings_of(
            file.wanted, session.vehicle.firmware, calibration=arguments.with_calibration, marks=marks
        )
        with contextlib.nullcontext() if arguments.dry_run else only_writer(session.vehicle):
            earlier = None
            if not arguments.dry_run:
                earlier = _unfinished(session, arguments, wanted if settles else [], marks)
            attempt = Upload(session.vehicle.target, wanted, settles=earlier is not None)
            with ProgressBar("reading") as bar:
                session.run(attempt, bar.update)
            report = Report(str(arguments.file), left_out=tuple(left))
            if arguments.dry_run or not attempt.differs:
                code = _report(arguments, session.vehicle, attempt.outcomes(), report)
                if earlier is not None and code == ExitCode.OK:
                    _settle(session.vehicle, earlier)
                return code
            _refuse_armed(arguments, session.vehicle)
            _refuse_new_id(arguments.file, attempt)
            if not _may_begin(arguments, attempt):
                code = _report(arguments, session.vehicle, attempt.outcomes(), report)
                print(
                    "NOTHING WAS SET: not every parameter can be; correct the file, or set the others with "
                    "--on-failure keep.",
                    file=sys.stderr,
                )
                return code
            return _Writing(arguments, session, file.frame, report, earlier).carry_out(attempt)


def _may_begin(arguments: argparse.Namespace, attempt: Upload) -> bool:
    """Whether all that the file asks for can be set, as far as is known before anything is."""
    if arguments.on_failure == "keep":
        return True
    bad = [each.verdict for each in attempt.outcomes() if each.verdict in (Verdict.UNKNOWN, Verdict.REJECTED)]
    return not bad or (Verdict.REJECTED not in bad and attempt.may_bring_unknown)


class _Writing:
    """One upload from its first change to its end, good or bad."""

    def __init__(
        self,
        arguments: argparse.Namespace,
        session: ParameterSession,
        frame: str,
        report: Report,
        earlier: Journal | None,
    ) -> None:
        self._arguments = arguments
        self._session = session
        self._frame = frame
        self._earlier = earlier
        self._path = journal_path(session.vehicle)
        self._uid = session.identify().uid
        self._date = time.strftime("%Y-%m-%d %H:%M:%S %z")
        stamp = time.strftime("%Y%m%dT%H%M%S")
        default = f"{Path(arguments.file).stem}.before-{stamp}-sys{session.vehicle.system}.yaml"
        self._backup = None if arguments.no_backup else str(arguments.backup or default)
        self._report = report._replace(backup=self._backup)
        self._goal: dict[str, Number] = {}
        self._journal: Journal | None = None

    def carry_out(self, attempt: Upload) -> int:
        """Set, read back, and decide what is left standing; return the exit code."""
        code: int | None = None
        self._goal = {each.name: each.wanted for each in attempt.outcomes()}
        try:
            with ProgressBar("uploading") as bar:
                carry_out(self._session, attempt, self._save, bar.update)
        except KeyboardInterrupt:
            print("\ninterrupted", file=sys.stderr)
            code = INTERRUPTED
        except InputError:  # old values of what a switch brought into being cannot be kept
            self._go_back()
            raise
        except LinkError as error:
            unfinished = self._report._replace(finished=False)
            _report(self._arguments, self._session.vehicle, attempt.outcomes(), unfinished)
            raise LinkError(f"{error} {_how_to_restore(self._arguments.link)}") from None
        if self._session.vehicle.armed and not self._arguments.while_armed:
            # half of a file is worse than the whole of it, either way
            print(
                f"autopilot: vehicle {self._session.vehicle.system} was armed while parameters were being written, "
                "which took effect at once; disarm it before you steer with them.",
                file=sys.stderr,
            )
        report = self._report._replace(finished=attempt.is_over)
        verdict = _report(self._arguments, self._session.vehicle, attempt.outcomes(), report)
        if attempt.is_over and (verdict == ExitCode.OK or self._may_stay()):
            discard_journal(self._path)
        else:
            self._go_back()
        return verdict if code is None else code

    def _save(self, changes: list[Change]) -> None:
        """Save the old values before anything changes: what cannot be saved stops the upload."""
        if self._backup:
            self._save_backup(self._backup, changes)
        covered = tuple(changes)
        if self._earlier is not None:
            covered = continued(self._earlier, covered, self._goal)
        journal = Journal(
            str(self._arguments.file),
            self._date,
            self._session.vehicle.system,
            self._session.vehicle.firmware,
            self._uid,
            str(Path(self._backup).absolute()) if self._backup else "",  # it may be read from another folder
            covered,
        )
        write_journal(self._path, journal)
        self._journal = journal

    def _save_backup(self, path: str, changes: list[Change]) -> None:
        vehicle = self._session.vehicle
        heading = Heading(
            vehicle.firmware,
            self._frame,
            description=f"Values of vehicle {vehicle.system} before the upload of {self._arguments.file}",
            source=f"read back over {self._arguments.link}",
            date=self._date,
            is_backup=True,
        )
        text = dump_firmware((TypedValue(each.name, each.old, each.kind) for each in changes), heading)
        self._backup = str(save_unused(Path(path), text))

    def _may_stay(self) -> bool:
        """Whether what was set stays although not all of it holds: as the options say, else as the user does."""
        if self._arguments.on_failure != "ask":
            return bool(self._arguments.on_failure == "keep")
        return not _agrees("Not every parameter holds the value wanted. Put the old values back?")

    def _go_back(self) -> None:
        if self._journal is None:
            return
        print("putting the old values back", file=sys.stderr)
        try:
            outcomes = put_back(self._session, self._journal)
        except (KeyboardInterrupt, LinkError) as error:
            reason = "interrupted again" if isinstance(error, KeyboardInterrupt) else str(error)
            raise LinkError(f"{reason} {_how_to_restore(self._arguments.link)}") from None
        _print_end(outcomes, Holds.OLD, self._session.vehicle, self._path, self._arguments.link)


def restore(arguments: argparse.Namespace) -> int:
    """Finish an upload that was cut off, or upload the settings of a backup file."""
    if arguments.file:
        if arguments.to:
            raise InputError("--to chooses a side of an upload that was cut off; with a FILE leave it out.")
        return upload(argparse.Namespace(**vars(arguments), dry_run=False, no_backup=False, backup=None), settles=True)
    with opened_session(arguments, arguments.link) as session, only_writer(session.vehicle):
        path = journal_path(session.vehicle)
        journal = read_journal(path)
        if journal is None:
            print(f"vehicle {session.vehicle.system}: no upload was cut off, nothing to restore")
            return int(ExitCode.OK)
        _refuse_other_board(session, journal, path)
        journal = of_settings(journal, own_marks(session))
        with ProgressBar("reading") as bar:
            held = held_values(session, journal, bar.update)
        if arguments.to == "as-is":
            return _leave(session.vehicle, journal, held)
        holds = held_side(journal.changes, held)
        side = Holds(arguments.to) if arguments.to else (Holds.OLD if holds is Holds.MIXED else holds)
        if holds is side:
            discard_journal(path)
            print(_sentence(session.vehicle, side, journal))
            return int(ExitCode.OK)
        _refuse_armed(arguments, session.vehicle)
        outcomes = put_back(session, journal, side, settles=False)
        _report(arguments, session.vehicle, outcomes, Report("restore", journal.backup or None))
        if arguments.to:
            return _settle_on(outcomes, side, session.vehicle, path, arguments.link)
        return _print_end(outcomes, side, session.vehicle, path, arguments.link)


def _leave(vehicle: Vehicle, journal: Journal, values: dict[str, ParameterValue]) -> int:
    """Settle an upload that was cut off by what the vehicle holds: say what that is, and forget the rest."""
    held = {name: each.value for name, each in values.items()}
    print(settled_table(journal.changes, held))
    kept = f"the old values are in {journal.backup}" if journal.backup else "the old values are kept nowhere else"
    print(f"vehicle {vehicle.system} is left as it is; {kept}")
    _settle(vehicle, journal)
    return int(ExitCode.OK)


def _settle(vehicle: Vehicle, journal: Journal) -> None:
    """The upload that was cut off is settled, and others may follow."""
    discard_journal(journal_path(vehicle))
    print(f"the upload of {journal.file} ({journal.date}) is settled", file=sys.stderr)


def _settle_on(outcomes: list[Outcome], side: Holds, vehicle: Vehicle, path: Path, link: str) -> int:
    """Say what the vehicle holds of the side its owner chose; only what could not be read back keeps the journal."""
    bad = [each for each in outcomes if not each.is_good]
    if not bad or any(each.verdict is Verdict.UNCONFIRMED for each in bad):
        return _print_end(outcomes, side, vehicle, path, link)
    discard_journal(path)
    print(
        f"vehicle {vehicle.system} holds the {side} values but for {', '.join(each.name for each in bad)}, which it "
        "does not take; the upload that was cut off is settled",
        file=sys.stderr,
    )
    return int(ExitCode.DIFFERENT)


def put_back(
    session: ParameterSession, journal: Journal, side: Holds = Holds.OLD, *, settles: bool = True
) -> list[Outcome]:
    """Set one side of the journal and return what became of each parameter; `settles` as in `journal.put`."""
    with ProgressBar("restoring") as bar:
        return put(session, journal, side, bar.update, settles=settles)


def _print_end(outcomes: list[Outcome], side: Holds, vehicle: Vehicle, path: Path, link: str) -> int:
    """Say what the vehicle holds after the way back; the journal stays until it holds exactly that."""
    if bad := [each.name for each in outcomes if not each.is_good]:
        print(
            f"autopilot: vehicle {vehicle.system} does not take back {', '.join(bad)}, so that the upload stays "
            f"unsettled. {_how_to_settle(link)}",
            file=sys.stderr,
        )
        return int(ExitCode.DIFFERENT)
    discard_journal(path)
    print(f"vehicle {vehicle.system} holds exactly the {side} values", file=sys.stderr)
    return int(ExitCode.OK)


def _sentence(vehicle: Vehicle, side: Holds, journal: Journal) -> str:
    return f"vehicle {vehicle.system} holds exactly the {side} values of the upload of {journal.file} ({journal.date})"


def _unfinished(
    session: ParameterSession, arguments: argparse.Namespace, wanted: list[Wanted], marks: Marks
) -> Journal | None:
    """Return the upload to this vehicle that was cut off, None where none was.

    Raises RefusedError where `wanted` does not hold every parameter that it has changed.
    """
    vehicle, link = session.vehicle, arguments.link
    path = journal_path(vehicle)
    journal = read_journal(path)
    if journal is None:
        return None
    given = {name for each in wanted for name in each.names}
    journal = of_settings(journal, marks)
    if not wanted or (missing := [each.name for each in journal.changes if each.name not in given]):
        lacks = f" {arguments.file} does not hold {', '.join(missing)}, which it has changed." if wanted else ""
        raise RefusedError(
            f"the upload of {journal.file} to vehicle {vehicle.system} ({journal.date}) was cut off, so that it may "
            f"hold old and new values.{lacks} {_how_to_restore(link)}"
        )
    _refuse_other_board(session, journal, path)
    return journal


def _how_to_restore(link: str) -> str:
    return f"First run: autopilot params restore --link {link}"


def _how_to_settle(link: str) -> str:
    return (
        f"Settle it: autopilot params restore --link {link} --to old, or --to new, as far as the vehicle takes them, "
        "or --to as-is."
    )


def _refuse_armed(arguments: argparse.Namespace, vehicle: Vehicle) -> None:
    if not vehicle.armed:
        return
    if not arguments.while_armed:
        raise RefusedError(
            f"vehicle {vehicle.system} is armed, or engaged, and parameters take effect at once; disarm it, or say "
            "--while-armed. Nothing was sent."
        )
    print(f"autopilot: vehicle {vehicle.system} is armed; parameters take effect at once.", file=sys.stderr)


def _refuse_new_id(file: str, attempt: Upload) -> None:
    for change in attempt.changes():
        if change.name in OWN_ID:
            raise RefusedError(
                f"{file} changes {change.name} from {change.old} to {change.new}: the vehicle would be another one in "
                "the middle of the upload. Change it alone in a ground station, and take it out of the file. Nothing "
                "was set."
            )


def _refuse_other_board(session: ParameterSession, journal: Journal, path: Path) -> None:
    uid = session.identify().uid
    if uid and journal.uid and uid != journal.uid:
        raise RefusedError(
            f"the upload that was cut off went to another board ({journal.uid}) than this one ({uid}), both with "
            f"system id {journal.system}; connect that one, or remove {path} if it is no more."
        )


def _agrees(question: str) -> bool:
    """Ask on the terminal; where there is none, or no answer, the careful way is taken."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return True
    print(f"{question} [Y/n] ", end="", file=sys.stderr, flush=True)
    try:
        return not sys.stdin.readline().strip().casefold().startswith("n")
    except KeyboardInterrupt:
        return True


def _report(arguments: argparse.Namespace, vehicle: Vehicle, outcomes: list[Outcome], report: Report) -> int:
    printer = upload_json if arguments.json else upload_table
    print(printer(outcomes, vehicle, report))
    return int(ExitCode.OK if all(each.is_good for each in outcomes) else ExitCode.DIFFERENT)
