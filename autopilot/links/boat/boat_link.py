"""A `Link` to ground stations that see the running pilot as a surface boat. No samples come of it, no rudder moves."""

from __future__ import annotations

import math
from collections import deque

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.base import LinkError, Transport
from autopilot.links.boat.commands import ACCEPTED, CANCELLED, DENIED, IN_PROGRESS, UNSUPPORTED, Commands, LongCommand
from autopilot.links.boat.mission_server import MissionServer
from autopilot.links.boat.modes import available_modes
from autopilot.links.boat.parameter_server import ParameterServer
from autopilot.links.boat.telemetry import RATES_HZ, Telemetry, version
from autopilot.links.extra_messages import AvailableModes
from autopilot.links.mavlink_codec import MavlinkCodec, Message, message_id
from autopilot.links.signing import LinkSigning
from autopilot.links.status_text import StatusTexts
from autopilot.links.url import believe_signed
from autopilot.signals import AlarmSample, Mode, RudderCommand, Sample, Tick

COMPONENT = 1
HEARTBEAT_S = 1.0
FASTEST_HZ = 50.0
PROGRESS_S = 1.0
TRACK_SOURCE = "track"
MESSAGES_PER_TURN = 100
"""Messages heeded in one turn of the loop; what a flood brings beyond them is dropped."""
PACKETS_KEPT = 5000
STATES = {
    Mode.STANDBY: dialect.MAV_STATE_STANDBY,
    Mode.ENGAGED: dialect.MAV_STATE_ACTIVE,
    Mode.OVERRIDE: dialect.MAV_STATE_STANDBY,
    Mode.FAILSAFE: dialect.MAV_STATE_CRITICAL,
}
SEVERITIES = {Mode.FAILSAFE: dialect.MAV_SEVERITY_CRITICAL}
REFUSAL_S = 60.0
REFUSAL = "refused: messages that are not signed with our key"
FILE_NAK = (129, 7)
"""MAVLink FTP: opcode NAK, error "unknown command"."""


