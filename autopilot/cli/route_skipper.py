"""The skipper who can hand the course to a route or a pattern, or the rudder to a trial; other orders take it back.

The guides move the heading that is ordered, they give no orders of their own: a route never engages the pilot, and an
override ends the following of it for good.
"""

from __future__ import annotations

import math

from autopilot.cli.pattern_order import KINDS, pattern_of, pattern_typed
from autopilot.cli.plotter_follow import PlotterSkipper
from autopilot.cli.trial_script import Step, TrialScript, turning, zigzag
from autopilot.errors import InputError
from autopilot.guidance.patterns import Pattern, PatternGuide
from autopilot.guidance.plotter import PlotterGuide
from autopilot.guidance.trial_limits import TrialLimits
from autopilot.guidance.wind_vane import WindGuide
from autopilot.links.boat.mission import Mission
from autopilot.order_values import SHOWN
from autopilot.printable import printable
from autopilot.signals import Mode, Order, OrderKind, PositionSample, Tick, WindSample

ROUTE_HELP = "t [N]: follow the route"
WIND_HELP = "w: hold the wind's angle"
BEGIN_PATIENCE_S = 5.0
"""A trial that has not begun after this time [s] is not sailed: the pilot cannot engage."""
ANGLE_LEAST, CHANGE_MOST = math.radians(1.0), math.radians(90.0)
DURATION_MOST_S = 3600.0
NUMBER_DIGITS = 5


