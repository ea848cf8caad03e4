"""`autopilot new-boat`: from nothing to the first hold of a boat of your own, as a list that can be left and taken up.

Each step is a command of this program with its options worked out, what to prepare before it, and what is good enough.
What was done is kept in a small file beside the vessel's.
"""

from __future__ import annotations

import argparse
import cmath
import contextlib
import json
import math
import os
import re
import shutil
import signal
import sys
import textwrap
import time
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from autopilot.cli.options import SPEEDUP, number
from autopilot.errors import ExitCode, InputError, LinkError, RefusedError
from autopilot.files.outside import number_from, parse_json, read_regular, typed_number
from autopilot.files.saving import alone, check_folder, save_text
from autopilot.interruption import Interrupted, as_exceptions, run_child
from autopilot.models.drives import DRIVES
from autopilot.signals import CourseSample, Mode
from autopilot.vessel.schema import SCHEMA_VERSION, Drive, Guidance, Helm, Rudder, Vessel

MOST_BYTES = 1 << 16
SWINGS = 20.0
"""A 15/15 zigzag's period is about 4 (1/K + T): this many times 1/K + T are five of them."""
ZIGZAG_S = (40.0, 1800.0)
ZIGZAG_DEG, LARGER_DEG = 15.0, 20.0
LARGER_MOST = 2
"""Larger zigzags at most before the first hold decides."""
CHECKED_DEG = 10.0
NEAR_STOP_DEG = 5.0
"""The last step to an end stop that was only typed: no further is a rudder pressed against one that comes earlier."""
HELD_S = 60.0
HELD = ("good", "fair")
"""What `autopilot run` must call a hold at its end."""
BESIDE_DEG, STEADY = 45.0, 0.9
"""A current must make 0.7 of the boat's speed to set it so far aside (its sine); a mean direction less steady than this
is that of no way at all."""
FULL_STEERING_DEG, THRUSTERS_DEG_S, THRUSTERS_LAG_S = 30.0, 150.0, 0.15
"""Of two thrusters: what stands for full steering, and what is usual of their motors."""


class Boat(NamedTuple):
    """The boat's file, the options of its links, and its vessel as it is in the file now."""

    file: Path
    links: tuple[str, ...]
    vessel: Vessel

    def logs(self, name: str) -> dict[int, Path]:
        """Return the logs of that name that are there by their numbers, the oldest first."""
        named = re.compile(re.escape(f"{self.file.stem}-{name}") + r"(?:-(\d+))?\.tlog")
        there = ((named.fullmatch(path.name), path) for path in self.file.absolute().parent.iterdir())
        found = sorted((int(match[1] or 1), path.name) for match, path in there if match)
        return {number: self.file.with_name(name) for number, name in found}

    def log(self, name: str) -> str:
        """Return a name for a log behind all that are there: a number that was freed would make it look older."""
        number = max(self.logs(name), default=0) + 1
        return str(self.file.with_name(f"{self.file.stem}-{name}{f'-{number}' * (number > 1)}.tlog"))


class Step(NamedTuple):
    """One step.

    before: what to do first.  command: the arguments of `autopilot`.  good: what is good enough.  otherwise: what to do
    where it is not.  question: what only the operator can see, "" where the exit code says all.  check: what its log
    shows to be otherwise than the file says, a clause each.  again: what a boat that
    steers by thrust is asked until the answer is no.
    """

    name: str
    title: str
    before: str
    command: Callable[[Boat], list[str]]
    good: str
    otherwise: str
    question: str = ""
    check: Callable[[Boat, Path], list[str]] = lambda boat, log: []
    again: str = ""


def _doctor(boat: Boat) -> list[str]:
    return ["doctor", str(boat.file), *boat.links, "--seconds", "5"]


