"""The session of a companion computer with an ArduRover boat, or PX4's: attitude and speed in, rudder out.

Bytes in, typed samples out; commands in, bytes out. The session owns no transport, clock or thread, and never raises;
`CompanionLink` carries its bytes over a transport.

It latches on to one autopilot and hears no other, carries that vehicle's system id with component 191, touches
the steering channel alone, and says in one sentence when the vehicle does not let it steer.
"""

from __future__ import annotations

import math
from collections import deque

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.alarm_outputs import StatusTexts, VehicleSounder, severity_of
from autopilot.links.base import CarriedLink, LinkError, Transport
from autopilot.links.mavlink.authority import HEARTBEAT_TIMEOUT_S, NOT_HEARD
from autopilot.links.mavlink.codec import MavlinkCodec, Message, message_id
from autopilot.links.mavlink.conditions import ModeHandover, OtherPilot
from autopilot.links.mavlink.frames import SIGNED
from autopilot.links.mavlink.overrides import OverrideRelease, Stage
from autopilot.links.mavlink.requests import (
    AUTOPILOT_COMPONENT,
    OVERRIDE_TIME,
    OVERRIDE_TIME_S,
    STATES,
    VehicleParameters,
    companion_heartbeat,
    interval_request,
    obstacle_of,
    parameter_request,
    station_heartbeat,
)
from autopilot.links.mavlink.signing import CURES, LinkSigning
from autopilot.links.mavlink.steering import SteeringOutput
from autopilot.links.mavlink.vehicle import ATTITUDE, HEARTBEAT, CompanionSettings, VehicleReader
from autopilot.links.rudder_order import LEAVING_S, Release, ReleaseState, not_held
from autopilot.links.url import let_in
from autopilot.models.drives import Mixing
from autopilot.signals import (
    AlarmEvent,
    AlarmSample,
    HelmCause,
    HelmSample,
    Mode,
    RudderCommand,
    Sample,
    ThrusterSample,
    Tick,
)
from autopilot.supervision.panel import sentence_of
from autopilot.supervision.supervisor import waits_to_engage

COMPONENT = 191
"""MAV_COMP_ID_ONBOARD_COMPUTER."""
DEFAULT_GCS = 255
HEARTBEAT_S = 1.0
SILENT_PEER_S = 5.0
"""A sender without a word of the vehicle for this long gives up its place on a link that listens."""
JUDGE_S = 0.05
"""Silence is judged this often; all else when the message comes that may change our right to steer."""
PACKETS_KEPT = 20000
RELEASE_AGAIN_S = 0.2
SILENCE_S = 1.0
"""Not looked at for longer, the line may hold messages that are as old: as far as the vehicle's clock may go back."""
WITHOUT_RECEIVER = (
    "the rudder was ordered amidships first, where it stays: without a radio receiver the flight controller keeps "
    "the last input"
)
NO_AUTOPILOT = ", which is no autopilot"
UNSIGNED_ORDERS = " (it signs its messages: without --signing-key it may take none of ours)"
SEVERITIES = {
    Mode.STANDBY: dialect.MAV_SEVERITY_NOTICE,
    Mode.ENGAGED: dialect.MAV_SEVERITY_WARNING,
    Mode.OVERRIDE: dialect.MAV_SEVERITY_WARNING,
    Mode.FAILSAFE: dialect.MAV_SEVERITY_CRITICAL,
    Mode.FAULT: dialect.MAV_SEVERITY_ALERT,
}


