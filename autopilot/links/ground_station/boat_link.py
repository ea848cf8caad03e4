"""A `Link` to ground stations that see the running pilot as a surface boat. No samples come of it, no rudder moves."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.alarm_outputs import StatusTexts, severity_of
from autopilot.links.base import UNSEEN, AlarmNews, Backlog, Transport
from autopilot.links.ground_station.access import LinkAccess, StationLink, refused_senders_of
from autopilot.links.ground_station.commands import ACCEPTED, DENIED, IN_PROGRESS, OVERBOARD, REJECTED, Commands
from autopilot.links.ground_station.file_server import (
    ALARMS,
    COMPASSES,
    ROUTE,
    Content,
    alarm_list,
    compass_list,
    route_list,
)
from autopilot.links.ground_station.orders import (
    MANUAL,
    OF_A_ROUTE,
    VOIDING,
    OrderSequence,
    confirmation_of,
    disarms,
    gives_rudder_back,
    is_order,
    may_engage,
    stands_by,
)
from autopilot.links.ground_station.station_service import ParameterServer, StationService
from autopilot.links.ground_station.telemetry import Telemetry
from autopilot.links.mavlink.codec import MavlinkCodec, Message
from autopilot.links.mavlink.requests import STATES
from autopilot.links.mavlink.signing import UNSIGNED, WRONG_KEY, LinkSigning
from autopilot.links.transports.medium import peer_of
from autopilot.links.url import accept_signed
from autopilot.signals import AlarmEvent, AlarmState, ConditionSample, Mode, OrderKind, Sample, Tick
from autopilot.supervision.panel import sentence_of

COMPONENT = 1
HEARTBEAT_S = 1.0
MESSAGES_PER_TURN = 100
"""Messages heeded in one turn of the loop; what a flood brings beyond them is dropped."""
FLOOD_OVER_S = 5.0
SEVERITIES = {Mode.FAILSAFE: dialect.MAV_SEVERITY_CRITICAL, Mode.FAULT: dialect.MAV_SEVERITY_ALERT}
REFUSAL_S = 60.0
REFUSAL = "refused: messages that are not signed with our key"
NOT_ALLOWED = "refused: a system id that is not allowed"
STOPPED_S = 30.0
LOOKING_ONLY = "no orders without a signing key over this link: set a key, or allow security.orders_without_key"
CAME_LATE = "orders from while this computer stood still are not carried out: order again"
OVERTAKEN = "an order from before the one to stand by came behind it and is not carried out: order again"
VALUE_OVERTAKEN = "came behind the value that was set after it and is not set: set it again if you still want it"
ROUTE_OVERTAKEN = "a change of the route came behind the one sent after it and is not made: look at the route"
SHARED = (
    "two ground stations have the id {}.{}: orders of one are taken for the other's, and some refused; give each an id "
    "of its own"
)
STOP_REFUSED = "not standing by: the skipper has engaged again since you asked; ask at the helm, or set a signing key"


class _Notice:
    """An alarm of a link's own: it begins when something happens, and ends a while after that has happened last."""

    def __init__(self, name: str, link: str) -> None:
        self._name, self._news = name, AlarmNews(f"{link} {name}")
        self._last = -math.inf
        self._event = AlarmEvent(name)
        self._is_on = False

    def happened(self, now: float, detail: str) -> None:
        """Note that it has happened at `now` [s]; the detail of the first is said until the alarm ends."""
        if not self._is_on:
            self._event = AlarmEvent(self._name, detail)
        self._last = now

    def news(self, now: float, tick: Tick | None, until_acknowledged: bool = False) -> list[Sample]:
        """Return the alarm where it begins, and its end; `until_acknowledged`: none before somebody has acknowledged
        it."""
        is_on = now - self._last < STOPPED_S or (self._is_on and until_acknowledged and not self._is_acknowledged(tick))
        self._is_on = is_on
        return self._news.of(now, self._event if is_on else None)

    def _is_acknowledged(self, tick: Tick | None) -> bool:
        shown = () if tick is None else zip(tick.alarms, tick.alarm_states, strict=False)
        return (*self._event[:2], AlarmState.ACKNOWLEDGED) in [(*event[:2], state) for event, state in shown]


def counts_late(message: Message) -> bool:
    """Return whether an order counts however late it comes: to give the rudder back, and a man overboard."""
    return gives_rudder_back(message) or getattr(message, "command", None) == OVERBOARD