def _rudder(boat: Boat) -> list[str]:
    """Order a little to either side, then step by step to each end stop: typed too large, it is touched, not rammed."""
    rudder = boat.vessel.rudder
    most, some = rudder.angle_max_deg, min(CHECKED_DEG, rudder.angle_max_deg)
    angles = [some, -some, 0.0]
    if not DRIVES[boat.vessel.drive.kind].is_mixed:
        steps = [step for step in (0.5 * (some + most), most - NEAR_STOP_DEG, most) if step > some]
        angles += [*steps, 0.0, *(-step for step in steps), 0.0]
    each = 2.0 + 2.0 * most / (rudder.rate_max_deg_s or most)
    options = ["--rudder-deg", ",".join(f"{angle:g}" for angle in angles), "--each", f"{each:.0f}"]
    options += ["--at-dock", "--unidentified", "--log", boat.log("rudder")]
    return ["trial", "turning", str(boat.file), *boat.links, *options]


def _rudder_log(boat: Boat, log: Path) -> list[str]:
    """Return how the rudder's sensor, where there is one, contradicts the file."""
    from autopilot.identification.rudder_path import measured_rate
    from autopilot.identification.verdict import angles_against, rate_against, rests_of
    from autopilot.logs.reading import load_recording
    from autopilot.logs.table import orders_of

    try:
        seen = orders_of(load_recording(str(log)))
    except InputError as error:
        print(error)
        seen = None
    if seen is None:
        print("No sensor shows the rudder: nothing but your eye has compared its angles with those that you typed.")
        return []
    rate = measured_rate([(seen.time, seen.angle)])
    against = [*angles_against(rests_of(seen)), *rate_against(rate, boat.vessel.rudder.slower_rate, [seen])]
    if not against:
        print("The rudder's sensor agrees with the angles and the rate that you typed.")
    return against


def _zigzag(boat: Boat) -> list[str]:
    # beside a throttle two thrusters have little steering left
    most = CHECKED_DEG if DRIVES[boat.vessel.drive.kind].is_mixed else ZIGZAG_DEG
    return _zigzag_of(boat, min(most, boat.vessel.rudder.angle_max_deg), _lasting(boat), "zigzag")


def _lasting(boat: Boat) -> float:
    model = boat.vessel.model
    return min(max(SWINGS * (1.0 / model.K_1_s + model.T_s), ZIGZAG_S[0]), ZIGZAG_S[1])


def _zigzag_of(boat: Boat, angle: float, lasts: float, name: str) -> list[str]:
    options = ["--rudder-deg", f"{angle:g}", "--heading-deg", f"{angle:g}", "--duration", f"{math.ceil(lasts)}"]
    options += ["--at-least", "start", "--unidentified", "--log", boat.log(name)]
    return ["trial", "zigzag", str(boat.file), *boat.links, *options]


def _identify(boat: Boat) -> list[str]:
    return [*_known(boat), "--at-least", "start"]


def _known(boat: Boat) -> list[str]:
    """Write what the zigzags tell, however little: `identify` itself refuses a boat that no gains are sure to serve."""
    used = [*boat.logs("zigzag").values()]
    if not used:
        place = boat.file.with_name(f"{boat.file.stem}-zigzag.tlog")
        raise InputError(f"{place}: not there; sail the zigzag first: autopilot new-boat {boat.file} --redo zigzag")
    # how thrust steers goes with the throttle: every zigzag counts
    if DRIVES[boat.vessel.drive.kind].usual.is_rudder:
        used = [used[-1], *boat.logs(_beside(boat)).values()]
    return ["identify", *map(str, used), "--vessel", str(boat.file), "--out", str(boat.file)]


def _beside(boat: Boat) -> str:
    """Return what the larger zigzags are called that are identified together with the newest zigzag."""
    number = max(boat.logs("zigzag"))
    return f"zigzag{f'-{number}' * (number > 1)}-larger"


