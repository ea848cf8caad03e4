"""Where alarms are heard and read: the terminal's bell, a pin or relay behind a file, the vehicle's buzzer, texts.

Each but the texts is a `Link` to nobody that is shown every tick; none may ever end steering. The vehicle's are sent by
the link to it, which asks `VehicleSounder` what is due. Links to nobody, too, bring the skipper's acknowledgement and
the alarms of a guide into the pilot, and so into the log and on to other links.

`StatusTexts`: STATUSTEXT in pieces of 50 characters, never faster than a radio can bear.
"""

from __future__ import annotations

import math
import os
from collections import deque
from pathlib import Path
from typing import Protocol, TextIO

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.base import AlarmNews, Link
from autopilot.links.mavlink.codec import Message
from autopilot.links.mavlink.requests import AUTOPILOT_COMPONENT, vehicle_command
from autopilot.signals import AcknowledgeSample, AlarmEvent, Sample, Siren, Tick
from autopilot.supervision.alarms import kind_of

PIECE = 50
SPACING_S = 0.2
WAITING_LIMIT = 40
UNWAITING = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC
"""As a switch is opened: a pipe that nobody reads would hold up the steering."""
REPEAT_S = 10.0
"""The same text is sent again only after this."""


def severity_of(alarm: AlarmEvent, usual: int) -> int:
    """Return the MAV_SEVERITY of an alarm: its own in the table or `usual`, whichever is worse, and the worst but one
    for what nobody has acknowledged."""
    own = dialect.MAV_SEVERITY_ALERT if alarm.is_escalated else kind_of(alarm).severity
    return min(usual, int(own))


class StatusTexts:
    """A short queue of texts, the pieces that wait in `waiting`; when it is full the newest are dropped and counted."""

    def __init__(self) -> None:
        self.dropped = 0
        self.waiting: deque[Message] = deque()
        self._next = -math.inf
        self._identity = 0
        self._last = ("", math.nan)

    def send_text(self, now: float, severity: int, text: str, is_answer: bool = False) -> None:
        """Queue `text` with MAV_SEVERITY `severity` (0 emergency to 7 debug); one that answers an order is said to
        everyone who asks, once they have heard the one before."""
        if text == self._last[0] and (self.waiting if is_answer else now - self._last[1] < REPEAT_S):
            return
        raw = text.encode("ascii", errors="replace")
        pieces = [raw[start : start + PIECE] for start in range(0, len(raw), PIECE)]
        if not pieces or len(self.waiting) + len(pieces) > WAITING_LIMIT:
            self.dropped += bool(pieces)
            return
        self._last = (text, now)
        identity = 0
        if len(pieces) > 1:
            # Pieces of one text share an id; 0 is for texts of one piece.
            self._identity = self._identity % 65535 + 1
            identity = self._identity
        for number, piece in enumerate(pieces):
            self.waiting.append(dialect.MAVLink_statustext_message(severity, piece, identity, number))

    def due(self, now: float) -> list[Message]:
        """Return the piece whose turn it is at `now` [s], or none."""
        if not self.waiting or now < self._next:
            return []
        self._next = now + SPACING_S
        return [self.waiting.popleft()]


BELL_S = {Siren.SOUNDING: 2.0, Siren.ESCALATED: 0.5}
TUNE_S = {Siren.SOUNDING: 4.0, Siren.ESCALATED: 1.5}
"""How often a bell, and a tune, is repeated [s]."""
TUNES = {Siren.SOUNDING: b"MFT200L8AAP4", Siren.ESCALATED: b"MFT240L16ECECEC"}
"""In the notation of PLAY_TUNE (QBasic's PLAY), which ArduPilot and PX4 read."""
RELAY_REPEAT_S = 5.0
RELAY_MOST = 15


class Acknowledger(Protocol):
    """Who acknowledges alarms: adds their names to `acknowledged`, "" for all that sound."""

    acknowledged: list[str]


class Acknowledgements(Link):
    """Brings the skipper's acknowledgement into the pilot, and so into the log."""

    name = "skipper"

    def __init__(self, skipper: Acknowledger) -> None:
        self._skipper = skipper

    def receive(self, now: float) -> list[Sample]:
        """Return what was acknowledged since the last call."""
        names, self._skipper.acknowledged = self._skipper.acknowledged, []
        return [AcknowledgeSample(now, name, self.name) for name in names]


class Bell(Link):
    """Rings the bell of a terminal: every other second, and twice a second once escalated."""

    name = "bell"

    def __init__(self, terminal: TextIO) -> None:
        self._terminal = terminal
        self._next = -math.inf

    def publish_tick(self, tick: Tick) -> None:
        """Ring where it is time to."""
        if tick.siren is Siren.QUIET:
            self._next = -math.inf
            return
        if tick.now >= self._next:
            self._next = tick.now + BELL_S[tick.siren]
            try:
                self._terminal.write("\a")
                self._terminal.flush()
            except (OSError, ValueError):
                self._next = math.inf  # the terminal is gone: steering goes on without its bell


class SwitchFile(Link):
    """Writes 1 to a file while an alarm sounds and 0 else: `value` of a GPIO in sysfs, or whatever drives a relay."""

    def __init__(self, path: Path) -> None:
        self.name = f"alarm output {path}"
        self._path = path
        self._is_on: bool | None = None
        self._failed: AlarmEvent | None = None
        self._news = AlarmNews(self.name)

    def receive(self, now: float) -> list[Sample]:
        """Return an alarm where the file could not be written."""
        return self._news.of(now, self._failed)

    def publish_tick(self, tick: Tick) -> None:
        """Switch."""
        self._switch(tick.siren is not Siren.QUIET)

    def close(self) -> None:
        """Switch off."""
        self._switch(False)

    def _switch(self, is_on: bool) -> None:
        if is_on is self._is_on:
            return
        self._is_on = is_on
        try:
            descriptor = os.open(self._path, UNWAITING)
            try:
                os.write(descriptor, b"1\n" if is_on else b"0\n")
            finally:
                os.close(descriptor)
            self._failed = None
        except OSError as error:
            self._failed = AlarmEvent("output_failed", str(error))


class VehicleSounder:
    """The vehicle's buzzer (PLAY_TUNE) and one of its relays (DO_SET_RELAY)."""

    def __init__(self, tune: bool, relay: int | None) -> None:
        self._tune, self._relay = tune, relay
        self._siren = Siren.QUIET
        self._next_tune = self._next_relay = -math.inf
        self._relay_on = False

    def publish_tick(self, tick: Tick) -> None:
        """Take what is to be heard."""
        if tick.siren is not self._siren:
            self._next_tune = self._next_relay = -math.inf
        self._siren = tick.siren

    def due(self, now: float, vehicle: int) -> list[Message]:
        """Return what is to be sent to the vehicle at `now` [s]."""
        messages: list[Message] = []
        if self._tune and self._siren is not Siren.QUIET and now >= self._next_tune:
            self._next_tune = now + TUNE_S[self._siren]
            messages.append(dialect.MAVLink_play_tune_message(vehicle, AUTOPILOT_COMPONENT, TUNES[self._siren]))
        is_on = self._siren is not Siren.QUIET
        if self._relay is not None and (is_on or self._relay_on) and now >= self._next_relay:
            # an order lost on a bad line is given again while the alarm lasts, and once more when it is over
            self._next_relay = now + RELAY_REPEAT_S
            self._relay_on = is_on
            messages.append(vehicle_command(vehicle, dialect.MAV_CMD_DO_SET_RELAY, self._relay, is_on))
        return messages
