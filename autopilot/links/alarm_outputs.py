"""Where alarms are heard: the terminal's bell, a pin or relay behind a file, the vehicle's buzzer or relay.

Each is a `Link` to nobody that is shown every tick; none may ever end steering. The vehicle's are sent by the link to
it, which asks `VehicleSounder` what is due. Links to nobody, too, bring the skipper's acknowledgement and the alarms of
a guide into the pilot, and so into the log and on to other links.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Protocol, TextIO

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.base import SilentLink
from autopilot.links.mavlink.codec import Message
from autopilot.links.mavlink.requests import AUTOPILOT_COMPONENT
from autopilot.signals import AcknowledgeSample, AlarmEvent, AlarmSample, Sample, Siren, Tick

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


class Acknowledgements(SilentLink):
    """Brings the skipper's acknowledgement into the pilot, and so into the log."""

    name = "skipper"

    def __init__(self, skipper: Acknowledger) -> None:
        self._skipper = skipper

    def receive(self, now: float) -> list[Sample]:
        """Return what was acknowledged since the last call."""
        names, self._skipper.acknowledged = self._skipper.acknowledged, []
        return [AcknowledgeSample(now, name, self.name) for name in names]


class Guide(Protocol):
    """Who has something to say."""

    @property
    def alarm(self) -> AlarmEvent | None:
        """What the skipper should know, None while all is well."""


class GuideAlarms(SilentLink):
    """Word of `guide`, under `name`, whenever it changes."""

    def __init__(self, guide: Guide, name: str) -> None:
        self.name = name
        self._guide = guide
        self._said: AlarmEvent | None = None

    def receive(self, now: float) -> list[Sample]:
        """Return what is new."""
        alarm = self._guide.alarm
        if alarm == self._said:
            return []
        self._said = alarm
        return [AlarmSample(now, alarm, self.name)]


class Bell(SilentLink):
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


class SwitchFile(SilentLink):
    """Writes 1 to a file while an alarm sounds and 0 else: `value` of a GPIO in sysfs, or whatever drives a relay."""

    def __init__(self, path: Path) -> None:
        self.name = f"alarm output {path}"
        self._path = path
        self._is_on: bool | None = None
        self._failed: AlarmEvent | None = None
        self._said: AlarmEvent | None = None

    def receive(self, now: float) -> list[Sample]:
        """Return an alarm where the file could not be written."""
        if self._failed == self._said:
            return []
        self._said = self._failed
        return [AlarmSample(now, self._failed, self.name)]

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
            self._path.write_text("1\n" if is_on else "0\n", encoding="ascii")
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
            values = (float(self._relay), float(is_on), 0.0, 0.0, 0.0, 0.0, 0.0)
            command = dialect.MAV_CMD_DO_SET_RELAY
            messages.append(dialect.MAVLink_command_long_message(vehicle, AUTOPILOT_COMPONENT, command, 0, *values))
        return messages