def _larger(boat: Boat) -> list[str]:
    angle, lasts = min(LARGER_DEG, boat.vessel.rudder.angle_max_deg), min(2.0 * _lasting(boat), ZIGZAG_S[1])
    return _zigzag_of(boat, angle, lasts, _beside(boat))


def _gains(boat: Boat) -> list[str]:
    report = boat.file.with_name(f"{boat.file.stem}-gains.html")
    return ["gains", str(boat.file), "--out", str(boat.file), *_report(report)]


def _report(page: Path) -> list[str]:
    from autopilot.report import require_extra

    try:
        require_extra()
    except InputError:
        return []
    return ["--report", str(page)]


def _hold(boat: Boat) -> list[str]:
    options = ["--engage", "present", "--duration", f"{HELD_S:g}", "--log", boat.log("hold")]
    return ["run", str(boat.file), *boat.links, *options]


def _hold_log(boat: Boat, log: Path) -> list[str]:
    """Return what was wrong with the last hold: the exit code says no more than that it was sailed."""
    from autopilot.report.steered import Steered
    from autopilot.runtime.record import read_logs

    if not log.exists():
        return [f"{log} is not there, which would show how well it was held"]
    steered, beside = Steered(boat.vessel.drive.kind), list[complex]()
    for part in read_logs(log):
        for tick in part.ticks:
            steered(tick)
            courses = (each.course for each in tick.samples if type(each) is CourseSample and tick.mode is Mode.ENGAGED)
            beside += [cmath.rect(1.0, course - tick.state.heading) for course in courses]
    verdict, mean = steered.verdict, sum(beside) / max(len(beside), 1)
    if verdict is None:
        return ["no course was held"]
    against = [] if verdict.grade in HELD else [verdict.sentence]
    if abs(mean) > STEADY and abs(apart := math.degrees(cmath.phase(mean))) > BESIDE_DEG:
        side = "starboard" if apart > 0.0 else "port"
        against.append(
            f"over the ground the boat went {abs(apart):.0f} deg to {side} of its heading: look how the compass is "
            "mounted and calibrated, unless so strong a current runs there (then: --done hold)"
        )
    return against


TOO_FAST = (
    "it turned much faster than its file says: if length or speed was typed wrong, remove the file and begin again"
)
STEPS = (
    Step(
        "doctor",
        "this computer and the links",
        "Switch the instruments on. With a flight controller: arm it, mode MANUAL, throttle neutral.",
        _doctor,
        "GO, with warnings that you have read",
        "do what stands behind each arrow, or name another link with --link",
    ),
    Step(
        "rudder",
        "proof of control, sign and end stops",
        "At the dock, propeller stopped. The rudder moves 10 deg to starboard and to port, then in steps to the "
        "starboard stop and to the port one. Keep hands clear and the power switch at hand, and press Ctrl-C as soon "
        "as it touches a stop: that releases it. Of two thrusters one runs ahead and one astern: tie the boat up well.",
        _rudder,
        "it steered to starboard first, then to port, and no stop was touched",
        f"it ended early: do what its last lines say; {TOO_FAST}; wrong side first: reverse it at the drive or in "
        "SERVOn_REVERSED; against a stop: set rudder.angle_max_deg lower; too little or too much: measure "
        "helm.rudder_at_full_pwm_deg and helm.servo_us",
        "Did it steer to starboard first, then to port, and was no stop touched?",
        _rudder_log,
    ),
    Step(
        "zigzag",
        "the zigzag",
        "Open water, 20 boat lengths to each side, calm. Steady speed, the one that you sail most. Somebody keeps a "
        "lookout; a mode change, or Ctrl-C, ends it. A boat that steers by thrust needs it at two or three throttles.",
        _zigzag,
        "it was sailed to its end, and its last lines say good, or good for a start",
        "it ended early: do what its last lines say; too little room, or too much sea: sail elsewhere, or on a calmer "
        "day; the boat turned against its rudder: see to its side with --redo rudder; "
        f"{TOO_FAST}; no way was made: get under way first; the heading hardly swung: look whether the rudder moves, "
        "with --redo rudder",
        again="Sail another at another throttle (a quarter, a half, three quarters)?",
    ),
    Step(
        "identify",
        "your boat's model",
        "The log is read. Where it tells too little, a larger zigzag is asked for, and all are identified together.",
        _identify,
        "the first line says good, or good for a start",
        "a zigzag again: --redo zigzag; other trials that the first line asks for: sail them with autopilot trial, "
        "identify all logs together into the file with autopilot identify, then --done identify",
    ),
    Step(
        "gains",
        "the gains",
        "Look at rudder: in the file first: end stop, rate and lag are what margins rest on.",
        _gains,
        "the margins are kept",
        "the sentence says which margin is missing; usually the rudder is slower than the boat needs: a lower --level",
    ),
    Step(
        "hold",
        "the first hold",
        "Open water again, on a course you can keep for a minute. A hand near the helm.",
        _hold,
        "its last lines say good or fair: the course is held within 6 deg for 95 % of the time, by a quiet rudder",
        "its model was not enough, or its gains doubtful: sail what step 4 asked for with autopilot trial, identify "
        "all logs together into the file with autopilot identify, then --redo gains; its model is good, and it swings "
        'or wanders off: docs/faq.md, "It steers badly"; too much sea: wait for a calmer day; a busy rudder in a calm: '
        "gains with a lower --level, then --redo hold",
        "Did it hold the course, with a quiet rudder?",
        _hold_log,
    ),
)