class BoatLink:
    """One ground station's side: heartbeat, telemetry, parameters, commands, texts, under system `system`.

    `signing`: everything sent is signed, and nothing is obeyed that is not.

    Attributes:
        dropped: packets that the transport could not take, and messages beyond what a turn heeds.
    """

    def __init__(
        self,
        transport: Transport,
        commands: Commands,
        parameters: ParameterServer,
        system: int = 1,
        signing: LinkSigning | None = None,
    ) -> None:
        self.name = transport.name
        self.dropped = 0
        self._transport = transport
        self._commands = commands
        self._parameters = parameters
        self._codec = MavlinkCodec(system, COMPONENT, transport.is_stream, signing)
        believe_signed(transport, signing)
        self._mission = commands.mission
        self._missions = MissionServer(commands.mission)
        self._telemetry = Telemetry(commands.mission)
        self._long: tuple[LongCommand, tuple[int, int]] | None = None
        self._next_progress = -math.inf
        self._passed = 0
        self._track_alarm = ""
        self._texts = StatusTexts()
        self._periods = {identity: 1.0 / rate for identity, rate in RATES_HZ.items()}
        self._due = dict.fromkeys(self._periods, -math.inf)
        self._next_heartbeat = -math.inf
        self._packets: deque[tuple[float, bytes]] = deque(maxlen=PACKETS_KEPT)
        self._next_refusal = -math.inf
        self._alarms: tuple[str, ...] = ()
        self._lost = ""
        self._replies = {
            "COMMAND_LONG": self._command_long,
            "COMMAND_INT": self._command_int,
            "SET_MODE": self._set_mode,
            "TIMESYNC": self._timesync,
            "COMMAND_CANCEL": self._command_cancel,
            **dict.fromkeys(self._missions.kinds, self._mission_message),
            "FILE_TRANSFER_PROTOCOL": self._file_transfer,
            "PARAM_REQUEST_LIST": self._parameter,
            "PARAM_REQUEST_READ": self._parameter,
            "PARAM_SET": self._parameter,
        }

    def fileno(self) -> int:
        """Return the transport's descriptor, or -1."""
        return -1 if self._lost else self._transport.fileno()

    def receive(self, now: float) -> list[Sample]:
        """Answer what has arrived by `now` [s]. Samples are alarms: of the route's guide, or of a lost station."""
        heeded = 0
        refused = self._codec.refused
        try:
            chunks = self._transport.receive() if not self._lost else []
        except LinkError as error:
            chunks, self._lost = [], f"ground station lost, steering goes on: {error}"
            return [AlarmSample(now, self._lost, self.name)]
        for data in chunks:
            for message in self._codec.decode(data):
                heeded += 1
                if heeded > MESSAGES_PER_TURN:
                    self.dropped += 1
                    continue
                self._packets.append((now, bytes(message._msgbuf)))
                reply = self._replies.get(message.get_type())
                if reply is not None and self._is_for_us(message):
                    reply(now, message)
        if self._codec.refused > refused and now >= self._next_refusal:
            self._next_refusal = now + REFUSAL_S
            self._texts.say(now, dialect.MAV_SEVERITY_WARNING, REFUSAL)
        return self._track_alarms(now)

    def send(self, now: float, command: RudderCommand) -> None:
        """Do nothing: the rudder is elsewhere."""

    def release(self, now: float) -> None:
        """Say that we go, so that nobody waits for us; never raises."""
        self._heartbeat(now, dialect.MAV_STATE_POWEROFF)

    def show(self, tick: Tick) -> None:
        """Send the telemetry that falls due with `tick`."""
        self._telemetry.take(tick)
        self._show_passed(tick.now)
        for identity, due in self._due.items():
            if tick.now >= due:
                period = self._periods[identity]
                self._due[identity] = due + period if due + period > tick.now else tick.now + period
                for message in self._telemetry.make(identity):
                    self._transmit(tick.now, message)

    def tell(self, now: float, mode: Mode, alarms: tuple[str, ...]) -> None:
        """Say every new alarm as STATUSTEXT."""
        for alarm in alarms:
            if alarm not in self._alarms:
                self._texts.say(now, SEVERITIES.get(mode, dialect.MAV_SEVERITY_WARNING), alarm)
        self._alarms = alarms

    def keep(self, now: float) -> None:
        """Send heartbeat, texts and the next of a parameter list."""
        if now >= self._next_heartbeat:
            self._next_heartbeat = now + HEARTBEAT_S
            tick = self._telemetry.tick
            self._heartbeat(now, STATES[tick.mode] if tick is not None else dialect.MAV_STATE_BOOT)
        self._show_progress(now)
        for message in (*self._parameters.due(), *self._missions.due(now), *self._texts.due(now)):
            self._transmit(now, message)
        self._say_of_mission(now)

    def take_packets(self) -> list[tuple[float, bytes]]:
        """Return and forget the raw packets of both directions since the last call."""
        packets = list(self._packets)
        self._packets.clear()
        return packets

    def close(self) -> None:
        """Close the transport."""
        self._transport.close()

    def _heartbeat(self, now: float, state: int) -> None:
        tick = self._telemetry.tick
        engaged = tick is not None and tick.mode is Mode.ENGAGED
        flags = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        flags |= dialect.MAV_MODE_FLAG_AUTO_ENABLED if engaged else dialect.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
        if engaged or self._commands.armed:
            flags |= dialect.MAV_MODE_FLAG_SAFETY_ARMED
        mode = self._telemetry.mode(tick) if tick is not None else 0
        message = dialect.MAVLink_heartbeat_message(
            dialect.MAV_TYPE_SURFACE_BOAT, dialect.MAV_AUTOPILOT_GENERIC, flags, mode, state, 3
        )
        self._transmit(now, message)

    def _is_for_us(self, message: Message) -> bool:
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        return system in (0, self._codec.system) and component in (0, COMPONENT)

    def _parameter(self, now: float, message: Message) -> None:
        answers, refusal = self._parameters.take(message)
        for answer in answers:
            self._transmit(now, answer)
        if refusal:
            self._texts.say(now, dialect.MAV_SEVERITY_WARNING, refusal)

    def _command_long(self, now: float, message: Message) -> None:
        self._command(now, message, tuple(float(getattr(message, f"param{number}")) for number in range(1, 8)))

    def _command_int(self, now: float, message: Message) -> None:
        first = tuple(float(getattr(message, f"param{number}")) for number in range(1, 5))
        scale = 1.0e-7 if message.command == dialect.MAV_CMD_DO_REPOSITION else 1.0
        self._command(now, message, (*first, message.x * scale, message.y * scale, float(message.z)))

    def _command(self, now: float, message: Message, parameters: tuple[float, ...]) -> None:
        answers: list[Message] = []
        command = message.command
        if command == dialect.MAV_CMD_REQUEST_MESSAGE:
            answers = self._requested(_whole(parameters[0]), parameters[1])
            result = ACCEPTED if answers else UNSUPPORTED
        elif command == dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES:
            answers, result = [version()], ACCEPTED
        elif command == dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
            result = self._set_interval(_whole(parameters[0]), parameters[1])
        else:
            result = self._commands.execute(command, parameters, self._telemetry.tick)
            if self._commands.refusal:
                self._texts.say(now, dialect.MAV_SEVERITY_WARNING, self._commands.refusal)
        sender = (message.get_srcSystem(), message.get_srcComponent())
        progress = 0
        if result == IN_PROGRESS and self._commands.running is not None:
            self._long, self._next_progress = (self._commands.running, sender), now + PROGRESS_S
            progress = _percent(self._commands.running)
        self._transmit(now, dialect.MAVLink_command_ack_message(command, result, progress, 0, *sender))
        for answer in answers:
            self._transmit(now, answer)

    def _requested(self, identity: int, detail: float) -> list[Message]:
        if identity == AvailableModes.id:
            return list(available_modes(detail))
        if identity == dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            return [version()]
        return self._telemetry.make(identity)

    def _set_interval(self, identity: int, interval_us: float) -> int:
        if not self._telemetry.knows(identity):
            return UNSUPPORTED
        if interval_us == 0.0:
            self._periods[identity] = 1.0 / RATES_HZ.get(identity, 1.0)
        elif interval_us == -1.0:
            self._due.pop(identity, None)
            return ACCEPTED
        elif interval_us > 0.0 and math.isfinite(interval_us):
            self._periods[identity] = max(interval_us * 1.0e-6, 1.0 / FASTEST_HZ)
        else:
            return DENIED
        self._due[identity] = -math.inf
        return ACCEPTED

    def _set_mode(self, now: float, message: Message) -> None:
        custom = message.base_mode & dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        result = self._commands.set_mode(message.custom_mode, self._telemetry.tick) if custom else UNSUPPORTED
        if self._commands.refusal and result != ACCEPTED:
            self._texts.say(now, dialect.MAV_SEVERITY_WARNING, self._commands.refusal)
        sender = (message.get_srcSystem(), message.get_srcComponent())
        self._transmit(now, dialect.MAVLink_command_ack_message(message_id(message), result, 0, 0, *sender))

    def _timesync(self, now: float, message: Message) -> None:
        if message.tc1 == 0:
            self._transmit(now, dialect.MAVLink_timesync_message(int(now * 1.0e9), message.ts1))

    def _command_cancel(self, now: float, message: Message) -> None:
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if self._commands.cancel(message.command) and (self._long is None or self._long[1] != sender):
            ack = dialect.MAVLink_command_ack_message(message.command, CANCELLED, 0, 0, *sender)
            self._transmit(now, ack)
        self._show_progress(now)

    def _show_progress(self, now: float) -> None:
        """Say how far a command is that takes a while, and how it ended."""
        if self._long is None:
            return
        (running, sender), result = self._long, IN_PROGRESS
        if running.run.is_over:
            self._long = None
            result = ACCEPTED if running.run.is_complete else dialect.MAV_RESULT_FAILED
            result = CANCELLED if running.is_cancelled else result
        elif now < self._next_progress:
            return
        self._next_progress = now + PROGRESS_S
        ack = dialect.MAVLink_command_ack_message(running.command, result, _percent(running), 0, *sender)
        self._transmit(now, ack)

    def _mission_message(self, now: float, message: Message) -> None:
        for answer in self._missions.take(now, message):
            self._transmit(now, answer)
        self._say_of_mission(now)

    def _say_of_mission(self, now: float) -> None:
        if self._missions.said:
            self._texts.say(now, dialect.MAV_SEVERITY_NOTICE, self._missions.said)
            self._missions.said = ""

    def _show_passed(self, now: float) -> None:
        """Tell of a waypoint that has been passed."""
        guide = self._mission.guide
        if guide.passed != self._passed:
            self._passed = guide.passed
            if self._mission.is_followed:
                self._transmit(now, dialect.MAVLink_mission_item_reached_message(guide.last_passed))
                self._transmit(now, self._mission.message())

    def _track_alarms(self, now: float) -> list[Sample]:
        """Return word of what the route's guide has to say, and of its end: the pilot carries it on as an alarm."""
        alarm = self._mission.guide.alarm
        if alarm == self._track_alarm:
            return []
        self._track_alarm = alarm
        return [AlarmSample(now, alarm, TRACK_SOURCE)]

    def _file_transfer(self, now: float, message: Message) -> None:
        """Refuse: there are no files, and who asks falls back on plain messages."""
        request = bytes(message.payload)
        reply = bytearray(251)
        reply[0:2] = ((int.from_bytes(request[0:2], "little") + 1) & 0xFFFF).to_bytes(2, "little")
        reply[2], reply[3], reply[4], reply[5], reply[12] = request[2], FILE_NAK[0], 1, request[3], FILE_NAK[1]
        sender = (message.get_srcSystem(), message.get_srcComponent())
        self._transmit(now, dialect.MAVLink_file_transfer_protocol_message(0, *sender, list(reply)))

    def _transmit(self, now: float, message: Message) -> None:
        packet = self._codec.encode(message)
        if self._sent(packet):
            self._packets.append((now, packet))
        else:
            self.dropped += 1

    def _sent(self, packet: bytes) -> bool:
        """A ground station that is gone is no reason to stop steering: `receive` tells of it."""
        try:
            return not self._lost and self._transport.send(packet)
        except LinkError:
            return False


def _percent(running: LongCommand) -> int:
    return round(100.0 * running.run.progress)


def _whole(value: float) -> int:
    return int(value) if math.isfinite(value) and value == int(value) else -1
