"""Orders of a helm display to the boat: command by command, each asked until it is acknowledged or given up. Pure.

Changing course from a display: step by step, and aside for a while with the way back. Pure.

Every change is sent as a whole heading: an order that is repeated because its answer was lost must not turn twice.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from enum import Enum
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.firmware.protocol import Target
from autopilot.links.ground_station.commands import HOLD_APPARENT, HOLD_TRUE, WINDWARD
from autopilot.links.ground_station.orders import HEADING, MANUAL, TRACK, TRIAL, WIND
from autopilot.links.mavlink.codec import Message
from autopilot.links.mavlink.frames import CommandCancel
from autopilot.web.view import BoatView, TextPieces

AGAIN_S = 0.5
TRIES = 4
LATE_S = 5.0
"""An acknowledgement may come so long after what it answers: there and back on a slow radio."""
WAITING_MOST = 8
"""Orders that wait behind one that is not answered; beyond them the link is as good as gone."""
CANCELLED = 6


class Answer(Enum):
    """How an order ended; true where it was taken."""

    TAKEN = "taken"
    REFUSED = "refused: why stands in a text of its own"
    FAILED = "not carried out"
    SILENT = "not answered"

    def __bool__(self) -> bool:
        return self is Answer.TAKEN


RESULTS = {
    dialect.MAV_RESULT_TEMPORARILY_REJECTED: (Answer.REFUSED, "refused for now"),
    dialect.MAV_RESULT_DENIED: (Answer.REFUSED, "refused"),
    dialect.MAV_RESULT_UNSUPPORTED: (Answer.FAILED, "not known to this pilot"),
    dialect.MAV_RESULT_FAILED: (Answer.FAILED, "failed"),
    CANCELLED: (Answer.FAILED, "cancelled"),
}
DONE = (int(dialect.MAV_RESULT_ACCEPTED), int(dialect.MAV_RESULT_IN_PROGRESS))
NO_ANSWER = "the boat does not answer"
NOTHING_STEERED = "engage first: no course is being steered"

OnDone = Callable[[Answer, str], None]
"""How an order ended, and that in words for people."""
Asked = Callable[[float, OnDone], None]
"""What carries an order out at a time [s], and is called with how it ended."""
REASON_S = 1.2
"""Why something was refused comes as a text of its own, after the refusal, in pieces."""


class Command(NamedTuple):
    """One COMMAND_LONG: its number and its first parameters."""

    number: int
    parameters: tuple[float, ...] = ()

    def message(self, target: Target, confirmation: int) -> Message:
        """Return the message to the target."""
        values = (*self.parameters, *[0.0] * (7 - len(self.parameters)))
        return dialect.MAVLink_command_long_message(target.system, target.component, self.number, confirmation, *values)


def _mode(mode: int) -> Command:
    return Command(int(dialect.MAV_CMD_DO_SET_MODE), (float(dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), float(mode)))


ARM = Command(int(dialect.MAV_CMD_COMPONENT_ARM_DISARM), (1.0,))
STANDBY = _mode(MANUAL)
RELEASE = (STANDBY, Command(int(dialect.MAV_CMD_COMPONENT_ARM_DISARM), (0.0,)))
"""Rudder given back, and nobody engages again before arming. Standby comes first: it is what counts."""
ENGAGE = (ARM, _mode(HEADING))
FOLLOW = (ARM, _mode(TRACK))


def turn_to(heading_deg: float) -> Command:
    """Return the command that orders a heading [deg]."""
    return Command(int(dialect.MAV_CMD_CONDITION_YAW), (heading_deg % 360.0, 0.0, 0.0, 0.0))


def hold_wind(is_true: bool, degrees: float | None) -> tuple[Command, ...]:
    """Return the commands that hold an angle of the wind [deg], None: the present one."""
    angle = math.nan if degrees is None else degrees
    return ARM, Command(WINDWARD, (float(HOLD_TRUE if is_true else HOLD_APPARENT), angle))


class _Refused(NamedTuple):
    said: int
    until: float
    words: str
    on_done: OnDone


class Reasons:
    """Lets a refusal wait for the boat's own words, which come as a text: `explained` is called in their place."""

    def __init__(self, texts: TextPieces) -> None:
        self._texts = texts
        self._refused: list[_Refused] = []

    def explained(self, on_done: OnDone) -> OnDone:
        """Return what hears of an order that is given now, and tells `on_done` when there is no more to wait for."""
        said = self._texts.count

        def heard(answer: Answer, words: str) -> None:
            if answer is Answer.REFUSED:
                self._refused.append(_Refused(said, math.inf, words, on_done))
            else:
                on_done(answer, words)

        return heard

    def update(self, now: float) -> None:
        """Tell of what was refused, in the boat's words where they have come, without them where they do not."""
        waiting, self._refused = self._refused, []
        for each in waiting:
            words = [text.words for text in self._texts.kept if text.number > each.said]
            if words or now >= each.until:
                each.on_done(Answer.REFUSED, (words or [each.words])[-1])
            else:
                self._refused.append(each._replace(until=min(each.until, now + REASON_S)))