ZIGZAG = next(step for step in STEPS if step.name == "zigzag")


def _are_words(values: list[object]) -> bool:
    return all(isinstance(value, str) for value in values)


class Checklist:
    """What has been done for a vessel file; kept in NAME.commissioning.json beside it."""

    def __init__(self, file: Path) -> None:
        self.path = file.with_suffix(".commissioning.json")
        self.links: tuple[str, ...] = ()
        self.done: dict[str, str] = {}
        if self.path.exists():
            self._read()

    def _read(self) -> None:
        origin = str(self.path)
        found = parse_json(read_regular(self.path, MOST_BYTES), origin, MOST_BYTES)
        links, done = (found.get("links"), found.get("done")) if isinstance(found, dict) else (None, None)
        if not isinstance(links, list) or not isinstance(done, dict) or not _are_words([*links, *done, *done.values()]):
            raise InputError(f"{origin}: not a list of `autopilot new-boat`; remove it to begin anew")
        unknown = {*done} - {step.name for step in STEPS}
        if unknown:
            names = ", ".join(step.name for step in STEPS)
            raise InputError(f"{origin}: done: {min(unknown)!r} is no step; there are {names}")
        self.links, self.done = tuple(links), dict(done)

    def save(self) -> None:
        """Write it. Raises InputError where that is impossible."""
        text = json.dumps({"links": list(self.links), "done": self.done}, indent=2)
        save_text(self.path, text + "\n")

    @property
    def next(self) -> Step | None:
        """The first step that is not done."""
        return next((step for step in STEPS if step.name not in self.done), None)

    def tick_off(self, step: Step, when: datetime) -> None:
        """Note a step as done; those after it, which rest on it, are not."""
        places = [each.name for each in STEPS]
        after = places[places.index(step.name) + 1 :]
        self.done = {name: at for name, at in self.done.items() if name not in after}
        self.done[step.name] = when.isoformat(timespec="seconds")

    def mark(self, name: str, *, is_done: bool) -> None:
        """Note the next step as done, or one and those after it as not done, in the file too. Raises InputError."""
        places = [step.name for step in STEPS]
        if name not in places:
            raise InputError(f"{name}: no step; there are {', '.join(places)}")
        if is_done and (self.next is None or self.next.name != name):
            raise InputError(f"{name}: not the next step; one rests on the other")
        if is_done:
            self.tick_off(STEPS[places.index(name)], datetime.now())
        for each in () if is_done else places[places.index(name) :]:
            self.done.pop(each, None)
        self.save()

    def state(self, step: Step) -> str:
        """Return whether a step is done, next or later."""
        return "done" if step.name in self.done else "next" if step is self.next else "later"

    def lines(self) -> list[str]:
        """Return the list as it is shown."""
        return [
            f"  {number}. {self.state(step).replace('later', ''):4s}  {step.title}"
            + (f"  ({self.done[step.name].replace('T', ' ')})" if step.name in self.done else "")
            for number, step in enumerate(STEPS, 1)
        ]


