"""The link of a companion computer to an ArduRover boat: attitude and speed in, rudder out on the steering channel.

It latches on to one autopilot and hears no other, carries that vehicle's system id with component 191, touches
the steering channel alone, and says in one sentence when the vehicle does not let it steer.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Literal, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.alarm_outputs import VehicleSounder
from autopilot.links.base import LinkError, Transport
from autopilot.links.mavlink.authority import Stage
from autopilot.links.mavlink.codec import MavlinkCodec, Message, message_id
from autopilot.links.mavlink.conditions import OtherPilot, VehicleHealth
from autopilot.links.mavlink.guided import TIMEOUT_S, GuidedTargets
from autopilot.links.mavlink.requests import OVERRIDE_TIME, VehicleParameters
from autopilot.links.mavlink.signing import LinkSigning
from autopilot.links.mavlink.status_text import StatusTexts, severity_of
from autopilot.links.mavlink.steering import (
    AUTOPILOT_COMPONENT,
    ModeHandover,
    SteeringOutput,
    companion_heartbeat,
    interval_request,
    obstacle_of,
    parameter_request,
    station_heartbeat,
)
from autopilot.links.mavlink.vehicle import ATTITUDE, HEARTBEAT, VehicleReader
from autopilot.links.release import LEAVING_S, Release, ReleaseState, not_held
from autopilot.links.url import let_in
from autopilot.signals import AlarmEvent, AlarmSample, HelmCause, HelmSample, Mode, RudderCommand, Sample, Tick
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
OVERRIDE_TIME_S = 3.0
"""RC_OVERRIDE_TIME where the vehicle has not told it."""
UNHEARD_S = 1.0
"""Not looked at for longer, the line may hold messages that are as old: as far as the vehicle's clock may go back."""
WITHOUT_RECEIVER = (
    "the rudder was ordered amidships first, where it stays: without a radio receiver the flight controller keeps "
    "the last input"
)
STATES = {
    Mode.STANDBY: dialect.MAV_STATE_STANDBY,
    Mode.ENGAGED: dialect.MAV_STATE_ACTIVE,
    Mode.OVERRIDE: dialect.MAV_STATE_STANDBY,
    Mode.FAILSAFE: dialect.MAV_STATE_CRITICAL,
    Mode.FAULT: dialect.MAV_STATE_EMERGENCY,
}
SEVERITIES = {
    Mode.STANDBY: dialect.MAV_SEVERITY_NOTICE,
    Mode.ENGAGED: dialect.MAV_SEVERITY_WARNING,
    Mode.OVERRIDE: dialect.MAV_SEVERITY_WARNING,
    Mode.FAILSAFE: dialect.MAV_SEVERITY_CRITICAL,
    Mode.FAULT: dialect.MAV_SEVERITY_ALERT,
}


class CompanionSettings(NamedTuple):
    """How to steer one vehicle.

    rudder_at_full [rad]: rudder angle at full servo travel.  reversed: full positive steering is port.
    method: RC_CHANNELS_OVERRIDE or MANUAL_CONTROL, or headings for the firmware's own controller (guided).
    command_rate_hz: least rate at which commands are repeated.
    guided_speed_share: thrust in each heading target, a share of the vehicle's default speed.
    attitude_rate_hz: rate asked of ATTITUDE.  heading_latency [s]: age of an attitude when the vehicle stamps it.
    vehicle_system: the system id to latch on to, None for the first autopilot heard.
    as_gcs: send steering from the ground station's id; gcs_system: that id, None for what the vehicle's
    parameter says (255 until it is known).
    handover_mode: the vehicle's mode number that a fail-safe orders it into; None: none. battery_percent: a charge
    below it is an alarm.
    servo_us: servo pulses at full rudder to one side, amidships, to the other, where they are not the vehicle's end
    points and trim.  angle_max [rad]: what the rudder can do.
    with_other_pilot: engage though another pilot steers the boat.  heading_timeout [s]: age at which a heading counts
    as lost; slower ones are not engaged on.
    """

    rudder_at_full: float
    reversed: bool = False
    method: Literal["rc_override", "manual_control", "guided"] = "rc_override"
    command_rate_hz: float = 10.0
    attitude_rate_hz: float = 20.0
    heading_latency: float = 0.0
    vehicle_system: int | None = None
    as_gcs: bool = False
    gcs_system: int | None = None
    guided_speed_share: float = 0.0
    handover_mode: int | None = None
    battery_percent: float = -math.inf
    servo_us: tuple[float, float, float] | None = None
    angle_max: float = 0.0
    with_other_pilot: bool = False
    heading_timeout: float = math.inf