class _Waiting(NamedTuple):
    """An order; hearers: who gave it, each with how many of its commands carry theirs out."""

    commands: tuple[Command, ...]
    hearers: tuple[tuple[int, OnDone], ...]

    def tell(self, answer: Answer, words: str) -> None:
        for _, on_done in self.hearers:
            on_done(answer, words)

    def parted(self, step: int) -> tuple[_Waiting, _Waiting]:
        """Return the order for those whose last command was the one before `step`, and for all others."""
        done = tuple(hearer for hearer in self.hearers if hearer[0] == step)
        left = tuple(hearer for hearer in self.hearers if hearer[0] != step)
        return self._replace(hearers=done), self._replace(hearers=left)


class Orders:
    """Carries orders out one after the other; `first` goes before all that waits.

    Where the boat does not answer nothing is kept for later: a course that was meant a while ago may lead anywhere now.
    """

    def __init__(self) -> None:
        self._waiting: deque[_Waiting] = deque()
        self._step = 0
        self._tries = 0
        self._next = -math.inf
        self._cancels: list[int] = []
        self._sent: deque[tuple[float, Command]] = deque()
        """When what was sent that is not acknowledged yet; of one that was repeated each time is."""
        self._foreign = 0
        """Acknowledgements that may still come of orders before: they name the command, not what was asked by it."""
        self._most, self._trip = TRIES, 0.0
        """_trip: how long [s] the last answer took that could be to one message alone."""

    def give(self, commands: Sequence[Command], on_done: OnDone) -> None:
        """Give an order; `on_done` hears once how it ended."""
        if len(self._waiting) >= WAITING_MOST:
            on_done(Answer.SILENT, NO_ANSWER)
            return
        self._waiting.append(_Waiting(tuple(commands), ((len(commands), on_done),)))

    def first(self, commands: Sequence[Command], on_done: OnDone) -> None:
        """Give an order that takes the pilot from the helm: it goes at once, and what waits is dropped.

        One of the same kind that waits is not: it is this one, given by two hands. The one that goes further is carried
        out, and each hears how its own ends.
        """
        order, dropped = _Waiting(tuple(commands), ((len(commands), on_done),)), list[_Waiting]()
        for each in self._waiting:
            if each.commands[0] == order.commands[0]:
                order = _Waiting(max(each.commands, order.commands, key=len), each.hearers + order.hearers)
            else:
                dropped.append(each)
        self._waiting = deque([order])
        self._step = self._tries = 0
        self._next = -math.inf
        for each in dropped:
            each.tell(Answer.FAILED, "dropped: the rudder is given back")

    def cancel(self, command: int) -> None:
        """End a trial before its time."""
        self._cancels.append(command)

    def give_up(self) -> None:
        """End what waits: there is no boat to order, and who comes back later must not find it."""
        self._cancels.clear()
        for _ in range(len(self._waiting)):
            self._end(Answer.SILENT, NO_ANSWER)

    def receive(self, now: float, message: Message) -> None:
        """Take a COMMAND_ACK of the boat."""
        answered = next((each for each in self._sent if each[1].number == message.command), None)
        if answered is not None:
            self._sent.remove(answered)
        if not self._waiting or self._tries == 0:
            return
        order = self._waiting[0]
        if message.command != order.commands[self._step].number:
            return
        if self._foreign:
            self._foreign -= 1
            return
        trip = now - (self._next - AGAIN_S)
        if self._tries == 1:
            self._trip = trip
        elif self._tries == 2 and 0.5 * self._trip <= trip <= 2.0 * self._trip:
            # said again because one was lost, not because answers take so long: no second one will come
            self._sent = deque(each for each in self._sent if each[1].number != message.command)
        if message.result not in DONE:
            self._end(*RESULTS.get(message.result, (Answer.FAILED, f"result {message.result}")))
        elif self._step + 1 == len(order.commands):
            self._end(Answer.TAKEN, "")
        else:
            self._step, self._tries, self._next = self._step + 1, 0, -math.inf
            done, self._waiting[0] = order.parted(self._step)
            done.tell(Answer.TAKEN, "")

    def due(self, now: float, target: Target) -> list[Message]:
        """Return what to send at `now` [s]."""
        while self._sent and now - self._sent[0][0] > LATE_S:
            self._sent.popleft()
        messages: list[Message] = [CommandCancel(*target[:2], command) for command in self._cancels]
        self._cancels.clear()
        if not self._waiting or now < self._next:
            return messages
        if self._tries >= self._most:
            self.give_up()
            return messages
        command = self._waiting[0].commands[self._step]
        if self._tries == 0:
            # what is acknowledged next may be one before: this one would be lost, or refused, behind it and said taken
            self._foreign = sum(sent.number == command.number and sent != command for _, sent in self._sent)
            self._most = TRIES + self._foreign
        messages.append(command.message(target, self._tries))
        self._sent.append((now, command))
        self._tries += 1
        self._next = now + AGAIN_S
        return messages

    def _end(self, answer: Answer, words: str) -> None:
        order = self._waiting.popleft()
        self._step = self._tries = 0
        self._next = -math.inf
        order.tell(answer, words)