class CompanionSession:
    """What is said with one vehicle. ValueError where the settings cannot be. Times in s.

    Args:
        name: of the line, in samples.  is_stream: whether chunks may split frames anywhere.
        signing: everything sent is signed, and nothing is heard that is not.
        sounder: has alarms heard at the vehicle.

    Attributes:
        state: MAV_STATE in our heartbeat.
        packets: (time, raw packet) of what has been received; who carries the bytes adds what was sent, and empties it.
        vehicle: system id of the vehicle latched on to, 0 before its heartbeat.
        received_time: when the vehicle last sent anything, -inf before it has.
        is_gone: whether the line was found broken; who carries the bytes says so.
    """

    def __init__(
        self,
        name: str,
        settings: CompanionSettings,
        is_stream: bool = False,
        signing: LinkSigning | None = None,
        sounder: VehicleSounder | None = None,
    ) -> None:
        self.name = name
        self.state: int = dialect.MAV_STATE_STANDBY
        self.packets: deque[tuple[float, bytes]] = deque(maxlen=PACKETS_KEPT)
        self.vehicle = 0
        self.received_time = -math.inf
        self.is_gone = False
        self._settings = settings
        self._signing = signing
        self._refused_before = 0
        self._it_signs = False
        self._sounder = sounder
        self._codec = MavlinkCodec(settings.vehicle_system or 1, COMPONENT, is_stream, signing)
        self._gcs_codec = MavlinkCodec(
            settings.gcs_system or DEFAULT_GCS, dialect.MAV_COMP_ID_MISSIONPLANNER, signing=signing
        )
        self._steering_codec = self._gcs_codec if settings.as_gcs else self._codec
        self._output = SteeringOutput(
            settings.method,
            settings.rudder_at_full,
            settings.reversed,
            settings.servo_us,
            settings.angle_max,
            Mixing(exponent=settings.thrust_exponent, astern_share=settings.astern_share),
        )
        self._reader = VehicleReader(self._output, settings)
        self._authority, self._probe = self._reader.authority, self._reader.probe
        self._guided, self._release = self._reader.guided, self._reader.release
        self._other = OtherPilot(settings.with_other_pilot)
        self._handover = ModeHandover(settings.handover_mode) if settings.handover_mode is not None else None
        self._texts = StatusTexts()
        self._next_heartbeat = -math.inf
        self._helm: HelmSample | None = None
        self._reason = self._authority.obstacle
        self._judge_at = -math.inf
        self._looked_at = math.inf
        self._may_prove = self._is_deaf = False
        self._heard_instead = -math.inf, 0
        """When [s] the heartbeat of another vehicle came last, and its system id."""
        self._revision, self._steers_as = (-1, 0), 0
        self._mode = Mode.STANDBY
        self._alarms: tuple[AlarmEvent, ...] = ()
        parts = ("other pilot", "attitude rate", "attitude age", "line", "guided", "servo")
        self._noted: dict[str, AlarmEvent | None] = dict.fromkeys(parts)
        self._bow = "", ""
        if self._reader.bow is not None:
            self._noted["bow thruster"] = None
        self._leaving: float | None = None
        self._next_release, self._released_at = -math.inf, math.inf
        self._has_steered = self._is_boat = False
        self._marking: Message | None = None

    @property
    def parameters(self) -> VehicleParameters:
        """The vehicle's parameters on the way from steering input to rudder, as far as they have come."""
        return self._reader.parameters

    @property
    def awaits_rate(self) -> bool:
        """Whether it is still open if the vehicle sends headings at the rate asked for."""
        return self._reader.streams.is_open

    def carry(self, bytes_per_s: float) -> None:
        """Take what the line carries, inf where nobody knows."""
        self._reader.streams.carry(bytes_per_s)

    @property
    def bad_packets(self) -> int:
        """Runs of received bytes that were no valid MAVLink."""
        return self._codec.bad

    def receive(self, now: float, chunks: list[bytes]) -> list[Sample]:
        """Take what has arrived by `now`, datagrams or pieces of a stream, and return the samples in it.

        A HelmSample comes first, whenever our right to steer or the reason against it has changed, and again
        with every heartbeat of the vehicle.
        """
        reader, authority, vehicle = self._reader, self._authority, self.vehicle
        if now - self._looked_at > SILENCE_S:
            reader.silence()
        self._looked_at = now
        patience = reader.parameters.patience if self._guided is None else self._guided.timeout
        if authority.steering and now - authority.last_command > patience:
            authority.let_go(now)
        samples: list[Sample] = []
        beat = authority.heartbeat_time
        news = now >= self._judge_at
        messages = self._codec.decoded(chunks)
        for message in messages:
            self.packets += ((now, bytes(message._msgbuf)),)
            header = message._header
            if vehicle and header.srcSystem == vehicle and header.srcComponent == AUTOPILOT_COMPONENT:
                reader.take(now, message, samples)
                news = news or header.msgId != ATTITUDE
                if header.msgId == HEARTBEAT:
                    self._it_signs = bool(header.incompat_flags & SIGNED)
            elif header.msgId == HEARTBEAT and self._is_ours(message) and self._is_vacant(now, message):
                vehicle = self._latch(message)
                reader.take(now, message, samples)
                news = True
            else:
                self._other.take(now, message)
                authority.another_steers = self._other.steers
        self.received_time = authority.received_time
        if authority.heartbeat_time != beat:
            self._helm = None
        if news or not authority.booted:
            self._judge_at = now + JUDGE_S
            self._judge(now, samples)
        if reader.health.said:
            samples.extend(reader.health.pass_time(now))
        if self._handover is not None:
            samples.extend(self._handover.seen(now, authority.mode, self.name))
        return samples

    def send(self, now: float, command: RudderCommand) -> list[bytes]:
        """Return the packets of a rudder command; where it is not engaged or control is not ours, of the release.

        A vehicle that steers itself is sent nothing here: see `on_tick`.
        """
        if not command.engaged:
            self._authority.stood_still = 0.0
        if self._probe.message is not None or self._guided is not None:
            return []
        output = self._output
        message = output.steer(now, command.angle, command.thruster) if command.engaged and not self._reason else None
        if message is not None:
            self._authority.commanded(now, output.commanded_pulse)
            self._release.ordered(now, output.commanded_pulse)
            self._has_steered = True
            if self._reader.bow is not None:
                self._reader.bow.sent(now)
        else:
            self._authority.released()
            message = output.release(now)
            self._asked(now)
        return [] if message is None else [self._steering_codec.encode(message)]

    def on_tick(self, tick: Tick) -> list[bytes]:
        """Return the heading target that is due behind `tick` where the vehicle steers itself.

        Keeps the state in our heartbeat honest, and queues every new alarm as STATUSTEXT.
        """
        now, mode, alarms = tick.now, tick.mode, tick.alarms
        if mode is not self._mode or alarms != self._alarms:
            self._mode, self.state = mode, STATES[mode]
            self._other.publish_status(now, mode, alarms)
        if self._handover is not None:
            self._handover.publish_status(now, mode)
        if alarms != self._alarms:
            for alarm in alarms:
                if alarm not in self._alarms:
                    self._texts.send_text(now, severity_of(alarm, SEVERITIES[mode]), sentence_of(alarm))
            self._alarms = alarms
        if self._sounder is not None:
            self._sounder.publish_tick(tick)
        if mode is not Mode.ENGAGED and not self._authority.steering:
            self._probe.wanted(waits_to_engage(tick))
        target = self._guided.next_target(tick, self._may_prove) if self._guided is not None else None
        return [] if target is None else [self._steering_codec.encode(target)]

    def poll(self, now: float) -> list[bytes]:
        """Return what falls due: heartbeats, repeated commands, stream and parameter requests, texts."""
        sent: list[bytes] = []
        if now >= self._next_heartbeat:
            self._next_heartbeat = now + HEARTBEAT_S
            sent.append(self._codec.encode(companion_heartbeat(self.state)))
            if self._settings.as_gcs:
                sent.append(self._gcs_codec.encode(station_heartbeat()))
        if not self.vehicle:
            return sent
        proves = self._may_prove and self._guided is None and self._probe.stage is not Stage.PASSED
        due = self._probe.due(now) if proves else None
        if due is not None:
            self._release.ordered(now, self._probe.pulse)
        elif self._probe.message is None and self._authority.last_command < now:
            due = self._output.repeat(now, self._settings.command_rate_hz)
        if due is not None:
            sent.append(self._steering_codec.encode(due))
        return sent + self._beside_steering(now)

    def _beside_steering(self, now: float) -> list[bytes]:
        """Return the requests, the mode of a fail-safe, the sound of an alarm, word to another pilot, texts."""
        asked: list[Message] = []
        vehicle, is_up = self.vehicle, self._authority.booted
        streams = self._reader.streams
        if is_up and now - streams.checked_at >= streams.pause:
            asked += [interval_request(vehicle, *stream) for stream in streams.due(now)]
        parameters = self._reader.parameters
        if is_up and (parameters.to_ask or now >= parameters.next_again):
            names = parameters.due(now) if parameters.to_ask else parameters.again(now)
            asked += [parameter_request(vehicle, name) for name in names]
        for aside in (self._handover, self._sounder):
            if aside is not None:
                asked += aside.due(now, vehicle)
        sent = [self._steering_codec.encode(message) for message in asked] if asked else []
        if is_up and now >= self._other.due_at and (news := self._other.due(now)) is not None:
            sent.append(self._codec.encode(news))
            self._other.sent(sent[-1])
        if self._texts.waiting:
            sent += [self._codec.encode(text) for text in self._texts.due(now)]
        return sent

    def release(self, now: float) -> list[bytes]:
        """Return what gives the rudder back, several times over."""
        self._authority.released()
        self._leaving, self._released_at = now, math.inf
        if self._guided is not None:
            return [self._steering_codec.encode(message) for message in self._guided.parting(now)]
        amidships = self._output.amidships() if self._is_held(now) and self._reader.lacks_receiver else None
        if amidships is None:
            return self._releases(now)
        self._asked(now)
        self._marking, pulse = amidships
        self._release.mark(now, pulse)
        return self._released_again(now)

    def release_result(self, now: float) -> Release | list[bytes]:
        """Return what became of the rudder after `release`; while the vehicle's reports may still show it, what is to
        be sent to find out."""
        shown_by = self._shown_by
        self._leaving = now if self._leaving is None else self._leaving
        if self._guided is not None:
            return self._guided.release(now, self.name)
        if shown_by and self._has_steered:
            return Release(self.name, ReleaseState.CONFIRMED, shown_by)
        if not self._is_held(now):
            return not_held(self.name)
        if self.is_gone:
            return Release(self.name, ReleaseState.LOST, lapse=self._lapse())
        waited = now - self._leaving
        if self._reader.lacks_receiver and now - self._released_at > LEAVING_S:
            return Release(self.name, ReleaseState.UNSHOWN, lapse=WITHOUT_RECEIVER)
        if waited > max(release.patience for release in self._releases_held):
            return Release(self.name, ReleaseState.UNCONFIRMED, waited=waited, lapse=self._lapse())
        return self._released_again(now)

    def holds_our_vehicle(self, datagram: bytes) -> bool:
        """Return whether a datagram has the heartbeat of a vehicle that we may latch on to."""
        messages = MavlinkCodec(signing=self._signing and self._signing.observer()).decode(datagram)
        return any(message_id(message) == HEARTBEAT and self._is_ours(message) for message in messages)

    def _released_again(self, now: float) -> list[bytes]:
        """Repeat what a bad line may have lost; where no report can tell a release, mark the input and release it."""
        beside = self._release.wants_mark(now)
        found = self._output.unmoving(beside) if beside is not None and self._authority.steers_by_hand else None
        if found is not None:
            self._marking, pulse = found
            self._release.mark(now, pulse)
        if self._marking is not None and self._release.mark_due(now):
            return [self._steering_codec.encode(self._marking)]
        if now >= self._next_release and not self._release.is_marking(now):
            return self._releases(now)
        return []

    def _releases(self, now: float) -> list[bytes]:
        self._next_release = now + RELEASE_AGAIN_S
        self._released_at = min(self._released_at, now)
        burst = self._output.release_burst()
        self._asked(now)
        return [self._steering_codec.encode(message) for message in burst]

    def _asked(self, now: float) -> None:
        """Take that the release of all that was overridden has been sent."""
        self._release.asked(now)
        if self._reader.bow is not None:
            self._reader.bow.let_go(now)

    @property
    def _releases_held(self) -> list[OverrideRelease]:
        """What was overridden at all: the steering, and a bow thruster's channel."""
        bow = self._reader.bow
        return [self._release] if bow is None or not bow.release.has_ordered else [self._release, bow.release]

    @property
    def _shown_by(self) -> str:
        """What has shown that nothing is overridden any more; '' where something still may be."""
        shown = [release.shown_by for release in self._releases_held]
        return shown[0] if all(shown) else ""

    def _is_held(self, now: float) -> bool:
        override_time = self._reader.parameters.override_time
        seconds = OVERRIDE_TIME_S if override_time is None else override_time
        return any(release.is_held(now, seconds) for release in self._releases_held)

    def _lapse(self) -> str:
        override_time = self._reader.parameters.override_time
        if override_time is not None and override_time < 0.0:
            return f"{OVERRIDE_TIME} is {override_time:g}, so the flight controller keeps it; switch the vehicle's mode"
        seconds = OVERRIDE_TIME_S if override_time is None else override_time
        return f"the flight controller lets go by itself after {OVERRIDE_TIME} {seconds:g} s"

    def _is_ours(self, message: Message) -> bool:
        """Return whether a heartbeat is of a vehicle that may be ours; who it is of, while we wait for one, is said: of
        several the first that is an autopilot."""
        header, wanted, authority = message._header, self._settings.vehicle_system, self._authority
        if message.autopilot == dialect.MAV_AUTOPILOT_INVALID:
            strange = NO_AUTOPILOT
        elif header.srcSystem == 0:
            strange = ": no vehicle may have the system id 0: set MAV_SYSID (SYSID_THISMAV) to 1"
        elif wanted not in (None, header.srcSystem):
            strange = f": start with --vehicle-system {header.srcSystem} to steer it"
        elif header.srcComponent != AUTOPILOT_COMPONENT:
            strange = ": an autopilot is component 1: set its MAV_COMP_ID to 1"
        else:
            return True
        names_none = authority.obstacle.endswith(NO_AUTOPILOT) and strange != NO_AUTOPILOT
        if not self.vehicle and (authority.obstacle == NOT_HEARD or names_none):
            authority.obstacle = (
                f"{NOT_HEARD}; heard is system {header.srcSystem}, component {header.srcComponent}{strange}"
            )
        return False

    def _is_vacant(self, now: float, message: Message) -> bool:
        """Return whether a heartbeat's vehicle may be latched on to.

        It is the first, or a boat, where the one before is none or fell silent before its parameters had come: that
        was never ours.
        """
        if not self.vehicle:
            return True
        silence = now - self._authority.heartbeat_time
        gives_way = (self._authority.obstacle and not self._is_boat) or (
            silence > HEARTBEAT_TIMEOUT_S and not self._reader.parameters.complete and not self._has_steered
        )
        is_vacant = bool(gives_way) and not obstacle_of(message.autopilot, message.type, self._reader.is_px4)
        if not is_vacant:
            self._heard_instead = now, message._header.srcSystem
        return is_vacant

    def _latch(self, message: Message) -> int:
        if self.vehicle:
            self._reader.another()
        self._is_boat = not obstacle_of(message.autopilot, message.type, self._reader.is_px4)
        self.vehicle = self._output.target = self._codec.system = message._header.srcSystem
        if self._guided is not None:
            self._guided.target = self.vehicle
        return self.vehicle

    @property
    def _is_disobeyed(self) -> bool:
        """Whether the vehicle does not do what we order."""
        return bool(self._authority.disobeyed) or self._probe.stage is Stage.NOT_TAKEN

    def _with_signing(self, reason: str) -> str:
        """Return the reason why a vehicle that signs does not obey us, with word of that where we do not."""
        if self._signing is not None:
            return reason
        return reason + UNSIGNED_ORDERS if self._is_disobeyed or self._reader.parameters.unanswered else reason

    def _obstacle(self, now: float) -> str:
        """Return what the vehicle, or another pilot, has against our steering; '' for nothing."""
        authority = self._authority
        obstacle = authority.reason(now, self._reader.parameters, self._steers_as)
        if obstacle and authority.cause is HelmCause.SILENT and now - self._heard_instead[0] < SILENT_PEER_S:
            other = self._heard_instead[1]
            obstacle += f"; system {other} is heard: if that is this boat, start with --vehicle-system {other}"
        if self._signing is not None and (signing := self._signing.signing).refused:
            if not obstacle or authority.cause is not HelmCause.SILENT:
                self._refused_before = signing.refused.total()
            elif signing.refused.total() > self._refused_before:
                obstacle += f"; what comes is {signing.last_refusal}: {CURES[signing.last_refusal]}"
        return obstacle or ("" if authority.steering else self._other.obstacle(now))

    def _cause(self, has_obstacle: bool, unproved: str, waits: str) -> HelmCause:
        """Return what kind the reason is of; behind a fail-safe too nobody has taken a helm that is not proved yet, or
        waits for headings."""
        if has_obstacle:
            return self._authority.cause
        if self._guided is None and self._probe.stage in (Stage.GROWN_OLD, Stage.CHECKING):
            return HelmCause.UNPROVEN
        return HelmCause.UNREADY if waits and not unproved else self._authority.cause

    def _judge(self, now: float, samples: list[Sample]) -> None:
        """Work out whether control is ours, and put word of a change before the other samples, of alarms behind."""
        reader, authority, is_beat = self._reader, self._authority, self._helm is None
        if self._revision != (reader.parameters.revision, self.vehicle):
            self._revision = reader.parameters.revision, self.vehicle
            if self._settings.as_gcs and self._settings.gcs_system is None:
                self._gcs_codec.system = reader.parameters.gcs_system or DEFAULT_GCS
            self._steers_as = self._steering_codec.system
        obstacle = self._obstacle(now)
        proof = self._probe if self._guided is None else self._guided
        if authority.disobeyed or obstacle:
            proof.reset()
        self._may_prove = not obstacle
        is_deaf = (authority.steering and bool(authority.echo.doubted)) or self._is_disobeyed
        if is_deaf and not self._is_deaf:
            reader.parameters.doubt(now)
        self._is_deaf = is_deaf
        # once we steer, the age of each heading decides
        waits = "" if authority.steering else reader.streams.waiting or self._other.waiting(now)
        reason = obstacle or proof.reason or waits
        self._reason = self._with_signing(reason) if reason and self._it_signs else reason
        cause = self._cause(bool(obstacle), proof.reason, waits) if reason else authority.cause
        if self._helm is None or (self._helm.reason, self._helm.cause) != (self._reason, cause):
            self._helm = HelmSample(now, not self._reason, self._reason, self.name, cause)
            samples.insert(0, self._helm)
        overridden = AlarmEvent("input_shared") if authority.others_override(now) else None
        by_other = self._other.alarm(now, True) if authority.steering and self._other.is_there else None
        found: dict[str, AlarmEvent | None] = {
            "other pilot": by_other or overridden,
            "attitude rate": reader.streams.slow,
            "attitude age": reader.streams.late,
            "line": reader.streams.narrow,
            "guided": self._guided.alarm if self._guided is not None else None,
            "servo": AlarmEvent("servo_changed", changed) if (changed := self._output.changed) else None,
        }
        if (bow := reader.bow) is not None:
            off, disobeyed = bow.obstacle, bow.disobeyed
            found["bow thruster"] = AlarmEvent("bow_thruster_off", off) if off and reader.parameters.complete else None
            if is_beat or (off, disobeyed) != self._bow:
                self._bow = off, disobeyed
                samples.append(ThrusterSample(now, not (off or disobeyed), self.name, disobeyed))
        if found != self._noted:
            samples += [AlarmSample(now, new, f"{self.name} {n}") for n, new in found.items() if new != self._noted[n]]
            self._noted = found