DESCRIPTION = """\
Begin with a boat of your own: find its links, write its file, then go through
doctor, proof of control, zigzag, identification, gains and the first hold. Leave it whenever you like; the same command
goes on where you left. Each step is an ordinary command, printed before it runs."""
LENGTHS = number(0.2, 500.0)
SPEEDS_KN = number(0.1, 80.0)
STOPS = number(1.0, 90.0)
SIDES = number(0.1, 600.0)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.description = DESCRIPTION
    parser.add_argument("file", type=Path, metavar="NAME.yaml", help="the boat's file: written where it is not there")
    parser.add_argument(
        "--link", action="append", default=[], metavar="URL", help="as for `autopilot run` (default: what is found)"
    )
    parser.add_argument("--as-gcs", action="store_true", help="as for `autopilot run`")
    parser.add_argument("--drive", choices=tuple(DRIVES), help="what steers the boat (rudder)")
    parser.add_argument("--length-m", action=LENGTHS, metavar="L", help="length of the waterline")
    parser.add_argument("--speed-kn", action=SPEEDS_KN, metavar="U", help="the speed that is sailed most")
    parser.add_argument("--rudder-max-deg", action=STOPS, metavar="DEG", help="end stop of the rudder, each side")
    parser.add_argument(
        "--side-to-side-s", action=SIDES, metavar="S", help="seconds from one end stop to the other at full speed"
    )
    parser.add_argument("--list", action="store_true", help="show what is done and what comes next, and end")
    parser.add_argument("--redo", metavar="STEP", help="do this step and those after it again")
    parser.add_argument("--done", metavar="STEP", help="the next step was done by hand: go on behind it")
    parser.add_argument(
        "--yes", action="store_true", help="ask nothing: every step that the exit code finds good is good"
    )
    parser.add_argument("--speedup", action=SPEEDUP, default=1.0, metavar="X", help="for a simulator")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Go on from where the list was left. Raises InputError, and RefusedError where a step is not good enough."""
    from autopilot.vessel.file import refuse_bare_name

    file: Path = arguments.file
    refuse_bare_name(file)
    if arguments.list and arguments.done is arguments.redo is None:
        return _go_on(arguments, Talk(silent=True))
    with alone_with(file):
        return _go_on(arguments, Talk(arguments.yes))


@contextlib.contextmanager
def alone_with(file: Path) -> Iterator[None]:
    """Keep every other process from the steps of boats in this folder. Raises InputError; RefusedError while one is."""
    check_folder(file)
    refusal = f"another autopilot new-boat goes through its steps in the folder of {file}; go on there, or end it first"
    descriptor = alone(file.absolute().parent, refusal)
    try:
        yield
    finally:
        os.close(descriptor)


def _go_on(arguments: argparse.Namespace, talk: Talk) -> int:
    from autopilot.identification.interval import ENOUGH, off_by
    from autopilot.vessel.file import load_vessel

    file: Path = arguments.file
    checklist = Checklist(file)
    for name, is_done in ((arguments.done, True), (arguments.redo, False)):
        if name is not None:
            checklist.mark(name, is_done=is_done)
    if not file.exists():
        if arguments.list:
            raise InputError(f"{file}: not there yet; autopilot new-boat {file} begins it")
        write_boat(arguments, talk)
        # what was done with a file that is gone says nothing of this boat
        checklist.done.clear()
    if arguments.list:
        print("\n".join(checklist.lines()))
        return int(ExitCode.OK)
    load_vessel(file)  # a mistake in it is said before anything else is asked
    checklist.links = links_of(arguments, checklist, talk)
    checklist.save()
    while (step := checklist.next) is not None:
        print("\n".join(["", *checklist.lines(), ""]))
        try:
            with as_exceptions():
                take(step, Boat(file, (*checklist.links, *_pace(step, arguments)), load_vessel(file)), talk)
        except KeyboardInterrupt:
            print(f"\nLeft before step {STEPS.index(step) + 1} was done: {step.title}.")
            wrong = "If something was wrong:"
            print("\n".join([*_remedies(step, wrong), f"To carry on here: autopilot new-boat {file}"]))
            raise
        checklist.tick_off(step, datetime.now())
        checklist.save()
    print("\n".join(["", *checklist.lines(), ""]))
    links, boat = " ".join(checklist.links), Boat(file, checklist.links, load_vessel(file))
    print(f"Done: {file} steers. Every day: autopilot run {file} {links}")
    model, holds = boat.vessel.model, boat.logs("hold")
    if max(off_by("gain", model.K_1_s, model.standard_errors.K_1_s or 0.0)) > ENOUGH:
        print("Its model is known little: alter course by 10 deg at a time, in a calm. A rudder sensor makes it known.")
    boots = " ".join(f"--run-with={word}" if word == "--as-gcs" else word for word in checklist.links)
    print(f"From power-on: autopilot install-service {file} {boots}")
    if holds:
        print(f"Look at the first hold again: autopilot replay {holds[max(holds)]}")
    return int(ExitCode.OK)


def _pace(step: Step, arguments: argparse.Namespace) -> tuple[str, ...]:
    is_on_links = step.name != "gains"
    return ("--speedup", f"{arguments.speedup:g}") if is_on_links and arguments.speedup != 1.0 else ()


def typed(words: str) -> str:
    """Return what is typed. A terminal that closes (Ctrl-D, a lost SSH session) leaves the list as Ctrl-C does."""
    try:
        return input(words).strip()
    except EOFError:
        raise Interrupted(signal.SIGHUP) from None


class Talk:
    """Questions on the terminal; none where `silent`, or where nobody is there to answer."""

    def __init__(self, silent: bool) -> None:
        self.silent = silent or not sys.stdin.isatty()
        self._says_yes = silent

    def number(self, words: str, option: str, low: float, high: float) -> float:
        """Return a number from `low` to `high`, asked for until one is typed. InputError where nobody answers."""
        if self.silent:
            raise InputError(f"{option} is needed where nobody answers: {words}")
        while True:
            with contextlib.suppress(InputError):
                return number_from(typed_number(typed(f"{words} ({low:g} to {high:g}): ")), option, low, high)
            print(f"  write a number from {low:g} to {high:g}, such as 7.5")

    def choice(self, words: str, allowed: Sequence[str]) -> str:
        """Return one of the words that are allowed, the first where nothing is typed or nobody answers."""
        if self.silent:
            return allowed[0]
        while (answer := typed(f"{words} ({', '.join(allowed)}) [{allowed[0]}]: ").lower()) not in ("", *allowed):
            print(f"  write one of {', '.join(allowed)}")
        return answer or allowed[0]

    def yes(self, words: str) -> bool:
        """Return whether the answer is yes; without anybody to answer it is, where --yes says so. Else InputError."""
        if self._says_yes:
            return True
        if self.silent:
            raise InputError(f"nobody answers {words!r}; run this on a terminal, or with --yes")
        while True:
            answer = typed(f"{words} [y/n] ").lower()
            if answer in ("y", "yes", "n", "no"):
                return answer[0] == "y"
            print("  write y or n")

    def ready(self, words: str) -> None:
        """Wait until the operator is ready. InputError where nobody is there to be, and --yes does not say so."""
        print(words)
        if self.silent and not self._says_yes:
            raise InputError("nobody is there to begin this and to watch; run it on a terminal, or with --yes")
        if not self.silent:
            typed("Press Enter to begin, Ctrl-C to leave: ")

    def seconds(self, words: str) -> float:
        """Return the time between two presses of Enter."""
        typed(f"{words} Press Enter as it leaves one stop: ")
        begun = time.monotonic()
        typed("Press Enter as it reaches the other: ")
        return time.monotonic() - begun


def write_boat(arguments: argparse.Namespace, talk: Talk) -> None:
    """Ask what the boat is like and write its file. Raises InputError."""
    from autopilot.identification.verdict import KNOT_M_S
    from autopilot.vessel.file import doubted, dump_vessel, first_model, parse_vessel, rounded

    file: Path = arguments.file
    check_folder(file)
    print(f"{file} is not there yet. A few numbers begin it; the zigzag will find the rest.")

    def asked(given: float | None, words: str, option: str, allowed: Any) -> float:
        return given if given is not None else talk.number(words, option, allowed.low, allowed.high)

    kind = DRIVES[arguments.drive or talk.choice("What steers it", tuple(DRIVES))]
    length = asked(arguments.length_m, "Length of the waterline in metres", "--length-m", LENGTHS)
    speed = asked(arguments.speed_kn, "Speed that you sail most, in knots", "--speed-kn", SPEEDS_KN)
    if kind.is_mixed:
        stop, source = FULL_STEERING_DEG, "full steering, by definition"
        rudder = Rudder(stop, THRUSTERS_DEG_S, THRUSTERS_LAG_S, source=f"{source}; rate and lag assumed")
        guidance = Guidance(rudder_share=1.0, source="thrusters answer at once: turns are planned with all of them")
    else:
        stop = asked(
            arguments.rudder_max_deg, "End stop of the rudder in degrees, each side", "--rudder-max-deg", STOPS
        )
        side = arguments.side_to_side_s
        if side is None and not talk.silent and talk.yes("Can it be moved from stop to stop now, at full speed?"):
            side = round(talk.seconds("Move it from one stop to the other."), 2)
        side = asked(side, "Seconds from one end stop to the other", "--side-to-side-s", SIDES)
        source = "assumed to be the end stop; measure it"
        rudder = Rudder(stop, rounded(2.0 * stop / side), source="stops and time from side to side, measured")
        guidance = Guidance()
    boat = Vessel(
        schema_version=SCHEMA_VERSION,
        name=file.stem,
        length_m=length,
        model=first_model(length, speed * KNOT_M_S),
        rudder=rudder,
        drive=Drive(kind=kind.name),
        guidance=guidance,
        helm=Helm(rudder_at_full_pwm_deg=stop, source=source),
    )
    text = dump_vessel(boat)
    try:
        parse_vessel(text, str(file))
    except InputError as error:
        raise InputError(
            f"nothing was written: no boat is {length:g} m long and sails {speed:g} kn ({error})"
        ) from error
    save_text(file, text, overwrite=False)
    print(f"wrote {file}; its model is {boat.model.source}")
    if doubts := doubted(file, boat):
        print("\n".join(doubts))
        print(f"If length or speed was typed wrong: press Ctrl-C, remove {file}, and begin again.")


def links_of(arguments: argparse.Namespace, checklist: Checklist, talk: Talk) -> tuple[str, ...]:
    """Return the options that name the links: as given, as kept, or as found. Raises InputError."""
    if arguments.link:
        from autopilot.links.url import parse_url

        for url in arguments.link:
            parse_url(url)
        given = tuple(word for url in arguments.link for word in ("--link", url))
        return (*given, "--as-gcs") if arguments.as_gcs else given
    if checklist.links:
        return checklist.links
    from autopilot.doctor.vehicle import candidates, discover

    print("Looking for what sends here:")
    found = discover(candidates(), tell=lambda url: print(f"  {url} ...", flush=True))
    for sender in found:
        print(f"  found {sender.words}")
    useful = [sender for sender in found if sender.has_heading]
    if not useful:
        raise InputError(
            "no heading was found on this machine's lines; switch the instruments on and look at the wiring, or name "
            "the link with --link (a boat on the network is not looked for)"
        )
    chosen = next((each for each in useful if talk.yes(f"Use {each.url}?")), None)
    if chosen is None:
        raise InputError("no link was chosen; name it with --link")
    gcs = chosen.protocol == "MAVLink" and talk.yes(
        "Steer with the ground station's id (--as-gcs), which ArduPilot obeys?"
    )
    return ("--link", chosen.url, *(("--as-gcs",) if gcs else ()))


def take(step: Step, boat: Boat, talk: Talk) -> None:
    """Run a step, as often as it takes. Raises RefusedError where it is not good enough."""
    # no word is cut at the terminal's edge; a command stays one line, to be copied
    print(f"== {step.title}\n{textwrap.fill(step.before, shutil.get_terminal_size().columns, break_on_hyphens=False)}")
    _take_once(step, boat, talk)
    by_thrust = not DRIVES[boat.vessel.drive.kind].usual.is_rudder
    while step.again and by_thrust and not talk.silent and talk.yes(step.again):
        _take_once(step, boat, talk)


def _take_once(step: Step, boat: Boat, talk: Talk) -> None:
    command = step.command(boat)
    code = _run(command, talk)
    if code == ExitCode.REFUSED and step.name == "identify" and DRIVES[boat.vessel.drive.kind].usual.is_rudder:
        code = _look_again(boat, talk)
    again, number = f"then: autopilot new-boat {boat.file}", STEPS.index(step) + 1
    if code == ExitCode.LINK:
        raise LinkError(
            f"step {number} ({step.title}) is not done: the links did not bring what it needs, as said above. Switch "
            f"on what sends and look at the wires, or name other links with --link; {again}"
        )
    log = Path(command[command.index("--log") + 1]) if "--log" in command else boat.file
    against = "; ".join(step.check(boat, log)) if code == 0 else ""
    if code != 0 or against or (step.question and not talk.yes(step.question)):
        why = f": {against}" if against else ", as said above" if code != 0 else ""
        print("\n".join([f"Good enough is: {step.good}.", *_remedies(step)]), flush=True)
        raise RefusedError(f"step {number} ({step.title}) is not done{why}; do what stands above, {again}")


def _remedies(step: Step, heading: str = "If not:") -> list[str]:
    return [heading, *(f"  - {words}" for words in step.otherwise.split("; "))]


def _run(command: list[str], talk: Talk) -> int:
    talk.ready(f"autopilot {' '.join(command)}")
    return run_child([sys.executable, "-m", "autopilot", *command])


def _look_again(boat: Boat, talk: Talk) -> int:
    """Sail larger zigzags where the first tells too little, and identify all of them; return the exit code.

    What is still not known, the first hold decides: a file is written where gains serve at both ends of what is open.
    """
    code = int(ExitCode.REFUSED)
    for _ in range(LARGER_MOST):
        again = " once more" if boat.logs(_beside(boat)) else ""
        if code != ExitCode.REFUSED or not talk.yes(f"Sail a larger zigzag{again}, to be identified with the first?"):
            break
        if sailed := _run(_larger(boat), talk):
            print("\n".join(["The larger zigzag is not done; it is asked for again.", *_remedies(ZIGZAG)]), flush=True)
            return sailed
        code = _run(_identify(boat), talk)
    if code == ExitCode.REFUSED and talk.yes(
        "Go on with what is known, where gains serve it? The first hold will show"
    ):
        code = _run(_known(boat), talk)
    return code