STEERED = (HEADING, TRACK, WIND)
UNTOLD_S = 3.0
"""A step waits so long [s] for the boat to tell which heading it was engaged on: an answer and a report later."""
ECHO_S = 1.5
"""So long after our own order was taken [s] the heading that the boat tells may still be the one before it."""


class _Meant(NamedTuple):
    """A heading [deg], or where `is_true` is not None an angle of the true or of the apparent wind [deg]; nan: the one
    that was present when it was ordered, which the boat alone can tell."""

    degrees: float
    is_true: bool | None = None

    @property
    def is_wind(self) -> bool:
        return self.is_true is not None

    def turned(self, degrees: float) -> _Meant:
        """Return it turned by so many degrees, positive to starboard: an angle of the wind gets less."""
        turned = self.degrees + (-degrees if self.is_wind else degrees)
        return self._replace(degrees=math.remainder(turned, 360.0) if self.is_wind else turned % 360.0)

    @property
    def command(self) -> Command:
        """The command that orders it while something is steered."""
        return turn_to(self.degrees) if self.is_true is None else hold_wind(self.is_true, self.degrees)[-1]


class _Step(NamedTuple):
    """What waits since [s] for the boat to tell what it holds: `act` takes that."""

    since: float
    act: Callable[[_Meant], None]
    on_done: OnDone