class BoatLink(StationLink):
    """One ground station's side: heartbeat, telemetry, parameters, commands, texts, under system `system`.

    `signing`: everything sent is signed, and nothing is obeyed that is not.
    `access`: which system ids are heard, and how much; None: all of them, at the usual rates.
    What describes our parameters is served over MAVLink FTP, and so are the alarms.

    A station that gives no orders on this link may let the pilot stand by: taking the helm away needs no leave, the
    first time (`access.Stops`).
    """

    def __init__(
        self,
        transport: Transport,
        commands: Commands,
        parameters: ParameterServer,
        system: int = 1,
        signing: LinkSigning | None = None,
        access: LinkAccess | None = None,
    ) -> None:
        super().__init__(transport, signing is not None, access)
        self._commands = commands
        self._signing = signing
        self._codec = MavlinkCodec(system, COMPONENT, transport.is_stream, signing)
        accept_signed(transport, signing, self._hears)
        self._telemetry = Telemetry(commands.mission, commands.tuner, commands.wind, commands.instruments)
        self._texts = StatusTexts()
        compasses = commands.instruments.compasses
        files: dict[str, Content] = {
            ALARMS: self._alarm_file,
            ROUTE: lambda: route_list(commands.mission.route),
            COMPASSES: lambda: compass_list(compasses.compasses(self._backlog.looked) if compasses is not None else ()),
        }
        self._service = StationService(
            commands, parameters, self._telemetry, self._texts, {**parameters.files, **files}
        )
        self._next_heartbeat, self._mode_said = -math.inf, MANUAL
        self._refusals: dict[str, float] = {}
        self._alarms: tuple[AlarmEvent, ...] = ()
        self._flooded = -math.inf
        self._sequence = OrderSequence(self._access.orders)
        self._backlog = Backlog()
        self._says_flooded = False
        self._stopped, self._stop_refused = _Notice("station_stopped", self.name), _Notice("stop_refused", self.name)

    def receive(self, now: float) -> list[Sample]:
        """Answer what has arrived by `now` [s]. Nothing comes from a station but word of its loss, and of a flood."""
        heeded = 0
        refused = self._codec.refused
        if self._access.crowded:
            self._flooded = now
            return []  # looked at after the next command has left
        self._backlog.on_receive(now)
        dropped = refused_senders_of(self._transport)
        chunks, word = self._arrived(now, "station_lost")
        if word:
            return word
        for data in self._access.taken(now, chunks):
            for message in self._codec.decoded([data]):
                heeded += 1
                if heeded > MESSAGES_PER_TURN:
                    self.dropped += 1
                    self._flooded = now
                elif self._access.lets_in_system(message.get_srcSystem()):
                    may_order = self._hears(message)
                    if may_order:
                        self._presence.on_packet(now, message.get_type() == "HEARTBEAT")
                    self._packets.append((now, bytes(message._msgbuf)))
                    self._on_message(now, message)
                    if may_order and message.get_type() == "HEARTBEAT" and self._sequence.are_two(now, message):
                        self._refuse(now, SHARED.format(message.get_srcSystem(), message.get_srcComponent()))
                else:
                    self._refuse(now, NOT_ALLOWED)
        self._access.count_refused_senders(refused_senders_of(self._transport) - dropped)
        if self._signing is not None and self._codec.refused > refused:
            reason = self._signing.signing.last_refusal
            self._refuse(now, REFUSAL if reason in (UNSIGNED, WRONG_KEY) else f"refused: messages {reason}")
        tick = self._telemetry.tick
        return [
            *self._flood(now),
            *self._stopped.news(now, tick, until_acknowledged=True),
            *self._stop_refused.news(now, tick),
            *(self._presence.update(now) if not self.lost else []),
        ]

    def _flood(self, now: float) -> list[Sample]:
        """Return word of a flood that has begun, or is over for some seconds."""
        is_flooded = now - self._flooded < FLOOD_OVER_S
        if is_flooded == self._says_flooded:
            return []
        self._says_flooded = is_flooded
        return [ConditionSample(now, "link_flooded", is_flooded, self.name if is_flooded else "", self.name)]

    def _on_message(self, now: float, message: Message) -> None:
        self._sequence.heard(now, message)
        if not self._is_for_us(message):
            return
        refusal = self._access.refusal(now, message)
        if refusal:
            self._refuse(now, refusal)
        elif self._backlog.has(now) and is_order(message) and not counts_late(message):
            self._transmit(now, *self._put_off(now, message, CAME_LATE))
        elif not is_order(message):
            self._transmit(now, *self._service.take(now, message))
        elif self.takes_orders:
            self._transmit(now, *self._carry_out(now, message))
        elif stands_by(message):
            self._transmit(now, *self._stop(now, message))
        else:
            self._transmit(now, *self._deny(now, message, LOOKING_ONLY))

    def _carry_out(self, now: float, message: Message) -> list[Message]:
        """Carry an order out, once, unless its sender has given the rudder back since; return the answer."""
        stop, giver = self._commands.last_stop, (self, message.get_srcSystem(), message.get_srcComponent())
        kind = message.get_type()
        if not counts_late(message):
            if self._sequence.is_overtaken(now, message):
                if kind in OF_A_ROUTE:
                    self._put_off(now, message, ROUTE_OVERTAKEN)
                    return []  # its answer would be taken for one to what was sent after it
                value = f"a value of {message.param_id} {VALUE_OVERTAKEN}" if kind == "PARAM_SET" else ""
                return self._put_off(now, message, value or OVERTAKEN)
            if self._sequence.is_again(now, message):
                running = self._commands.running
                is_it = running is not None and running.command == getattr(message, "command", None)
                return self._service.answered(message, running.result if running is not None and is_it else ACCEPTED)
            seen_by = giver if self._sequence.has_seen_stop(now, message) else None
            if may_engage(message) and stop.is_unseen(now, seen_by, confirmation_of(message)):
                return self._put_off(now, message, UNSEEN)
        answers = self._service.take(now, message)
        if kind in VOIDING or any(getattr(answer, "result", None) in (ACCEPTED, IN_PROGRESS) for answer in answers):
            self._sequence.taken(now, message)
        if answers and gives_rudder_back(message):
            stop.ordered(now, giver)
            self._sequence.stopped(message)
        return answers

    def _stop(self, now: float, message: Message) -> list[Message]:
        """Let the pilot stand by for a station that only looks, where it may, and say who it was; return the answer."""
        stops, sender = (
            self._access.stops,
            f"system {message.get_srcSystem()} at {peer_of(self._transport) or self.name}",
        )
        if stops.obeys(now):
            self._stopped.happened(now, sender)
            self._commands.last_stop.ordered(now, sender)
            return self._service.take(now, message)
        if stops.keeps(now):
            self._stop_refused.happened(now, sender)
            return self._deny(now, message, STOP_REFUSED)
        # nothing is steered: no new order comes of it, which would acknowledge what sounds
        if disarms(message) and self._commands.armed:
            if not stops.has_just_obeyed(now):
                return self._deny(now, message, LOOKING_ONLY)
            self._commands.armed = False
        return self._service.answered(message, ACCEPTED)

    def _put_off(self, now: float, message: Message, reason: str) -> list[Message]:
        """Refuse what may be ordered again; each who does hears why."""
        self._texts.send_text(now, dialect.MAV_SEVERITY_WARNING, reason, is_answer=True)
        return self._service.answered(message, REJECTED)

    def _deny(self, now: float, message: Message, reason: str) -> list[Message]:
        self._refuse(now, reason)
        return self._service.answered(message, DENIED)

    def _refuse(self, now: float, reason: str) -> None:
        if now >= self._refusals.get(reason, -math.inf):
            self._refusals[reason] = now + REFUSAL_S
            self._texts.send_text(now, dialect.MAV_SEVERITY_WARNING, reason)

    def release(self, now: float) -> None:
        """Say that we go, so that nobody waits for us; never raises."""
        self._heartbeat(now, dialect.MAV_STATE_POWEROFF)

    def publish_tick(self, tick: Tick) -> None:
        """Send the telemetry that falls due with `tick`, and say every new alarm as STATUSTEXT.

        A flood that was looked away from may wake the loop again.
        """
        self._access.stops.ticked(tick.now, tick.order.kind is not OrderKind.STANDBY)
        self._commands.last_stop.on_tick(tick)
        self._telemetry.take(tick)
        self._transmit(tick.now, *self._service.passed(), *self._telemetry.due(tick.now))
        self._access.crowded = False
        for alarm in tick.alarms:
            if alarm not in self._alarms:
                severity = severity_of(alarm, SEVERITIES.get(tick.mode, dialect.MAV_SEVERITY_WARNING))
                self._texts.send_text(tick.now, severity, sentence_of(alarm))
        self._alarms = tick.alarms

    def poll(self, now: float) -> None:
        """Send heartbeat, at once where the mode has changed, texts and the next of a parameter list."""
        tick = self._telemetry.tick
        if now >= self._next_heartbeat or self._mode_said != self._mode():
            self._next_heartbeat = now + HEARTBEAT_S
            self._heartbeat(now, STATES[tick.mode] if tick is not None else dialect.MAV_STATE_BOOT)
        self._transmit(now, *self._service.due(now), *self._texts.due(now))

    def _alarm_file(self) -> bytes:
        tick = self._telemetry.tick
        return alarm_list(tick.alarms, tick.alarm_states) if tick is not None else alarm_list((), ())

    def _heartbeat(self, now: float, state: int) -> None:
        tick = self._telemetry.tick
        engaged = tick is not None and tick.mode is Mode.ENGAGED
        flags = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        flags |= dialect.MAV_MODE_FLAG_AUTO_ENABLED if engaged else dialect.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
        if engaged or self._commands.armed:
            flags |= dialect.MAV_MODE_FLAG_SAFETY_ARMED
        self._mode_said = self._mode()
        message = dialect.MAVLink_heartbeat_message(
            dialect.MAV_TYPE_SURFACE_BOAT, dialect.MAV_AUTOPILOT_GENERIC, flags, self._mode_said, state, 3
        )
        self._transmit(now, message)

    def _mode(self) -> int:
        tick = self._telemetry.tick
        return self._telemetry.mode(tick) if tick is not None else MANUAL

    def _hears(self, message: Message) -> bool:
        """Take note of who says what; return whether it may be a station's: our own identity is nobody else's."""
        ours = (self._codec.system, COMPONENT)
        return super()._hears(message) and (message.get_srcSystem(), message.get_srcComponent()) != ours

    def _is_for_us(self, message: Message) -> bool:
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        return system in (0, self._codec.system) and component in (0, COMPONENT)

    def _transmit(self, now: float, *messages: Message) -> None:
        for message in messages:
            packet = self._codec.encode(message)
            if self._sent(packet):
                self._packets.append((now, packet))
            else:
                self.dropped += 1