class CompanionLink(CarriedLink):
    """A `Link` to an ArduRover boat: a session carried over any transport. ValueError where the settings cannot be.

    Attributes:
        dropped: packets that the transport could not take.
    """

    def __init__(
        self,
        transport: Transport,
        settings: CompanionSettings,
        signing: LinkSigning | None = None,
        sounder: VehicleSounder | None = None,
    ) -> None:
        super().__init__(transport)
        self.session = CompanionSession(transport.name, settings, transport.is_stream, signing, sounder)
        # of a serial line it is known
        self.session.carry(getattr(transport, "bytes_per_s", math.inf))
        self.dropped = 0
        self._vacant_since: float | None = None
        # A ground station that also sends here must not take the vehicle's place.
        let_in(transport, self.session.holds_our_vehicle)

    def receive(self, now: float) -> list[Sample]:
        """Return the samples that have arrived by `now` [s]; LinkError when the transport is gone."""
        try:
            chunks = self._transport.receive()
        except LinkError:
            self.session.is_gone = True
            raise
        return self.session.receive(now, chunks)

    def send(self, now: float, command: RudderCommand) -> None:
        """Send the rudder command, or the release. LinkError when the transport is gone."""
        self._write(now, self.session.send(now, command))

    def publish_tick(self, tick: Tick) -> None:
        """Take who has the rudder and what is wrong; send the heading target that is due where the vehicle steers
        itself. LinkError when the transport is gone."""
        if packets := self.session.on_tick(tick):
            self._write(tick.now, packets)

    def poll(self, now: float) -> None:
        """Send what falls due; let go of a peer without a word of the vehicle. LinkError when the transport is gone."""
        if packets := self.session.poll(now):
            self._write(now, packets)
        heard = self.session.received_time
        if self._vacant_since is None:
            self._vacant_since = now
        elif now - self._vacant_since > SILENT_PEER_S and now - heard > SILENT_PEER_S:
            self._transport.forget_peer()
            self._vacant_since = now

    def release(self, now: float) -> None:
        """Give the rudder back, several times over; never raises."""
        self._write_last(now, self.session.release(now))

    def release_result(self, now: float) -> Release | None:
        """Return what became of the rudder after `release`, None while the vehicle's reports may still show it."""
        found = self.session.release_result(now)
        if isinstance(found, Release):
            return found
        self._write_last(now, found)
        return None

    def take_packets(self) -> list[tuple[float, bytes]]:
        """Return and forget (time [s], raw packet) of all received and sent since the last call."""
        packets = list(self.session.packets)
        self.session.packets.clear()
        return packets

    def _write(self, now: float, packets: list[bytes]) -> None:
        for packet in packets:
            if self._transport.send(packet):
                self.session.packets.append((now, packet))
            else:
                self.dropped += 1

    def _write_last(self, now: float, packets: list[bytes]) -> None:
        try:
            self._write(now, packets)
        except LinkError:
            self.session.is_gone = True  # the vehicle drops our override by its own timeout