class CompanionLink:
    """A `Link` to an ArduRover boat over any transport. ValueError where the settings cannot be.

    `signing`: everything sent is signed, and nothing is heard that is not. `sounder`: has alarms heard at the vehicle.

    Attributes:
        state: MAV_STATE in our heartbeat; whoever runs the loop keeps it honest.
        dropped: packets that the transport could not take.
    """

    def __init__(
        self,
        transport: Transport,
        settings: CompanionSettings,
        signing: LinkSigning | None = None,
        sounder: VehicleSounder | None = None,
    ) -> None:
        self.name = transport.name
        self.state: int = dialect.MAV_STATE_STANDBY
        self.dropped = 0
        self._transport = transport
        self._settings = settings
        self._signing = signing
        self._sounder = sounder
        self._codec = MavlinkCodec(settings.vehicle_system or 1, COMPONENT, transport.is_stream, signing)
        self._gcs_codec = MavlinkCodec(
            settings.gcs_system or DEFAULT_GCS, dialect.MAV_COMP_ID_MISSIONPLANNER, signing=signing
        )
        self._steering_codec = self._gcs_codec if settings.as_gcs else self._codec
        guided = settings.method == "guided"
        self._output = SteeringOutput(
            settings.method, settings.rudder_at_full, settings.reversed, settings.servo_us, settings.angle_max
        )
        self._reader = VehicleReader(
            self._output,
            settings.attitude_rate_hz,
            settings.heading_latency,
            guided,
            settings.with_other_pilot,
            settings.heading_timeout,
        )
        self._watch, self._probe = self._reader.watch, self._reader.probe
        self._guided = GuidedTargets(self._watch, settings.guided_speed_share) if guided else None
        self._reader.guided = self._guided
        self._reader.health = VehicleHealth(settings.battery_percent)
        # A ground station that also sends here must not take the vehicle's place.
        let_in(transport, self._holds_our_vehicle)
        self._texts = StatusTexts()
        self._handover = ModeHandover(settings.handover_mode) if settings.handover_mode is not None else None
        self._vehicle = 0
        self._packets: deque[tuple[float, bytes]] = deque(maxlen=PACKETS_KEPT)
        self._next_heartbeat = -math.inf
        self._peer_heard: float | None = None
        self._helm: HelmSample | None = None
        self._reason = self._watch.obstacle
        self._judge_at = -math.inf
        self._looked_at = math.inf
        self._may_prove = False
        self._alarms: tuple[AlarmEvent, ...] = ()
        self._noted: dict[str, AlarmEvent | None] = {}
        self._start: float | None = None
        self._release = self._reader.release
        self._leaving: float | None = None
        self._next_release, self._released_at = -math.inf, math.inf
        self._is_gone = self._has_steered = False
        self._marking: Message | None = None
        self._other = OtherPilot(settings.with_other_pilot)

    @property
    def vehicle_system(self) -> int | None:
        """System id of the vehicle latched on to, None before its heartbeat."""
        return self._vehicle or None

    @property
    def vehicle_parameters(self) -> VehicleParameters:
        """The vehicle's parameters on the way from steering input to rudder, as far as they have come."""
        return self._reader.parameters

    @property
    def bad_packets(self) -> int:
        """Runs of received bytes that were no valid MAVLink."""
        return self._codec.bad

    def fileno(self) -> int:
        """Return the transport's descriptor, or -1."""
        return self._transport.fileno()

    def receive(self, now: float) -> list[Sample]:
        """Return the samples that have arrived by `now` [s]; LinkError when the transport is gone.

        A HelmSample comes first, whenever our right to steer or the reason against it has changed, and again
        with every heartbeat of the vehicle.
        """
        if now - self._looked_at > UNHEARD_S:
            self._reader.unheard()
        self._looked_at = now
        self._watch.look_back(now, self._patience())
        samples: list[Sample] = []
        heard, beat = self._watch.heard_time, self._watch.heartbeat_time
        news = now >= self._judge_at
        for data in self._arrived():
            for message in self._codec.decode(data):
                self._packets.append((now, bytes(message._msgbuf)))
                header = message._header
                if header.srcSystem == self._vehicle and header.srcComponent == AUTOPILOT_COMPONENT:
                    self._reader.take(now, message, samples)
                    news = news or message_id(message) != ATTITUDE
                elif not self._vehicle and message_id(message) == HEARTBEAT and self._is_ours(message):
                    self._latch(message)
                    self._reader.take(now, message, samples)
                    news = True
                else:
                    self._other.take(now, message)
        if self._watch.heard_time != heard:
            self._peer_heard = now
        if self._watch.heartbeat_time != beat:
            self._helm = None
        if news or not self._watch.booted:
            self._judge_at = now + JUDGE_S
            self._judge_helm(now, samples)
            overridden = AlarmEvent("input_shared") if self._watch.others_override(now) else None
            self._note(now, "other pilot", self._other.alarm(now, self._watch.steering) or overridden, samples)
            self._note(now, "attitude rate", self._reader.streams.slow, samples)
            if self._guided is not None:
                self._note(now, "guided", self._guided.alarm, samples)
        samples.extend(self._reader.health.pass_time(now))
        if self._handover is not None:
            samples.extend(self._handover.seen(now, self._watch.mode, self.name))
        return samples

    def send(self, now: float, command: RudderCommand) -> None:
        """Send the rudder command; where it is not engaged or the helm is not ours, the release instead.

        LinkError when the transport is gone. A vehicle that steers itself is sent nothing here: see `show`.
        """
        if not command.engaged:
            self._watch.stood_still = 0.0
        if self._probe.under_way or self._guided is not None:
            return
        message = None
        if command.engaged and not self._reason:
            message = self._output.steer(now, command.angle)
        if message is not None:
            self._watch.commanded(now, self._output.commanded_pulse)
            self._release.ordered(now, self._output.commanded_pulse)
            self._has_steered = True
        else:
            self._watch.released()
            self._release.asked(now)
            message = self._output.release(now)
        if message is not None:
            self._transmit(now, message, self._steering_codec)

    def show(self, tick: Tick) -> None:
        """Send the heading target that is due where the vehicle steers itself. LinkError when the transport is gone."""
        if self._sounder is not None:
            self._sounder.show(tick)
        if tick.mode is not Mode.ENGAGED and not self._watch.steering:
            self._probe.wanted(waits_to_engage(tick))
        if self._guided is not None:
            target = self._guided.show(tick, self._may_prove)
            if target is not None:
                self._transmit(tick.now, target, self._steering_codec)

    def keep(self, now: float) -> None:
        """Send what falls due: heartbeats, repeated commands, stream and parameter requests, texts.

        LinkError when the transport is gone.
        """
        if now >= self._next_heartbeat:
            self._next_heartbeat = now + HEARTBEAT_S
            self._send_heartbeats(now)
        if self._vehicle:
            due = self._probe.due(now) if self._may_prove and self._guided is None else None
            if due is not None:
                self._release.ordered(now, self._probe.pulse)
            elif not self._probe.under_way:
                due = self._output.repeat(now, self._settings.command_rate_hz)
            if due is not None:
                self._transmit(now, due, self._steering_codec)
            if self._watch.booted:
                self._send_requests(now)
            self._send_asides(now)
            if self._watch.booted and (news := self._other.due(now)) is not None:
                self._other.sent(self._transmit(now, news, self._codec))
            for text in self._texts.due(now):
                self._transmit(now, text, self._codec)
        if self._peer_heard is None:
            self._peer_heard = now
        elif now - self._peer_heard > SILENT_PEER_S:
            self._transport.forget_peer()
            self._peer_heard = now

    def release(self, now: float) -> None:
        """Give the rudder back, several times over; never raises."""
        self._watch.released()
        self._leaving, self._released_at = now, math.inf
        try:
            amidships = self._output.amidships() if self._is_held(now) and self._reader.lacks_receiver else None
            if amidships is not None:
                self._release.asked(now)
                self._marking, pulse = amidships
                self._release.mark(now, pulse)
                self._release_again(now)
            else:
                self._send_releases(now)
        except LinkError:
            self._is_gone = True  # the vehicle drops our override by its own timeout

    def release_result(self, now: float) -> Release | None:
        """Return what became of the rudder after `release`, None while the vehicle's reports may still show it."""
        shown_by = self._release.shown_by
        self._leaving = now if self._leaving is None else self._leaving
        if self._guided is not None:
            return self._guided.release(now, self.name)
        if shown_by and self._has_steered:
            return Release(self.name, ReleaseState.CONFIRMED, shown_by)
        if not self._is_held(now):
            return not_held(self.name)
        if self._is_gone:
            return Release(self.name, ReleaseState.LOST, lapse=self._lapse())
        waited = now - self._leaving
        if self._reader.lacks_receiver and now - self._released_at > LEAVING_S:
            return Release(self.name, ReleaseState.UNSHOWN, lapse=WITHOUT_RECEIVER)
        if waited > self._release.patience:
            return Release(self.name, ReleaseState.UNCONFIRMED, waited=waited, lapse=self._lapse())
        try:
            self._release_again(now)
        except LinkError:
            self._is_gone = True
        return None

    def _release_again(self, now: float) -> None:
        """Repeat what a bad line may have lost; where no report can tell a release, mark the input and release it."""
        beside = self._release.wants_mark(now)
        found = self._output.unmoving(beside) if beside is not None and self._watch.steers_by_hand else None
        if found is not None:
            self._marking, pulse = found
            self._release.mark(now, pulse)
        if self._marking is not None and self._release.mark_due(now):
            self._transmit(now, self._marking, self._steering_codec)
        elif now >= self._next_release and not self._release.is_marking(now):
            self._send_releases(now)

    def _send_releases(self, now: float) -> None:
        self._next_release = now + RELEASE_AGAIN_S
        self._released_at = min(self._released_at, now)
        self._release.asked(now)
        for message in self._output.release_burst():
            self._transmit(now, message, self._steering_codec)

    def _patience(self) -> float:
        """Return after how long [s] without an order the vehicle lets go; where it never does, as long as by default:
        by then nobody has looked after the rudder for too long."""
        if self._guided is not None:
            return TIMEOUT_S
        override_time = self._reader.parameters.get(OVERRIDE_TIME)
        return override_time if override_time is not None and override_time > 0.0 else OVERRIDE_TIME_S

    def _is_held(self, now: float) -> bool:
        override_time = self._reader.parameters.get(OVERRIDE_TIME)
        return self._release.is_held(now, OVERRIDE_TIME_S if override_time is None else override_time)

    def _lapse(self) -> str:
        override_time = self._reader.parameters.get(OVERRIDE_TIME)
        if override_time is not None and override_time < 0.0:
            return f"{OVERRIDE_TIME} is {override_time:g}, so the flight controller keeps it; switch the vehicle's mode"
        seconds = OVERRIDE_TIME_S if override_time is None else override_time
        return f"the flight controller lets go by itself after {OVERRIDE_TIME} {seconds:g} s"

    def _arrived(self) -> list[bytes]:
        try:
            return self._transport.receive()
        except LinkError:
            self._is_gone = True
            raise

    def take_packets(self) -> list[tuple[float, bytes]]:
        """Return and forget (time [s], raw packet) of all received and sent since the last call."""
        packets = list(self._packets)
        self._packets.clear()
        return packets

    def close(self) -> None:
        """Close the transport; call `release` first."""
        self._transport.close()

    def tell(self, now: float, mode: Mode, alarms: tuple[AlarmEvent, ...]) -> None:
        """Keep the state in our heartbeat honest, and say every new alarm as STATUSTEXT."""
        self.state = STATES[mode]
        self._other.tell(now, mode, alarms)
        if self._handover is not None:
            self._handover.tell(now, mode)
        if alarms != self._alarms:
            for alarm in alarms:
                if alarm not in self._alarms:
                    self.say(now, severity_of(alarm, SEVERITIES[mode]), sentence_of(alarm))
            self._alarms = alarms

    def say(self, now: float, severity: int, text: str) -> None:
        """Queue a STATUSTEXT of MAV_SEVERITY `severity`; `keep` sends it in pieces, rate-limited."""
        self._texts.say(now, severity, text)

    def report(self, now: float, name: str, value: float) -> None:
        """Send `value` under `name` (at most 10 characters) as NAMED_VALUE_FLOAT; LinkError as for `send`."""
        if self._start is None:
            self._start = now
        elapsed_ms = int((now - self._start) * 1000.0) & 0xFFFFFFFF
        message = dialect.MAVLink_named_value_float_message(elapsed_ms, name.encode("ascii", "replace")[:10], value)
        self._transmit(now, message, self._codec)

    def _holds_our_vehicle(self, datagram: bytes) -> bool:
        messages = MavlinkCodec(signing=self._signing and self._signing.observer()).decode(datagram)
        return any(message_id(message) == HEARTBEAT and self._is_ours(message) for message in messages)

    def _is_ours(self, message: Message) -> bool:
        header = message._header
        wanted = self._settings.vehicle_system
        return (
            message.autopilot != dialect.MAV_AUTOPILOT_INVALID
            and header.srcComponent == AUTOPILOT_COMPONENT
            and header.srcSystem != 0
            and wanted in (None, header.srcSystem)
        )

    def _latch(self, message: Message) -> None:
        self._vehicle = self._output.target = self._codec.system = message._header.srcSystem
        self._watch.obstacle = obstacle_of(message.autopilot, message.type)
        if self._guided is not None:
            self._guided.target = self._vehicle

    def _judge_helm(self, now: float, samples: list[Sample]) -> None:
        if self._settings.as_gcs and self._settings.gcs_system is None:
            self._gcs_codec.system = self._reader.parameters.gcs_system or DEFAULT_GCS
        obstacle = self._watch.reason(now, self._reader.parameters, self._steering_codec.system)
        if not obstacle and not self._watch.steering:
            obstacle = self._other.obstacle(now)
        proof = self._probe if self._guided is None else self._guided
        if self._watch.disobeyed or obstacle:
            proof.reset()
        self._may_prove = not obstacle
        # once we steer, the age of each heading decides
        slow = "" if self._watch.steering else self._reader.streams.waiting
        self._reason = obstacle or proof.reason or slow or self._other.waiting(now)
        is_old = self._guided is None and not obstacle and self._probe.stage is Stage.GROWN_OLD
        cause = HelmCause.UNPROVEN if is_old else self._watch.cause
        if self._helm is None or (self._helm.reason, self._helm.cause) != (self._reason, cause):
            self._helm = HelmSample(now, not self._reason, self._reason, self.name, cause)
            samples.insert(0, self._helm)

    def _note(self, now: float, source: str, event: AlarmEvent | None, samples: list[Sample]) -> None:
        if self._noted.get(source) != event:
            self._noted[source] = event
            samples.append(AlarmSample(now, event, f"{self.name} {source}"))

    def _send_heartbeats(self, now: float) -> None:
        self._transmit(now, companion_heartbeat(self.state), self._codec)
        if self._settings.as_gcs:
            self._transmit(now, station_heartbeat(), self._gcs_codec)

    def _send_requests(self, now: float) -> None:
        for identity, interval_us in self._reader.streams.due(now):
            self._transmit(now, interval_request(self._vehicle, identity, interval_us), self._steering_codec)
        for name in self._reader.parameters.due(now):
            self._transmit(now, parameter_request(self._vehicle, name), self._steering_codec)

    def _send_asides(self, now: float) -> None:
        """Ask the vehicle for what is no steering: the mode of a fail-safe, the sound of an alarm."""
        for aside in (self._handover, self._sounder):
            if aside is not None:
                for message in aside.due(now, self._vehicle):
                    self._transmit(now, message, self._steering_codec)

    def _transmit(self, now: float, message: Message, codec: MavlinkCodec) -> bytes:
        packet = codec.encode(message)
        if self._transport.send(packet):
            self._packets.append((now, packet))
        else:
            self.dropped += 1
        return packet
