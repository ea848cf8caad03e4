"""What is said over one NMEA 2000 network: messages in, samples out; rudder orders and ticks in, messages out.

Heading, rate, roll, rudder, speed, position, wind and a plotter's legs come in; rudder order (127245) and heading/track
control (127237) leave, and Norrbin is a node like any other, see `autopilot.links.n2k.node`.

A man overboard is said by all who know of one, and taken from all.

    127233 man overboard: whose, by button or beacon, where

Source: fields and words as in canboat's canboat.json.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple, Protocol

from autopilot.angles import shortest_turn
from autopilot.guidance.current import Overboard, Place
from autopilot.guidance.plotter import NO_VARIATION, PlotterGuide
from autopilot.links.base import OFF_HEADING, OTHER_PILOT_S, PLOTTER, AlarmNews, Backlog, HelmNews, LastStop
from autopilot.links.n2k.node import (
    DENIED,
    DONE,
    FIELD_DENIED,
    FIELD_UNSUPPORTED,
    NO_ADDRESS,
    NOT_NOW,
    OUT_OF_RANGE,
    REPEATED_S,
    TEMPORARY,
    UNSUPPORTED,
    Alerts,
    Device,
    Node,
)
from autopilot.links.n2k.packets import (
    ADDRESS_CLAIM,
    ALERT_RESPONSE,
    BEACON,
    BUTTON,
    BY_VESSEL,
    COMMANDED_ADDRESS,
    CONTROL,
    CROSS_TRACK,
    FOLLOW_UP,
    GROUND_SPEED,
    GROUP_FUNCTION,
    HEADING,
    HEADING_CONTROL,
    LAYOUTS,
    MAIN,
    ORDERS,
    OVERBOARD,
    REQUEST,
    RUDDER,
    STEERING,
    TRACK_CONTROL,
    VARIATION,
    YES_NO,
    Message,
    decoded,
    encoded,
    number,
    value_of,
)
from autopilot.links.n2k.samples import (
    INSTRUMENTS,
    PLOTTER_GROUPS,
    Compass,
    PlotterReader,
    course_of,
    is_heading,
    own_variation,
    rudder_order,
    sample_of,
    source_name,
)
from autopilot.links.north import NeedsVariationError, UnusableHeadings, Variation, known_as, steered
from autopilot.links.rudder_order import FollowSettings, Release, RudderFollow, StandingOrder, UnshownRelease
from autopilot.signals import (
    AcknowledgeSample,
    HeadingSample,
    Mode,
    OrderKind,
    PositionSample,
    RudderCommand,
    RudderSample,
    Sample,
    Tick,
)


def overboard_of(data: bytes, source: int) -> tuple[Place, str] | None:
    """Return place and beacon of a man overboard; None for a test, and where no place is said."""
    fields = decoded(OVERBOARD, data)
    latitude, longitude = number(fields, "latitude", 0.5 * math.pi), number(fields, "longitude", math.pi)
    if fields.get("manOverboardStatus") not in (BEACON, BUTTON) or latitude is None or longitude is None:
        return None
    return Place(latitude, longitude), f"{source}.{fields.get('mobEmitterId', '')}"


NETWORK = (ADDRESS_CLAIM, COMMANDED_ADDRESS, REQUEST, GROUP_FUNCTION)
READ = frozenset((*INSTRUMENTS, *PLOTTER_GROUPS, *NETWORK, ALERT_RESPONSE, OVERBOARD))
"""The groups that are listened to."""
ORDER_PERIOD_S = 0.1
CONTROL_PERIOD_S = 0.25
WAITING_MOST = 64
"""Messages that wait for a busy bus; of more the oldest go unsent."""
ORDERS_KEPT = 50
"""Rudder orders of our own that a gateway may send back: those of five seconds."""
LAPSE = "nothing on the bus confirms it; the drive lets go by itself when no more orders come"
STRANDED = "no address is free on the NMEA 2000 network: no order can leave"
CONTESTED = (
    "another device claims our address, or moves us, again and again on the NMEA 2000 network: no order can leave"
)
MUTE_S = 1.0
"""So long [s] claims may keep us from ordering the rudder; a claim without objections takes half of it."""
COMMANDS = {5: "steeringMode", 7: "headingReference", 11: "headingToSteerCourse"}
"""Fields of 127237 that another node may set, by their index."""


class Helm(Protocol):
    """Who carries out what a plotter's user orders; overboard: where somebody went overboard; last_stop: when the pilot
    left the helm last."""

    overboard: Overboard | None
    last_stop: LastStop

    def engage(self, heading: float | None) -> None:
        """Order a heading [rad], or the present one."""

    def turn_to(self, heading: float) -> None:
        """Change the heading [rad] ordered."""

    def stand_by(self) -> None:
        """Give the rudder back."""

    def follow(self) -> None:
        """Follow the chart plotter."""


class N2kSettings(NamedTuple):
    """heading_latency [s]; variation [rad], None to take it from the bus; whether rudder orders leave; follow;
    magnetic: whether magnetic courses are steered; rudder_limit [rad]; device: what tells this node from others;
    takes_orders: whether other nodes may engage the pilot and change its course, and not only end its steering.
    with_other_pilot: steer although another autopilot of the network orders the rudder.
    """

    heading_latency: float = 0.0
    variation: float | None = None
    steers: bool = True
    follow: FollowSettings = FollowSettings()
    magnetic: bool = False
    rudder_limit: float = math.inf
    device: Device = Device()
    takes_orders: bool = False
    with_other_pilot: bool = False


class N2kSession:
    """One network. It owns no bus and no clock, and never raises.

    is_node: whether Norrbin is the node; a gateway that has an address of its own is the node itself. guide: takes
    what a plotter says. helm: carries out what is ordered from the network, None where nobody can.
    """

    def __init__(
        self,
        name: str,
        settings: N2kSettings = N2kSettings(),  # noqa: B008 - immutable
        is_node: bool = True,
        guide: PlotterGuide | None = None,
        helm: Helm | None = None,
        variation: Variation | None = None,
    ) -> None:
        self.name, self.settings = name, settings
        self.received_time = -math.inf
        self.node = (
            Node(settings.device, tuple(sorted(READ)), self._current, self._commanded)
            if is_node and settings.steers
            else None
        )
        self._alerts = Alerts(self.node.name) if self.node is not None else None
        self._guide, self._helm = guide, helm
        self._guide_alarm = AlarmNews(PLOTTER)
        self._variation = variation or known_as(settings.variation)
        self._plotters: dict[int, PlotterReader] = {}
        self._unusable, self._unusable_headings = 0, UnusableHeadings(name)
        self._jumped = AlarmNews(f"{name}, jumped variation")
        self._follow = RudderFollow(settings.follow)
        self._order = StandingOrder(ORDER_PERIOD_S, ORDER_PERIOD_S)
        self._release = UnshownRelease(name, LAPSE)
        self._helm_news = HelmNews(name, settings.steers)
        self._mute: tuple[float, str] | None = None
        self._next_control = self._next_overboard = -math.inf
        self._overboard = None if helm is None else helm.overboard
        self._tick: Tick | None = None
        self._other_pilot: tuple[int, float] | None = None
        self._sent: dict[int, bytes] = {}
        self._orders: deque[bytes] = deque(maxlen=ORDERS_KEPT)
        self._waiting: list[Message] = []
        self._backlog = Backlog()

    def receive(self, now: float, messages: list[Message]) -> list[Sample]:
        """Take the messages that have arrived by `now` [s], and return the samples in them."""
        self._backlog.on_receive(now)
        samples: list[Sample] = []
        if messages:
            self.received_time = now
        for message in messages:
            self._take(now, message, samples)
        samples += self._unusable_headings.news(now, samples, self._unusable)
        samples += self._jumped.of(now, None if self.settings.magnetic else self._variation.alarm(self))
        samples += self._helm_news.of(now, self._follow.reason(now) or self._barred(now), self._follow.cause)
        if self._guide is not None:
            samples += self._guide_alarm.of(now, self._guide.alarm)
        return samples

    def _barred(self, now: float) -> str:
        """Return why the network does not let us steer; empty where it does."""
        if self.node is not None:
            if self.node.is_ready(now):
                self._mute = None
            elif self.node.address == NO_ADDRESS:
                self._mute = -math.inf, STRANDED  # until an address is ours, and not only asked for
            elif self._mute is None:
                self._mute = now, CONTESTED
            if self._mute is not None and now - self._mute[0] > MUTE_S:
                return self._mute[1]
        other = self._other_pilot
        if other is not None and now - other[1] <= OTHER_PILOT_S and not self.settings.with_other_pilot:
            return (
                f"another autopilot of the NMEA 2000 network, address {other[0]}, orders the rudder: put it in "
                "standby, or start with --with-other-pilot"
            )
        return ""

    def _take(self, now: float, message: Message, samples: list[Sample]) -> None:
        group, node = message.group, self.node
        if group in NETWORK:
            if node is not None:
                self._waiting += node.take(now, message)
            return
        if node is not None and message.source == node.address:
            is_echo = group != RUDDER or message.data in self._orders
            if not is_echo and rudder_order(decoded(group, message.data)) is not None:
                self._other_pilot = message.source, now  # somebody speaks under our address
            return
        if group in PLOTTER_GROUPS:
            is_pilots = group == CONTROL and node is not None and node.is_pilot(message.source)
            if self._guide is not None and not is_pilots:
                self._lead(now, message, self._guide)
            return
        if group == ALERT_RESPONSE and self._alerts is not None and (alarm := self._alerts.acknowledged(message.data)):
            samples.append(AcknowledgeSample(now, alarm, f"N2K{group}.{message.source}"))
        elif group == OVERBOARD and self._overboard is not None:
            found = overboard_of(message.data, message.source)
            if found is not None:
                self._overboard.report(now, *found)
        elif group in INSTRUMENTS:
            self._measured(now, message, samples)

    def _lead(self, now: float, message: Message, guide: PlotterGuide) -> None:
        """Tell the guide what a device says of a route; one that has none does not speak for another that has."""
        if message.group == CONTROL and any(plotter.leads(now) for plotter in self._plotters.values()):
            return
        plotter = self._plotters.get(message.source)
        if plotter is None:
            plotter = self._plotters[message.source] = PlotterReader(self._variation, self.settings.magnetic)
        try:
            led = plotter.take(now, message)
        except NeedsVariationError:
            guide.unread(now, NO_VARIATION)
            return
        if led is not None:
            guide.take(led._replace(source=f"{self.name}, address {message.source}"))
        elif message.group == CROSS_TRACK and plotter.names_none(now):
            guide.unread(now, "129283 alone names no leg: let it send 129284")

    def _measured(self, now: float, message: Message, samples: list[Sample]) -> None:
        group = message.group
        fields = decoded(group, message.data)
        if group in (HEADING, VARIATION) and (heard := own_variation(fields)) is not None:
            fields = {**fields, "variation": self._variation.receive(now, heard, self, group, message.source)}
        is_order = group == RUDDER and rudder_order(fields) is not None
        if is_order and self.node is not None and self.node.is_pilot(message.source):
            self._other_pilot = message.source, now
        compass = Compass(self._variation.value, self.settings.magnetic)
        source = source_name(group, message.source, fields)
        sample = sample_of(group, now, fields, compass, source)
        self._unusable += sample is None and is_heading(group, fields)
        if isinstance(sample, HeadingSample):
            sample = sample._replace(time=now - self.settings.heading_latency)
        elif isinstance(sample, RudderSample) and ":" not in source:
            # the angle of a further rudder is for the log
            self._follow.measured(now, sample.angle, sample.source)
        elif isinstance(sample, PositionSample):
            self._variation.move(sample.latitude, sample.longitude)
        if sample is not None:
            samples.append(sample)
        if group == GROUND_SPEED and (course := course_of(now, fields, self._variation.value, source)) is not None:
            samples.append(course)

    def send(self, now: float, command: RudderCommand) -> None:
        """Take the rudder command of `now` [s]; one that is not engaged is a release."""
        angle = self._order.take(now, command)
        if angle is None:
            self._follow.released()
        else:
            self._follow.ordered(now, angle)
            self._release.has_ordered = self._release.has_ordered or self.settings.steers
        self._say_order(now)

    def poll(self, now: float) -> None:
        """Say what is due at `now` [s]."""
        if self.node is not None:
            self._waiting += self.node.due(now)
        self._say_order(now)

    def on_tick(self, tick: Tick) -> None:
        """Say heading/track control at its rate."""
        self._tick = tick
        if self._helm is not None:
            self._helm.last_stop.on_tick(tick)
        self._variation.on_tick(tick.now, tick.command.engaged)
        if self._alerts is not None and self.node is not None and self.node.is_ready(tick.now):
            address = self.node.address
            self._waiting += [Message(group, data, address, priority=7) for group, data in self._alerts.due(tick)]
            self._waiting += [Message(OVERBOARD, data, address, priority=3) for data in self._overboard_due(tick.now)]
        if self.settings.steers and tick.now >= self._next_control and tick.state.valid:
            self._next_control = tick.now + CONTROL_PERIOD_S
            self._send(tick.now, CONTROL, encoded(CONTROL, self._control(tick)))

    def _overboard_now(self) -> bytes | None:
        """Return what the network is to know of a man overboard whom we have marked ourselves; None where none is."""
        overboard = self._overboard
        if overboard is None or overboard.place is None or overboard.beacon:
            return None
        fields = {
            "mobEmitterId": self.settings.device.unique,
            "manOverboardStatus": BUTTON,
            "positionSource": BY_VESSEL,
            "latitude": overboard.place.latitude,
            "longitude": overboard.place.longitude,
        }
        return encoded(OVERBOARD, fields)

    def _overboard_due(self, now: float) -> list[bytes]:
        """Return it at once and every few seconds."""
        data = self._overboard_now()
        if data is None or now < self._next_overboard:
            self._next_overboard = -math.inf if data is None else self._next_overboard
            return []
        self._next_overboard = now + REPEATED_S
        return [data]

    def due(self, now: float) -> list[Message]:
        """Return and forget the messages that leave at `now` [s], oldest first."""
        leaving, self._waiting = self._waiting[-WAITING_MOST:], []
        return leaving

    def sent(self, now: float, messages: list[Message]) -> None:
        """Do nothing: what a bus does not take is forgotten, a newer message follows."""

    def release(self, now: float) -> list[Message]:
        """Return the messages that give the rudder back, several times over, behind what waits."""
        for _ in range(self._order.end()):
            self._send_rudder(now, None)
        return self.due(now)

    def released(self, now: float, is_gone: bool) -> None:
        """Take that the releases have left at `now` [s]; `is_gone`: they could not."""
        self._release.asked(now, is_gone)

    def release_result(self, now: float) -> Release | None:
        """Return what became of the rudder after `release`, None while it is on its way."""
        return self._release.result(now)

    def _say_order(self, now: float) -> None:
        # one that may not leave yet is not said, so that it leaves at once when we may speak
        if self.settings.steers and (self.node is None or self.node.is_ready(now)):
            self._order.send(now, lambda angle: self._send_rudder(now, angle))

    def _send_rudder(self, now: float, angle: float | None) -> bool:
        fields: dict[str, object] = {"instance": 0, "directionOrder": ORDERS[0]}
        if angle is not None:
            fields |= {"directionOrder": _side(angle), "angleOrder": angle}
        return self._send(now, RUDDER, encoded(RUDDER, fields))

    def _send(self, now: float, group: int, data: bytes) -> bool:
        self._sent[group] = data
        if group == RUDDER:
            self._orders.append(data)
        if self.node is not None and not self.node.is_ready(now):
            return False
        self._waiting.append(Message(group, data, 0 if self.node is None else self.node.address, priority=2))
        return True

    def _current(self, group: int) -> bytes | None:
        return self._overboard_now() if group == OVERBOARD else self._sent.get(group)

    def _control(self, tick: Tick) -> dict[str, object]:
        engaged = tick.mode is Mode.ENGAGED
        heads = engaged and tick.order.kind is OrderKind.HEADING and math.isfinite(tick.order.heading)
        off = abs(shortest_turn(tick.reference.heading, tick.state.heading)) > OFF_HEADING
        limit = self.settings.rudder_limit
        mode = (TRACK_CONTROL if tick.order.is_led else HEADING_CONTROL) if heads else FOLLOW_UP if engaged else MAIN
        fields: dict[str, object] = {
            "override": YES_NO[tick.mode is Mode.OVERRIDE],
            "steeringMode": mode,
            "headingReference": "Magnetic" if self.settings.magnetic else "True",
            "vesselHeading": tick.state.heading % math.tau,
            "offHeadingLimit": OFF_HEADING,
        }
        if math.isfinite(limit):
            fields["rudderLimit"] = limit
            fields["rudderLimitExceeded"] = YES_NO[engaged and abs(tick.demand) > limit]
        if engaged:
            fields["commandedRudderDirection"] = _side(tick.command.angle)
            fields["commandedRudderAngle"] = tick.command.angle
        if heads:
            fields["headingToSteerCourse"] = tick.order.heading % math.tau
            fields["offHeadingLimitExceeded"] = YES_NO[off]
        return fields

    def _commanded(self, now: float, source: int, pairs: tuple[tuple[int, int], ...]) -> tuple[int, list[int]]:
        """Carry out a command of 127237 and return its codes. Ending the steering is always allowed, and goes first."""
        asked: dict[str, float | str] = {}
        codes: list[int] = []
        for index, raw in pairs:
            name = COMMANDS.get(index)
            value = None if name is None else value_of(LAYOUTS[CONTROL][index - 1], raw)
            codes.append(FIELD_UNSUPPORTED if name is None else OUT_OF_RANGE if value is None else DONE)
            if name is not None and value is not None:
                asked[name] = value
        helm, mode, giver = self._helm, asked.get("steeringMode"), (self, source)
        if helm is not None and mode == MAIN:
            helm.stand_by()
            helm.last_stop.ordered(now, giver)
            return DONE, codes
        if helm is None or not self.settings.takes_orders:
            return DENIED, [FIELD_DENIED] * len(pairs)
        if any(codes) or not asked:
            return UNSUPPORTED, codes
        if mode in STEERING[1:3]:
            return UNSUPPORTED, [OUT_OF_RANGE if index == 5 else DONE for index, _ in pairs]
        tick, course = self._tick, asked.get("headingToSteerCourse")
        reference = asked.get("headingReference", "Magnetic" if self.settings.magnetic else "True")
        if isinstance(course, float):
            course = steered(
                course,
                is_magnetic=reference == "Magnetic",
                by_compass=self.settings.magnetic,
                variation=self._variation.value,
            )
        heads = tick is not None and tick.mode is Mode.ENGAGED and tick.order.kind is OrderKind.HEADING
        not_now = tick is None or not tick.state.valid or self._backlog.has(now)
        not_now = not_now or helm.last_stop.is_unseen(now, giver)
        if not_now or (course is None and "headingToSteerCourse" in asked) or (mode is None and not heads):
            return NOT_NOW, [TEMPORARY] * len(pairs)
        if mode == TRACK_CONTROL:
            helm.follow()
        elif isinstance(course, float) and heads:
            helm.turn_to(course)
        elif isinstance(course, float) or (
            mode is not None and not (heads and tick is not None and not tick.order.is_led)
        ):
            helm.engage(course if isinstance(course, float) else None)
        return DONE, codes


def _side(angle: float) -> str:
    return ORDERS[1] if angle >= 0.0 else ORDERS[2]