class Course:
    """Turns the boat over `orders`: to another heading, or in a wind hold to another angle of the wind.

    Attributes:
        before: the heading, or angle of the wind, [deg] ordered before the first step aside, None where nobody dodges.
    """

    def __init__(self, given: Orders, view: BoatView) -> None:
        self._orders, self._view = given, view
        self._now = self._taken_at = -math.inf
        self._taken: _Meant | None = None
        self._under_way: dict[int, _Meant] = {}
        """What is meant by orders that are not answered yet, by their numbers, the newest last."""
        self._steps: list[_Step] = []
        self._count = 0
        self._is_wind = self._is_steered = False
        self._compass: float | None = None
        self._way_back: _Meant | None = None
        self.before: float | None = None

    def turn_by(self, now: float, degrees: float, on_done: OnDone) -> None:
        """Turn by so many degrees, positive to starboard."""
        self._from_base(_Step(now, lambda base: self._order(base.turned(degrees), on_done), on_done), now)

    def engage(self, _: float, on_done: OnDone) -> None:
        """Steer the present heading; where a heading is steered already, that one."""
        self.drop_steps()
        self._give(_Meant(math.nan), ENGAGE, on_done)

    def turn_to(self, _: float, heading_deg: float, on_done: OnDone) -> None:
        """Order a heading [deg]."""
        self.drop_steps()
        self._order(_Meant(heading_deg % 360.0), on_done)

    def hold_wind(self, is_true: bool, degrees: float | None, on_done: OnDone) -> None:
        """Hold an angle of the wind [deg], None: the present one."""
        self.drop_steps()
        meant = _Meant(math.nan if degrees is None else degrees, is_true)
        self._give(meant, hold_wind(is_true, degrees), on_done)

    def dodge(self, now: float, degrees: float, on_done: OnDone) -> None:
        """Step aside by so many degrees; again: further. What was steered before the first step is kept."""
        is_route = self._view.mode == TRACK

        def aside(base: _Meant) -> None:
            def noted(taken: Answer, words: str) -> None:
                if taken and self.before is None:
                    self.before, self._way_back = base.degrees, None if is_route else base
                on_done(taken, words)

            self._order(base.turned(degrees), noted)

        self._from_base(_Step(now, aside, on_done), now)

    def back(self, _: float, on_done: OnDone) -> None:
        """Go back to the course that was steered before, to the angle of the wind, or to the route."""
        if self.before is None:
            on_done(Answer.FAILED, "nothing to go back to")
            return
        self.drop_steps()

        def noted(taken: Answer, words: str) -> None:
            if taken:
                self.before = None
            on_done(taken, words)

        if self._way_back is None:
            self._orders.give(FOLLOW, noted)
        else:
            self._order(self._way_back, noted)

    def update(self, now: float) -> None:
        """Forget the way back, and what was meant, when at `now` [s] nobody steers any more, not to the same, or by
        another compass."""
        self._now = now
        is_wind, compass = self._view.mode == WIND, self._view.value("compass")
        is_steered = self._view.mode in STEERED
        is_over = (self._is_steered and not is_steered) or compass != self._compass
        if is_over or not is_steered or is_wind is not self._is_wind:
            self.before = None
            meant = self._meant(now)
            begins = meant is not None and math.isnan(meant.degrees) and not is_steered
            if is_over or not (begins or (is_steered and meant is not None and meant.is_wind is is_wind)):
                self._taken_at = -math.inf
                self._under_way.clear()
        self._is_wind, self._is_steered, self._compass = is_wind, is_steered, compass
        steps, self._steps = self._steps, []
        for step in steps:
            self._from_base(step, now)

    def give_up(self) -> None:
        """End what waits for the boat's word: nobody hears it."""
        self.drop_steps(Answer.SILENT, NO_ANSWER)

    def drop_steps(self, answer: Answer = Answer.FAILED, words: str = "dropped: another course is ordered") -> None:
        """End what waits: a step counts from what was held as it was ordered, not from what is ordered behind it."""
        steps, self._steps = self._steps, []
        for step in steps:
            step.on_done(answer, words)

    def _from_base(self, step: _Step, now: float) -> None:
        """Take a step from what is held, or meant to be, as soon as the boat has said which that is."""
        base, mode = self._base(now), self._view.mode
        if base is not None and not math.isnan(base.degrees):
            step.act(base)
        elif base is not None and now - step.since <= UNTOLD_S:
            self._steps.append(step)
        elif base is not None:
            step.on_done(Answer.FAILED, "the boat has not said yet what it holds: once more")
        else:
            nothing = "a trial is being sailed: end it first" if mode == TRIAL else NOTHING_STEERED
            step.on_done(Answer.FAILED, nothing)

    def _base(self, now: float) -> _Meant | None:
        """Return what is held, or meant to be, its degrees nan where the boat has still to say them; None: nothing."""
        view, meant = self._view, self._meant(now)
        is_wind, is_steered = view.mode == WIND, view.mode in STEERED
        if not is_steered and (meant is None or not math.isnan(meant.degrees)):
            return None
        said, age = view.value("wind_angle" if is_wind else "order"), view.age("wind" if is_wind else "rudder", now)
        if meant is not None:
            is_said = meant.is_wind is is_wind and age is not None and age < now - self._taken_at
            if self._under_way or not (is_steered and is_said and math.isnan(meant.degrees)):
                return meant
        return None if said is None else _Meant(said, bool(view.value("wind_true")) if is_wind else None)

    def _meant(self, now: float) -> _Meant | None:
        """Return what our newest order means, which the boat may not show yet."""
        if self._under_way:
            return next(reversed(self._under_way.values()))
        is_newest = now - self._taken_at < ECHO_S and self._taken_at > self._view.stood_by
        return self._taken if is_newest else None

    def _order(self, meant: _Meant, on_done: OnDone) -> None:
        self._give(meant, (meant.command,), on_done)

    def _give(self, meant: _Meant, commands: Sequence[Command], on_done: OnDone) -> None:
        """Give an order, and go by what is meant until the boat tells it."""
        number = self._count = self._count + 1
        self._under_way[number] = meant

        def noted(taken: Answer, words: str) -> None:
            if self._under_way.pop(number, None) is not None and taken:
                self._taken, self._taken_at = meant, self._now
            on_done(taken, words)

        self._orders.give(commands, noted)
