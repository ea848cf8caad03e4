"""What the boat answers to one ground station's messages: commands, parameters, missions. Pure.

Every message for us is answered with messages and, where people should know why, a text.

The parameter protocol's server side: a fixed table, every request answered, lists at a pace a radio can bear. Pure.

Source: https://mavlink.io/en/services/parameter.html, as QGroundControl, MAVProxy and MAVSDK use it: real values,
old value on refusal, changed values to every station, requests by name (index -1) or by index. What does not exist is
answered by PARAM_ERROR, as ArduPilot's GCS_Param.cpp does from 4.7 on; stations that do not know it see the silence
that they expect. A refusal has one too: an old value alone may as well have been on its way before the new one came.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from typing import Protocol

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.alarm_outputs import StatusTexts
from autopilot.links.ground_station.commands import ACCEPTED, DENIED, IN_PROGRESS, OVERBOARD, UNSUPPORTED, Commands
from autopilot.links.ground_station.file_server import GENERAL, NO_FILES, Content, FileServer, metadata_messages
from autopilot.links.ground_station.mission import FRAMES, MissionServer
from autopilot.links.ground_station.orders import CANCELLED, ProgressReports, acknowledgement, available_modes
from autopilot.links.ground_station.telemetry import Telemetry, version
from autopilot.links.mavlink.codec import Message, message_id
from autopilot.links.mavlink.frames import AvailableModes, ComponentInformation, ComponentMetadata

PER_TURN = 4
"""Parameters of a list that leave in one turn of the loop."""
NAME_LENGTH_MAX = 16
UNKNOWN, OUT_OF_RANGE = int(dialect.MAV_PARAM_ERROR_DOES_NOT_EXIST), int(dialect.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE)
PERMISSION_DENIED = int(dialect.MAV_PARAM_ERROR_PERMISSION_DENIED)
SAME = 1.0e-6
"""A value that was set is in force where it is so near, relative: it travels in 32 bits, and is kept in the fewest
digits that give these."""


class ParameterStore(Protocol):
    """What the server serves. The names, their order and their count do not change while it runs.

    revision: another one whenever a value has changed.
    """

    revision: int

    @property
    def names(self) -> tuple[str, ...]:
        """All names, each of at most 16 characters."""

    def get(self, name: str) -> float:
        """Return the value in force."""

    def set(self, name: str, value: float) -> str:
        """Put a value in force; return '' or, where it is refused, the sentence why."""


class ParameterServer:
    """Answers for one identity; `files`, by path, describe the parameters (`file_server.metadata_files`)."""

    def __init__(self, store: ParameterStore, files: Mapping[str, bytes] = NO_FILES) -> None:
        self._store, self.files = store, files
        self._names = store.names
        self._index = {name: index for index, name in enumerate(self._names)}
        self._listing: deque[int] = deque()
        self._revision, self._last_sent = store.revision, self._values()

    def take(self, message: Message) -> tuple[list[Message], str]:
        """Return the answers to a PARAM_ message, and what people should read."""
        kind = message.get_type()
        if kind == "PARAM_REQUEST_LIST":
            self._listing = deque(range(len(self._names)))
            return [], ""
        name = message.param_id.rstrip("\0")
        by_index = kind == "PARAM_REQUEST_READ" and message.param_index >= 0
        if by_index:
            name = self._names[message.param_index] if message.param_index < len(self._names) else ""
        if name not in self._index:
            return _error(message, UNKNOWN, message.param_index if by_index else -1), ""
        if kind == "PARAM_REQUEST_READ":
            return [self._value(name)], ""
        said = ""
        if message.param_type != dialect.MAV_PARAM_TYPE_REAL32:
            said = f"{name} not changed: it is REAL32 and was set as type {message.param_type}"
        elif not math.isfinite(message.param_value):
            said = f"{name} not changed: {message.param_value} is not a number"
        if said:
            return self.unchanged(message, OUT_OF_RANGE), said
        said = self._store.set(name, message.param_value)
        kept = self._last_sent[name] = self._store.get(name)
        if not math.isclose(kept, message.param_value, rel_tol=SAME):
            return self.unchanged(message, OUT_OF_RANGE), said
        return [self._value(name)], said

    def unchanged(self, message: Message, error: int | None) -> list[Message]:
        """Return the answer to a PARAM_SET that is not carried out: the value in force, and MAV_PARAM_ERROR `error`."""
        name = message.param_id.rstrip("\0")
        if name not in self._index:
            return _error(message, UNKNOWN)
        return [self._value(name), *(_error(message, error) if error is not None else [])]

    def due(self) -> list[Message]:
        """Return the next few of a list that was asked for, or of what was changed elsewhere: every station is to have
        the values in force."""
        if self._store.revision != self._revision:
            before, self._revision, self._last_sent = self._last_sent, self._store.revision, self._values()
            self._listing.extend(self._index[name] for name, value in self._last_sent.items() if value != before[name])
        count = min(PER_TURN, len(self._listing))
        return [self._value(self._names[self._listing.popleft()]) for _ in range(count)]

    def _values(self) -> dict[str, float]:
        return {name: self._store.get(name) for name in self._names}

    def _value(self, name: str) -> Message:
        return dialect.MAVLink_param_value_message(
            name.encode(),
            self._store.get(name),
            dialect.MAV_PARAM_TYPE_REAL32,
            len(self._names),
            self._index[name],
        )


def _error(message: Message, error: int, index: int = -1) -> list[Message]:
    """Return MAV_PARAM_ERROR `error` to whoever asked us for a parameter; by name where `index` is -1.

    Who asked everybody at once may mean another component's parameter, and gets none.
    """
    if not message.target_system or not message.target_component:
        return []
    asker = message.get_srcSystem(), message.get_srcComponent()
    name = message.param_id.encode("ascii", "replace")[:NAME_LENGTH_MAX]
    return [dialect.MAVLink_param_error_message(*asker, name, index, error)]


class StationService:
    """Answers for one link; what it has to say to people goes to `texts`, `files` are served over MAVLink FTP."""

    def __init__(
        self,
        commands: Commands,
        parameters: ParameterServer,
        telemetry: Telemetry,
        texts: StatusTexts,
        files: Mapping[str, Content] = NO_FILES,
    ) -> None:
        self._commands, self._parameters, self._telemetry, self._texts = commands, parameters, telemetry, texts
        self._mission = commands.mission
        self._missions = MissionServer(commands.mission)
        self._progress = ProgressReports()
        general = files.get(GENERAL)
        self._files, self._metadata = FileServer(files), general if isinstance(general, bytes) else None
        self._passed = 0
        self._replies = {
            "COMMAND_LONG": self._command_long,
            "COMMAND_INT": self._command_int,
            "COMMAND_CANCEL": self._command_cancel,
            "SET_MODE": self._set_mode,
            "TIMESYNC": self._timesync,
            "FILE_TRANSFER_PROTOCOL": lambda _, message: self._files.take(message),
            "PARAM_REQUEST_LIST": self._parameter,
            "PARAM_REQUEST_READ": self._parameter,
            "PARAM_SET": self._parameter,
            **dict.fromkeys(self._missions.kinds, self._mission_message),
        }

    def take(self, now: float, message: Message) -> list[Message]:
        """Return the answers to a message for us that came at `now` [s]."""
        reply = self._replies.get(message.get_type())
        return reply(now, message) if reply is not None else []

    def answered(self, message: Message, result: int) -> list[Message]:
        """Return the answer to an order of which nothing aboard changes; parameters and routes are denied."""
        kind, sender = message.get_type(), _sender(message)
        if kind == "PARAM_SET":
            return self._parameters.unchanged(message, PERMISSION_DENIED if result == DENIED else None)
        if kind.startswith("MISSION_"):
            return self._missions.denied(message)
        return [acknowledgement(message_id(message) if kind == "SET_MODE" else message.command, result, sender)]

    def due(self, now: float) -> list[Message]:
        """Return what falls due by `now` [s]: progress, the next of a list or a file, requests for items."""
        lists = (*self._parameters.due(), *self._files.due())
        messages = [*self._progress.due(now), *lists, *self._missions.due(now)]
        self._say_of_mission(now)
        if said := self._commands.tuning.outcome():
            self._texts.send_text(now, dialect.MAV_SEVERITY_NOTICE, said)
        return messages

    def passed(self) -> list[Message]:
        """Return word of a waypoint that has been passed since the last call."""
        guide = self._mission.guide
        if guide.passed == self._passed:
            return []
        self._passed = guide.passed
        if not self._mission.is_followed:
            return []
        return [dialect.MAVLink_mission_item_reached_message(guide.last_passed), self._mission.message()]

    def _parameter(self, now: float, message: Message) -> list[Message]:
        answers, refusal = self._parameters.take(message)
        self._warn(now, refusal)
        return answers

    def _command_long(self, now: float, message: Message) -> list[Message]:
        return self._command(now, message, tuple(float(getattr(message, f"param{number}")) for number in range(1, 8)))

    def _command_int(self, now: float, message: Message) -> list[Message]:
        first = tuple(float(getattr(message, f"param{number}")) for number in range(1, 5))
        has_place = message.command in (dialect.MAV_CMD_DO_REPOSITION, OVERBOARD)
        if has_place and message.frame not in FRAMES:
            self._warn(now, f"a place in frame {message.frame}: use a global one")
            return [acknowledgement(message.command, DENIED, _sender(message))]
        scale = 1.0e-7 if has_place else 1.0
        return self._command(now, message, (*first, message.x * scale, message.y * scale, float(message.z)))

    def _command(self, now: float, message: Message, parameters: tuple[float, ...]) -> list[Message]:
        answers: list[Message] = []
        command, sender, percent = message.command, _sender(message), 0
        if command == dialect.MAV_CMD_REQUEST_MESSAGE:
            answers = self._requested(_whole(parameters[0]), parameters[1])
            result = ACCEPTED if answers else UNSUPPORTED
        elif command == dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES:
            answers, result = [version()], ACCEPTED
        elif command == dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
            result = self._telemetry.set_interval(_whole(parameters[0]), parameters[1])
        else:
            result = self._commands.execute(command, parameters, self._telemetry.tick)
            self._warn(now, self._commands.refusal)
        if result == IN_PROGRESS and self._commands.running is not None:
            percent = self._commands.running.percent
            self._progress.begin(now, self._commands.running, sender)
        return [acknowledgement(command, result, sender, percent), *answers]

    def _requested(self, identity: int, detail: float) -> list[Message]:
        if identity == AvailableModes.id:
            return list(available_modes(detail))
        if identity in (ComponentMetadata.id, ComponentInformation.id):
            return metadata_messages(identity, self._metadata)
        if identity == dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            return [version()]
        return self._telemetry.make(identity)

    def _command_cancel(self, now: float, message: Message) -> list[Message]:
        sender, answers = _sender(message), []
        if self._commands.cancel(message.command) and not self._progress.is_for(sender):
            answers.append(acknowledgement(message.command, CANCELLED, sender))
        return answers + self._progress.due(now)

    def _set_mode(self, now: float, message: Message) -> list[Message]:
        custom = message.base_mode & dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        result = self._commands.set_mode(message.custom_mode, self._telemetry.tick) if custom else UNSUPPORTED
        if custom:
            self._warn(now, self._commands.refusal)
        return [acknowledgement(message_id(message), result, _sender(message))]

    def _timesync(self, now: float, message: Message) -> list[Message]:
        return [dialect.MAVLink_timesync_message(int(now * 1.0e9), message.ts1)] if message.tc1 == 0 else []

    def _mission_message(self, now: float, message: Message) -> list[Message]:
        answers = self._missions.take(now, message)
        self._say_of_mission(now)
        return answers

    def _say_of_mission(self, now: float) -> None:
        if self._missions.said:
            self._texts.send_text(now, dialect.MAV_SEVERITY_NOTICE, self._missions.said)
            self._missions.said = ""

    def _warn(self, now: float, refusal: str) -> None:
        if refusal:
            self._texts.send_text(now, dialect.MAV_SEVERITY_WARNING, refusal, is_answer=True)


def _sender(message: Message) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


def _whole(value: float) -> int:
    return int(value) if math.isfinite(value) and value == int(value) else -1
