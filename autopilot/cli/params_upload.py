"""`autopilot params upload` and `restore`: what writes to a vehicle, wholly or not at all."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from autopilot.cli.params_reading import refuse_other_firmware
from autopilot.cli.params_report import upload_json, upload_table
from autopilot.cli.progress import ProgressBar
from autopilot.cli.signing import signing_of
from autopilot.errors import ExitCode, InputError, RefusedError
from autopilot.links.base import LinkError
from autopilot.params.any_file import ParameterFile, load_parameters
from autopilot.params.firmware_dump import Heading, TypedValue, dump_firmware
from autopilot.params.journal import Journal, discard_journal, journal_path, read_journal, write_journal
from autopilot.params.outcome import Change, Outcome, Verdict
from autopilot.params.saving import save_unused
from autopilot.params.session import ParameterSession, Vehicle
from autopilot.params.transaction import Holds, carry_out, look, put
from autopilot.params.upload import Upload

INTERRUPTED = 130
OWN_ID = ("SYSID_THISMAV", "MAV_SYSID")
"""ArduPilot takes a new system id within a second (Rover.cpp, one_second_loop), and is another vehicle from then on."""


def upload(arguments: argparse.Namespace) -> int:
    """Write a file to a vehicle, read every value back, and go back where that fails."""
    file = load_parameters(arguments.file, vessel_too=True)
    with ParameterSession(arguments.link, arguments.system, signing_of(arguments)) as session:
        refuse_other_firmware(arguments.file, file, session.vehicle)
        if not arguments.dry_run:
            _refuse_unfinished(session.vehicle, arguments.link)
        attempt = Upload(session.vehicle.target, file.wanted)
        with ProgressBar("reading") as bar:
            session.run(attempt, bar.show)
        if arguments.dry_run or not attempt.differs:
            return _report(arguments, session.vehicle, attempt.outcomes(), None)
        _refuse_armed(arguments, session.vehicle)
        _refuse_new_id(arguments.file, attempt)
        if not _may_begin(arguments, attempt):
            code = _report(arguments, session.vehicle, attempt.outcomes(), None)
            print(
                "NOTHING WAS SET: not every parameter can be; correct the file, or set the others with "
                "--on-failure keep.",
                file=sys.stderr,
            )
            return code
        return _Writing(arguments, session, file).carry_out(attempt)


def _may_begin(arguments: argparse.Namespace, attempt: Upload) -> bool:
    """Whether all that the file asks for can be set, as far as is known before anything is."""
    if arguments.on_failure == "keep":
        return True
    bad = [each.verdict for each in attempt.outcomes() if each.verdict in (Verdict.UNKNOWN, Verdict.REJECTED)]
    return not bad or (Verdict.REJECTED not in bad and attempt.may_bring_unknown)


class _Writing:
    """One upload from its first change to its end, good or bad."""

    def __init__(self, arguments: argparse.Namespace, session: ParameterSession, file: ParameterFile) -> None:
        self._arguments = arguments
        self._session = session
        self._file = file
        self._path = journal_path(session.vehicle)
        self._uid = session.identify().uid
        self._date = time.strftime("%Y-%m-%d %H:%M:%S %z")
        stamp = time.strftime("%Y%m%dT%H%M%S")
        default = f"{Path(arguments.file).stem}.before-{stamp}-sys{session.vehicle.system}.yaml"
        self._backup = None if arguments.no_backup else str(arguments.backup or default)
        self._journal: Journal | None = None

    def carry_out(self, attempt: Upload) -> int:
        """Set, read back, and decide what is left standing; return the exit code."""
        code: int | None = None
        try:
            with ProgressBar("uploading") as bar:
                carry_out(self._session, attempt, self._keep, bar.show)
        except KeyboardInterrupt:
            print("\ninterrupted", file=sys.stderr)
            code = INTERRUPTED
        except InputError:  # old values of what a switch brought into being cannot be kept
            self._go_back()
            raise
        except LinkError as error:
            _report(self._arguments, self._session.vehicle, attempt.outcomes(), self._backup, finished=False)
            raise LinkError(f"{error} {_how_to_restore(self._arguments.link)}") from None
        verdict = _report(
            self._arguments, self._session.vehicle, attempt.outcomes(), self._backup, finished=attempt.is_over
        )
        if attempt.is_over and (verdict == ExitCode.OK or self._may_stay()):
            discard_journal(self._path)
        else:
            self._go_back()
        return verdict if code is None else code

    def _keep(self, changes: list[Change]) -> None:
        """Save the old values before anything changes: what cannot be saved stops the upload."""
        if self._backup:
            self._save_backup(self._backup, changes)
        journal = Journal(
            str(self._arguments.file),
            self._date,
            self._session.vehicle.system,
            self._session.vehicle.firmware,
            self._uid,
            self._backup or "",
            tuple(changes),
        )
        write_journal(self._path, journal)
        self._journal = journal

    def _save_backup(self, path: str, changes: list[Change]) -> None:
        vehicle = self._session.vehicle
        heading = Heading(
            vehicle.firmware,
            self._file.frame,
            description=f"Values of vehicle {vehicle.system} before the upload of {self._arguments.file}",
            source=f"read back over {self._arguments.link}",
            date=self._date,
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
        _say_end(outcomes, Holds.OLD, self._session.vehicle, self._path, self._arguments.link)


def restore(arguments: argparse.Namespace) -> int:
    """Finish an upload that was cut off, or upload a backup file."""
    if arguments.file:
        if arguments.to:
            raise InputError("--to chooses a side of an upload that was cut off; with a FILE leave it out.")
        options = {"dry_run": False, "no_backup": False, "backup": None, "on_failure": "ask"}
        return upload(argparse.Namespace(**vars(arguments), **options))
    with ParameterSession(arguments.link, arguments.system, signing_of(arguments)) as session:
        path = journal_path(session.vehicle)
        journal = read_journal(path)
        if journal is None:
            print(f"vehicle {session.vehicle.system}: no upload was cut off, nothing to restore")
            return int(ExitCode.OK)
        _refuse_other_board(session, journal, path)
        with ProgressBar("reading") as bar:
            holds = look(session, journal, bar.show)
        side = Holds(arguments.to) if arguments.to else (Holds.OLD if holds is Holds.MIXED else holds)
        if holds is side:
            discard_journal(path)
            print(_sentence(session.vehicle, side, journal))
            return int(ExitCode.OK)
        _refuse_armed(arguments, session.vehicle)
        outcomes = put_back(session, journal, side)
        _report(arguments, session.vehicle, outcomes, journal.backup or None)
        return _say_end(outcomes, side, session.vehicle, path, arguments.link)


def put_back(session: ParameterSession, journal: Journal, side: Holds = Holds.OLD) -> list[Outcome]:
    """Set one side of the journal and return what became of each parameter."""
    with ProgressBar("restoring") as bar:
        return put(session, journal, side, bar.show)


def _say_end(outcomes: list[Outcome], side: Holds, vehicle: Vehicle, path: Path, link: str) -> int:
    """Say what the vehicle holds after the way back; the journal stays until it holds exactly that."""
    if bad := [each.name for each in outcomes if not each.is_good]:
        print(
            f"autopilot: vehicle {vehicle.system} does not take back {', '.join(bad)}. {_how_to_restore(link)}",
            file=sys.stderr,
        )
        return int(ExitCode.DIFFERENT)
    discard_journal(path)
    print(f"vehicle {vehicle.system} holds exactly the {side} values", file=sys.stderr)
    return int(ExitCode.OK)


def _sentence(vehicle: Vehicle, side: Holds, journal: Journal) -> str:
    return f"vehicle {vehicle.system} holds exactly the {side} values of the upload of {journal.file} ({journal.date})"


def _refuse_unfinished(vehicle: Vehicle, link: str) -> None:
    journal = read_journal(journal_path(vehicle))
    if journal is not None:
        raise RefusedError(
            f"the upload of {journal.file} to vehicle {vehicle.system} ({journal.date}) was cut off, so that it may "
            f"hold old and new values. {_how_to_restore(link)}"
        )


def _how_to_restore(link: str) -> str:
    return f"First run: autopilot params restore --link {link}"


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


def _report(
    arguments: argparse.Namespace,
    vehicle: Vehicle,
    outcomes: list[Outcome],
    backup: str | None,
    *,
    finished: bool = True,
) -> int:
    """Print what became of every parameter and return the exit code."""
    printer = upload_json if arguments.json else upload_table
    print(printer(outcomes, str(arguments.file or "restore"), vehicle, backup, finished=finished))
    return int(ExitCode.OK if all(each.is_good for each in outcomes) else ExitCode.DIFFERENT)
