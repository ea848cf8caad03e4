"""Who moves the order at the helm: typed lines become orders; every intended action has a new serial.

The skipper can hand the course to a chart plotter, a route, a pattern or the wind, and the rudder to a trial; any other
order takes it back. Turn patterns are ordered at the terminal (`p circle + 60`) or by number over MAVLink, and checked
alike.

The guides move the heading that is ordered, they give no orders of their own: a route never engages the pilot, and an
override ends the following of it for good.
"""

from __future__ import annotations

import math

from autopilot.angles import compass_text, wrap
from autopilot.errors import InputError
from autopilot.files.outside import SHOWN
from autopilot.files.printable import printable
from autopilot.guidance.current import Overboard
from autopilot.guidance.manoeuvres import OneThruster, Pattern, PatternGuide, TrialLimits
from autopilot.guidance.plotter import PlotterGuide
from autopilot.guidance.wind_vane import CONFIRM_S, Manoeuvre, WindGuide
from autopilot.links.base import LastStop
from autopilot.links.ground_station.mission import Mission
from autopilot.operators.trial_script import (
    KINDS,
    Step,
    TrialScript,
    degrees_of,
    heading_of,
    pattern_of,
    pattern_typed,
    turn_of,
    turning,
    zigzag,
)
from autopilot.signals import (
    CompassSample,
    CourseSample,
    Mode,
    Order,
    OrderKind,
    PositionSample,
    SpeedSample,
    Tick,
    WindSample,
)

HELP = (
    "e [DEG]: engage (present heading)  +10, -1: change heading  r DEG: hold a rudder angle  s: standby  "
    "a: silence alarms  q: quit"
)
WHOLE_WORDS = {"standby": "s", "stop": "s", "quit": "q", "exit": "q", "engage": "e", "help": "h"}
"""In a hurry people type the word."""
LEARN_HELP = "learn: what was learnt  adopt: steer with it  revert: take it back"
FOLLOW_HELP = "f: follow the chart plotter"


ROUTE_HELP = "t [N]: follow the route"
WIND_HELP = "w [true] [DEG]: hold the wind's angle  tack, gybe: ask for it  y: confirm  n: do not"
SWING_HELP = "swing: drive on one thruster where the other stands still"
MOB_HELP = "mob: man overboard, its bearing and distance  mob off: over"
LEAD_TRACK = (PositionSample, SpeedSample, CourseSample)
"""What the track guide takes."""
BEGIN_PATIENCE_S = 5.0
"""A trial that has not begun after this time [s] is not sailed: the pilot cannot engage."""
ANGLE_LEAST, CHANGE_MOST = math.radians(1.0), math.radians(90.0)
DURATION_MOST_S = 3600.0
NUMBER_DIGITS = 5