class RouteSkipper(PlotterSkipper):
    """A `PlotterSkipper` whose heading orders come from the guides while they lead, and who sails trials.

    Attributes:
        mission: the route.  track: leads along it.  patterns: leads through turn patterns.  wind: leads by the wind.
    """

    def __init__(self, rudder_max: float, plotter: PlotterGuide, mission: Mission) -> None:
        super().__init__(rudder_max, plotter)
        self.mission = mission
        self.track = mission.guide
        self.patterns = PatternGuide()
        self.wind = WindGuide()
        self._awaits_wind = False
        self._tick: Tick | None = None
        self._has_led = False
        self._script: TrialScript | None = None
        self._script_since: float | None = None
        self._before = Order()

    def __call__(self, now: float, tick: Tick | None) -> Order:
        """Return the order at `now`."""
        self._tick = tick
        if tick is not None:
            for sample in tick.samples:
                if isinstance(sample, PositionSample):
                    self.track.take(sample)
                elif isinstance(sample, WindSample) and tick.state.valid:
                    self.wind.hear(sample, tick.state.heading)
            if self._awaits_wind and self.wind.is_known(tick.now):
                self.hold_wind()
        if self._script is not None:
            return self._sail(now, tick, self._script)
        order = super().__call__(now, tick)
        leader = next((guide for guide in (self.track, self.wind) if guide.following), self.patterns)
        if not leader.following or tick is None:
            if order.is_led and not self._guide.following:
                self._order = order = order._replace(is_led=False)
            return order
        if tick.mode is Mode.OVERRIDE and self._has_led:
            # who has taken the helm keeps it: nothing of the route is left when the pilot is engaged again
            leader.leave()
        elif tick.mode is Mode.ENGAGED and tick.order.kind is OrderKind.HEADING and not self._adopt:
            self._has_led = True
            # the same serial: a route must not engage the pilot anew after an override
            course = leader.course(now, tick.state.heading, tick.state.speed)
            self._order = order._replace(heading=course, is_led=True)
        return self._order

    def engage(self, heading: float | None) -> None:
        """Order a heading [rad] or the present one; nobody else leads."""
        self._take_back()
        super().engage(heading)

    def give(self, order: Order) -> None:
        """Order something else; nobody else leads."""
        self._take_back()
        super().give(order)

    def turn_to(self, heading: float) -> None:
        """Change the heading [rad] ordered; nobody else leads."""
        self.end_trial()
        self._take_back()
        super().turn_to(heading)

    def follow(self) -> None:
        """Follow the plotter."""
        self._take_back()
        super().follow()

    def type_line(self, line: str) -> str:
        """Act on a typed line and return what to answer. Raises InputError."""
        word, _, rest = line.strip().partition(" ")
        if word == "p":
            self.sail_pattern(pattern_typed(rest))
            return f"pattern {rest}"
        if word == "w" and not rest:
            self.hold_wind()
            return "holding the wind's angle"
        if word == "t":
            return self._follow_route(rest)
        answer = super().type_line(line)
        if word[:1] in ("+", "-"):
            self._take_back()
        return answer

    def _follow_route(self, number: str) -> str:
        """Follow the route from a waypoint on, or from the current one. Raises InputError."""
        mission = self.mission
        if number and not (number.isascii() and number.isdecimal() and len(number) <= NUMBER_DIGITS):
            raise InputError(f"t {printable(number, SHOWN)}: give the number of a waypoint, from 0")
        target = int(number) if number else None
        obstacle = mission.obstacle(self._tick.now if self._tick is not None else math.inf, target)
        if obstacle:
            raise InputError(obstacle)
        if target is not None:
            mission.set_current(target)
        self.hand_to_track()
        mission.follow()
        return f"following the route to waypoint {mission.current} of 0 to {len(mission.items) - 1}"

    def hand_to_track(self) -> None:
        """Let the track guide lead, engaging on the present heading where none is steered yet."""
        tick = self._tick
        if tick is not None and tick.mode is Mode.ENGAGED and self._order.kind is OrderKind.HEADING:
            self._take_back()
            self._guide.leave()
        else:
            self.engage(None)
        self._has_led = False

    def hold_wind(self) -> None:
        """Hold the present angle of the apparent wind, engaging where no heading is steered yet. Raises InputError."""
        tick = self._tick
        if tick is None or not self.wind.is_known(tick.now):
            raise InputError("no wind is heard that could be held: check the wind vane and its NMEA link (MWV)")
        self.hand_to_track()
        self.wind.follow()

    def await_wind(self) -> None:
        """Hold the angle of the apparent wind as soon as one is heard; until then give no order."""
        self.give(Order())
        self.wind.wait()
        self._awaits_wind = True

    def sail_pattern(self, pattern: Pattern) -> None:
        """Sail a turn pattern, engaging on the present heading where none is steered yet."""
        self.hand_to_track()
        self.patterns.follow(pattern)

    def pattern(self, number: int, side: float, sizes: tuple[float, ...]) -> None:
        """Sail the turn pattern of a number, with its sizes in metres and degrees. Raises InputError."""
        kinds = list(KINDS)
        if not 0 <= number < len(kinds):
            raise InputError(f"pattern {number}: allowed is 0 to {len(kinds) - 1}")
        self.sail_pattern(pattern_of(kinds[number], side, sizes))

    def zigzag(self, rudder: float, heading_change: float, duration: float) -> TrialScript:
        """Begin a zigzag; angles [rad], time [s]. Raises InputError."""
        _check("rudder", rudder, ANGLE_LEAST, self._rudder_max)
        _check("change of heading", heading_change, ANGLE_LEAST, CHANGE_MOST)
        return self._begin(zigzag(rudder, heading_change, duration))

    def turning(self, rudder: float, duration: float) -> TrialScript:
        """Begin a turn at a held rudder [rad]. Raises InputError."""
        _check("rudder", rudder, -self._rudder_max, self._rudder_max)
        return self._begin(turning(rudder, duration))

    def end_trial(self) -> None:
        """End a trial before its time, and go back to what was steered before."""
        if self._script is not None:
            self._script.stop()
            self._go_back(self._tick)

    def _begin(self, step: Step) -> TrialScript:
        if not 1.0 <= step.duration <= DURATION_MOST_S:
            raise InputError(f"a trial of {step.duration:g} s: 1 to {DURATION_MOST_S:g} s are allowed")
        tick, order = self._tick, self._order
        steered = tick is not None and tick.mode is Mode.ENGAGED and order.kind is OrderKind.HEADING
        self.give(step.order)
        self._before = order if steered else Order()
        self._script = TrialScript([step], TrialLimits())
        self._script_since = None
        return self._script

    def _sail(self, now: float, tick: Tick | None, script: TrialScript) -> Order:
        order = script(now, tick)
        if self._script_since is None:
            self._script_since = now
        if not script.begun_at and now - self._script_since > BEGIN_PATIENCE_S:
            script.stop()
        if script.is_over:
            self._go_back(tick)
            return self._order
        return order._replace(serial=self._order.serial)

    def _go_back(self, tick: Tick | None) -> None:
        """After a trial: steer what was steered before it, or give the rudder back; the same intended action."""
        self._script = None
        back = self._before
        if (
            back.kind is OrderKind.STANDBY
            and tick is not None
            and tick.mode in (Mode.OVERRIDE, Mode.FAILSAFE, Mode.FAULT)
        ):
            # standing by would take back what the skipper has to hear
            back = Order(OrderKind.HEADING, math.nan)
        self._order = back._replace(serial=self._order.serial)
        self._adopt = back.kind is OrderKind.HEADING and not math.isfinite(back.heading)

    def _take_back(self) -> None:
        self.track.leave()
        self.patterns.leave()
        self.wind.leave()
        self._awaits_wind = False
        if self._script is not None:
            self._script.stop()
            self._script = None


def _check(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        limits = f"{math.degrees(low):.0f} to {math.degrees(high):.0f}"
        raise InputError(f"{name} {math.degrees(value):.3g} deg: {limits} are allowed")
