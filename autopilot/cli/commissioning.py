"""The way of a new boat from its file to the first hold, as a list that can be left and taken up again.

Each step is a command of this program with its options worked out, what to prepare before it, and what is good enough.
What was done is kept in a small file beside the vessel's.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from autopilot.errors import InputError
from autopilot.files.outside import parse_json, read_regular
from autopilot.files.saving import numbered, save_text
from autopilot.vessel.schema import Vessel

MOST_BYTES = 1 << 16
SWINGS = 20.0
"""A 15/15 zigzag's period is about 4 (1/K + T): this many times 1/K + T are five of them."""
ZIGZAG_S = (40.0, 1800.0)
ZIGZAG_DEG = 15.0
CHECKED_DEG = 10.0
HELD_S = 60.0


class Boat(NamedTuple):
    """The boat's file, the options of its links, and its vessel as it is in the file now."""

    file: Path
    links: tuple[str, ...]
    vessel: Vessel

    def log(self, name: str) -> str:
        """Return the first name for a log that is free yet."""
        place = self.file.with_name(f"{self.file.stem}-{name}.tlog")
        return str(next(path for path in numbered(place) if not path.exists()))


class Step(NamedTuple):
    """One step.

    before: what to do first.  command: the arguments of `autopilot`.  good: what is good enough.  otherwise: what to do
    where it is not.  question: what only the operator can see, "" where the exit code says all.
    """

    name: str
    title: str
    before: str
    command: Callable[[Boat], list[str]]
    good: str
    otherwise: str
    question: str = ""


def _doctor(boat: Boat) -> list[str]:
    return ["doctor", str(boat.file), *boat.links, "--seconds", "5"]


def _rudder(boat: Boat) -> list[str]:
    most = boat.vessel.rudder.angle_max_deg
    some = min(CHECKED_DEG, most)
    angles = f"{some:g},{-some:g},{most:g},{-most:g}"
    options = [
        "--rudder-deg",
        angles,
        "--each",
        f"{2.0 + 2.0 * most / (boat.vessel.rudder.rate_max_deg_s or most):.0f}",
    ]
    return ["trial", "turning", str(boat.file), *boat.links, "--unidentified", *options, "--log", boat.log("rudder")]


def _zigzag(boat: Boat) -> list[str]:
    model = boat.vessel.model
    angle = min(ZIGZAG_DEG, boat.vessel.rudder.angle_max_deg)
    lasts = min(max(SWINGS * (1.0 / model.K_1_s + model.T_s), ZIGZAG_S[0]), ZIGZAG_S[1])
    options = ["--rudder-deg", f"{angle:g}", "--heading-deg", f"{angle:g}", "--duration", f"{math.ceil(lasts)}"]
    return ["trial", "zigzag", str(boat.file), *boat.links, "--unidentified", *options, "--log", boat.log("zigzag")]


def _identify(boat: Boat) -> list[str]:
    place = boat.file.with_name(f"{boat.file.stem}-zigzag.tlog")
    logs = [str(path) for path in _until_missing(place)]
    if not logs:
        raise InputError(f"{place}: not there; sail the zigzag first: autopilot new-boat {boat.file} --redo zigzag")
    return ["identify", logs[-1], "--vessel", str(boat.file), "--out", str(boat.file)]


def _until_missing(place: Path) -> list[Path]:
    found = []
    for path in numbered(place):
        if not path.exists():
            break
        found.append(path)
    return found


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


STEPS = (
    Step(
        "doctor",
        "this computer and the links",
        "Switch the instruments on. With a flight controller: arm it, mode MANUAL, throttle neutral.",
        _doctor,
        "GO, with warnings that you have read",
        "do what stands behind each arrow, then run this step again",
    ),
    Step(
        "rudder",
        "proof of control, sign and end stops",
        "At the dock, propeller stopped. The rudder will move: 10 deg to starboard, to port, then to both end stops. "
        "Keep hands clear and the power switch at hand.",
        _rudder,
        "the rudder went to starboard first, then to port, and stopped short of its stops both times",
        "wrong side first: reverse it at the drive or in SERVOn_REVERSED; against a stop: set rudder.angle_max_deg "
        "lower; too little or too much: measure helm.rudder_at_full_pwm_deg and helm.servo_us",
        "Did it go to starboard first, then to port, and stop short of its stops both times?",
    ),
    Step(
        "zigzag",
        "the zigzag",
        "Open water, 20 boat lengths to each side, calm. Steady speed, the one that you sail most. Somebody keeps a "
        "lookout; a mode change, or Ctrl-C, ends it.",
        _zigzag,
        "it was sailed to its end",
        "more room, or less sea; then run this step again",
    ),
    Step(
        "identify",
        "your boat's model",
        "Nothing to do: the log is read.",
        _identify,
        "the first line says good, or good for a start",
        "sail what the first line asks for: autopilot new-boat FILE --redo zigzag",
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
        "it holds the course, and the last line says how well",
        'swings: see docs/faq.md, "It steers badly"',
        "Did it hold the course quietly?",
    ),
)


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

    def redo(self, name: str) -> None:
        """Take a step, and those after it, as not done. InputError where there is none of that name."""
        places = [step.name for step in STEPS]
        if name not in places:
            raise InputError(f"--redo {name}: no step; there are {', '.join(places)}")
        for each in places[places.index(name) :]:
            self.done.pop(each, None)

    def lines(self) -> list[str]:
        """Return the list as it is shown."""
        upcoming = self.next
        marks = {step.name: "done" if step.name in self.done else "next" if step is upcoming else "" for step in STEPS}
        return [
            f"  {number}. {marks[step.name]:4s}  {step.title}"
            + (f"  ({self.done[step.name].replace('T', ' ')})" if step.name in self.done else "")
            for number, step in enumerate(STEPS, 1)
        ]