class Skipper:
    """Holds the present order. Start with `engage`; `type_line` takes what the skipper types.

    Attributes:
        mission: the route.  overboard: where somebody went overboard.
        plotter, track, patterns, wind: who may lead: the chart plotter, the route, a turn pattern, the wind.
        swings: on one thruster; weak: the side of the one that stood still last, '' where none has.
        last_stop: when the pilot left the helm last, for all links.
        help: what is answered to `h`.
        acknowledged: the names of alarms acknowledged since `Acknowledgements` looked last, "" for all that sound.
    """

    def __init__(self, rudder_max: float, plotter: PlotterGuide, mission: Mission) -> None:
        self._rudder_max = rudder_max
        self._order = Order()
        self._adopt, self._beside = False, 0.0
        self.quit, self.help = False, HELP
        self.last_stop = LastStop()
        self.acknowledged: list[str] = []
        self.mission = mission
        self.overboard: Overboard | None = mission.overboard
        self.plotter, self.track = plotter, mission.guide
        self.patterns = PatternGuide()
        self.wind = WindGuide()
        self.swings, self.weak = OneThruster(), ""
        self._awaits_wind = False
        self._tick: Tick | None = None
        self._has_led = False
        self._script: TrialScript | None = None
        self._script_since: float | None = None
        self._before = Order()

    def __call__(self, now: float, tick: Tick | None) -> Order:
        order = self._led(now, tick)
        if self.swings.following:
            if tick is not None and tick.mode is Mode.ENGAGED and order.kind is OrderKind.HEADING and not order.is_led:
                fix = self.track.fix
                swung = self.swings.order(order.heading, self._rudder_max, fix.place if fix.is_fresh(now) else None)
                self.wind.watch(now, None)
                return swung._replace(serial=order.serial)
            if tick is not None:
                self.swings.leave()
        steers = tick is not None and tick.mode is Mode.ENGAGED and order.kind is OrderKind.HEADING
        if steers and (self.wind.following or not order.is_led):
            self.wind.watch(now, (order.serial, None if order.is_led else order.heading))
        else:
            self.wind.watch(now, None)
        return order

    def _led(self, now: float, tick: Tick | None) -> Order:
        self._tick = tick
        if tick is not None:
            self._hear(now, tick)
        if self._script is not None:
            return self._sail(now, tick, self._script)
        order = self._helmed(now, tick)
        leader = self.track if self.track.following else self.wind if self.wind.following else self.patterns
        if not leader.following or tick is None:
            if order.is_led and not self.plotter.following:
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

    def _helmed(self, now: float, tick: Tick | None) -> Order:
        """Return the order as it was given, or as the plotter has moved it."""
        steers = tick is not None and tick.mode is Mode.ENGAGED
        if self._adopt and tick is not None and steers and tick.order.is_same(self._order):
            self._adopt = False
            self._order = self._order._replace(heading=wrap(tick.state.heading + self._beside))
        leads = self.plotter.following and steers and self._order.kind is OrderKind.HEADING and not self._adopt
        if leads and tick is not None:
            # the same serial: a plotter must not engage the pilot anew after an override
            course = self.plotter.course(now, tick.state.heading, tick.state.speed)
            self._order = self._order._replace(heading=course, is_led=True)
        return self._order

    def _hear(self, now: float, tick: Tick) -> None:
        """Let the guides have what they go by."""
        for sample in tick.samples:
            if sample.__class__ in LEAD_TRACK:
                self.track.take(sample)
            elif isinstance(sample, CompassSample) and math.isfinite(sample.turn):
                # the boat stays on its course, whose number is another by the other compass
                self._order, self._before = (
                    order._replace(heading=wrap(order.heading + sample.turn)) for order in (self._order, self._before)
                )
            if isinstance(sample, SpeedSample):
                self.wind.vane.on_speed(sample)
            elif isinstance(sample, WindSample) and tick.state.valid:
                self.wind.vane.on_wind(sample, tick.state.heading)
        for alarm in tick.alarms:
            if alarm.name == "thruster_weak":
                self.weak = alarm.detail
        if tick.state.valid:
            self.track.move(now, tick.state.heading, tick.state.speed)
            self.plotter.stream, self.plotter.turn_radius = self.track.stream(now), self.track.settings.turn_radius
        if self._awaits_wind and self.wind.is_known(tick.now):
            self.hold_wind()

    def engage(self, heading: float | None) -> None:
        """Order a `heading` [rad], or the present one; nobody else leads."""
        self._take_back()
        self.swings.leave()
        self.plotter.leave()
        self._adopt, self._beside = heading is None, 0.0
        known = math.nan if heading is None else wrap(heading)
        self._order = Order(OrderKind.HEADING, known, serial=self._order.serial + 1)

    def give(self, order: Order) -> None:
        """Order something else: a trial, a rudder angle; no guide leads, but a plotter goes on behind a trial."""
        self._take_back()
        self.swings.leave()
        self._adopt = False
        self._order = order._replace(serial=self._order.serial + 1)

    def turn_to(self, heading: float) -> None:
        """Change the heading [rad] ordered; the same serial: no request to engage again after an override. Nobody else
        leads."""
        self.end_trial()
        self._take_back()
        self.plotter.leave()
        if self._order.kind is OrderKind.HEADING:
            self._adopt = False
            self._order = self._order._replace(heading=wrap(heading), is_led=False)

    def stand_by(self) -> None:
        """Order the rudder to be given back; nobody leads any more."""
        if self._tick is not None:
            self.last_stop.ordered(self._tick.now, self)
        self.plotter.leave()
        self.give(Order())

    def follow(self) -> None:
        """Follow the plotter, engaging on the present heading where nothing is steered yet."""
        self._take_back()
        if self._order.kind is not OrderKind.HEADING:
            self.engage(None)
        self.plotter.follow()

    def acknowledge(self, name: str = "") -> None:
        """Silence the alarms of a name, or all that sound."""
        self.acknowledged.append(name)

    def type_line(self, line: str) -> str:
        """Act on a typed line and return what to answer. Raises InputError."""
        word, _, rest = line.strip().partition(" ")
        word = WHOLE_WORDS.get(word.lower(), word.lower())
        if word in ("", "?", "h"):
            return self.help
        if word == "q":
            self.quit = True
            return "leaving"
        if word == "a":
            self.acknowledge()
            return "alarms are silent; they are shown while they last"
        if word == "s":
            self.stand_by()
            return "standby: the rudder is yours"
        if word == "e":
            self.engage(heading_of(rest) if rest else None)
            return "engaging"
        if word == "r":
            angle = math.radians(degrees_of(rest))
            if abs(angle) > self._rudder_max:
                raise InputError(f"rudder {rest}: allowed is up to {math.degrees(self._rudder_max):.0f} deg each side")
            self.plotter.leave()
            self.give(Order(OrderKind.RUDDER, rudder=angle))
            return f"rudder {rest} deg"
        if word[0] in "+-" and not self.wind.following:
            return self._change(turn_of(line.strip().replace(" ", "")))
        answer = self._type_leader(word, rest)
        if answer is None:
            raise InputError(f"{printable(repr(word), SHOWN)} is no command; {HELP}")
        return answer

    def _type_leader(self, word: str, rest: str) -> str | None:
        """Act on a line for those who may lead, and return what to answer; None where it is none of theirs."""
        if word == "f" and not rest:
            self.follow()
            return "following the chart plotter"
        if word == "p":
            self.sail_pattern(pattern_typed(rest))
            return f"pattern {rest}"
        if word == "t":
            return self._follow_route(rest)
        if word == "mob" and rest in ("", "off"):
            return self._type_overboard(rest)
        if word == "swing":
            if rest:
                raise InputError("swing: nothing is allowed behind it; order the course before, or change it with +10")
            self.swing()
            return f"driving on one thruster, by swings about {compass_text(self._order.heading)} deg (e: hold again)"
        return self._type_wind(word, rest) if word in ("w", "tack", "gybe", "y", "n") or word[0] in "+-" else None

    def _change(self, turn: float) -> str:
        tick, order = self._tick, self._order
        is_refused = tick is not None and tick.mode is not Mode.ENGAGED and tick.order.serial == order.serial
        if self._adopt and order.kind is OrderKind.HEADING and not is_refused:
            # the heading is that of the moment in which the pilot engages: the step counts from there
            self._beside += turn
            self.plotter.leave()
            self._take_back()
            return f"engaging {math.degrees(self._beside):+.0f} deg from the present heading"
        if self._order.kind is not OrderKind.HEADING or not math.isfinite(self._order.heading):
            raise InputError("no heading is being steered yet: engage first with e")
        heading = wrap(self._order.heading + turn)
        # the same serial: a change of heading is no request to engage again after an override
        self._order = self._order._replace(heading=heading, is_led=False)
        self.plotter.leave()
        self._take_back()
        return f"heading {compass_text(heading, 1)} deg{self._later()}"

    def _later(self) -> str:
        """Return what is to be said behind an order that is kept while the helm is lost; "" while it is not."""
        has_lost = self._tick is not None and self._tick.mode in (Mode.OVERRIDE, Mode.FAILSAFE, Mode.FAULT)
        return " once the pilot is engaged again; nothing is steered now" if has_lost else ""

    def _type_overboard(self, rest: str) -> str:
        overboard, fix = self.mission.overboard, self.track.fix
        if rest:
            overboard.clear()
            return "nobody is overboard any more"
        overboard.mark(self._tick.now if self._tick is not None else math.inf, fix)
        seen = overboard.seen_from(fix)
        assert seen is not None
        return f"MAN OVERBOARD: bearing {compass_text(seen[0])}, {seen[1]:.0f} m (mob: again; mob off)"

    def _type_wind(self, word: str, rest: str) -> str:
        if word == "w":
            true, degrees = rest.startswith("true"), rest.removeprefix("true").strip()
            self.hold_wind(true, math.radians(degrees_of(degrees)) if degrees else None)
            return f"holding the {'true' if true else 'apparent'} wind's angle{f' of {degrees} deg' if degrees else ''}"
        if word[0] in "+-":
            self.wind.turn_by(turn_of(f"{word}{rest}".replace(" ", "")))
            assert self.wind.hold is not None
            return f"wind angle {math.degrees(self.wind.hold.angle):.0f} deg{self._later()}"
        if rest:
            raise InputError(f"{word}: nothing is allowed behind it")
        if word == "y":
            self.confirm()
            return "turning"
        if word == "n":
            self.wind.decline()
            return "no turn"
        self.ask_turn(Manoeuvre[word.upper()])
        asked = self.wind.asked
        return f"{asked.words if asked else word}: confirm with y within {CONFIRM_S:.0f} s"

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
        self.swings.leave()
        if tick is not None and tick.mode is Mode.ENGAGED and self._order.kind is OrderKind.HEADING:
            self._take_back()
            self.plotter.leave()
        else:
            self.engage(None)
        self._has_led = False

    def hold_wind(self, is_true: bool = False, angle: float | None = None) -> None:
        """Hold an `angle` [rad] of the apparent or the true wind, positive with the wind from starboard, None: the
        present one; engages where no heading is steered yet. Raises InputError."""
        if angle is not None and not abs(angle) <= math.pi:
            raise InputError(f"wind angle {math.degrees(angle):.3g} deg: allowed is -180 to 180")
        is_steered = self._tick is not None and self._tick.mode is Mode.ENGAGED
        held = self.wind.hold if is_steered and not self.wind.lost else None
        if held is not None and angle is not None and held.is_true is is_true:
            # another angle of the same wind is no new hold
            self.wind.turn_by(held.angle - angle)
            return
        now = self._tick.now if self._tick is not None else math.inf
        heading = self._tick.state.heading if self._tick is not None and self._tick.state.valid else math.nan
        self.wind.follow(now, is_true, angle, heading)
        self.hand_to_track()
        self.wind.follow(now, is_true, angle, heading)

    def ask_turn(self, manoeuvre: Manoeuvre, side: int = 0, confirmed: bool = False) -> None:
        """Ask for a tack or gybe, to its side or 0; `confirmed`: begin it at once, where the wind lets that. Raises
        InputError."""
        tick = self._tick
        if tick is None or tick.mode is not Mode.ENGAGED:
            raise InputError(f"{manoeuvre.name.lower()}: nothing is steered: order the wind hold first")
        asked = self.wind.ask(tick.now, manoeuvre, side)
        if not confirmed:
            return
        if self.wind.is_strong(asked):
            speed, most = self.wind.vane.wind.speed, self.wind.settings.gybe_most
            raise InputError(
                f"{asked.words} in {speed:.0f} m/s of wind, more than guidance.gybe_wind_max_m_s ({most:g}): confirm "
                f"it within {CONFIRM_S:.0f} s"
            )
        self.wind.confirm(tick.now)

    def confirm(self) -> None:
        """Begin the tack or gybe that waits. Raises InputError."""
        if self._tick is None or self._tick.mode is not Mode.ENGAGED:
            raise InputError("nothing is steered, and nothing turns: order the wind hold first")
        self.wind.confirm(self._tick.now)

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
        if number == len(kinds):
            self.swing()
            return
        if not 0 <= number < len(kinds):
            raise InputError(f"pattern {number}: allowed is 0 to {len(kinds)}")
        self.sail_pattern(pattern_of(kinds[number], side, sizes))

    def swing(self) -> None:
        """Drive on one thruster, by swings about the course that is held. Raises InputError."""
        tick, order = self._tick, self._order
        if not self.weak:
            raise InputError("swing: no thruster has been found to give too little")
        is_held = tick is not None and tick.mode is Mode.ENGAGED and order.kind is OrderKind.HEADING
        if not is_held or order.is_led or not math.isfinite(order.heading):
            raise InputError("swing: hold the course home first")
        self.swings.follow(self.weak)

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
        self._order, self._beside = back._replace(serial=self._order.serial), 0.0
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
