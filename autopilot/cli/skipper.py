"""The skipper at the terminal: typed lines become orders; every line is an intended action with a new serial."""

from __future__ import annotations

import math

from autopilot.angles import compass_deg, wrap
from autopilot.errors import InputError
from autopilot.order_values import SHOWN, typed_number
from autopilot.printable import printable
from autopilot.signals import Mode, Order, OrderKind, Tick

HELP = (
    "e [DEG]: engage (present heading)  +10, -1: change heading  r DEG: hold a rudder angle  s: standby  "
    "a: silence alarms  q: quit"
)


class Skipper:
    """Holds the present order. Start with `engage`; `type_line` takes what the skipper types."""

    def __init__(self, rudder_max: float) -> None:
        self._rudder_max = rudder_max
        self._order = Order()
        self._adopt = False
        self.quit = False
        self.heard = False
        """Whether alarms have been acknowledged since `Acknowledgements` looked last."""

    def __call__(self, now: float, tick: Tick | None) -> Order:
        """Return the order at `now`; a heading adopted on engagement becomes the heading ordered."""
        if self._adopt and tick is not None and tick.mode is Mode.ENGAGED and tick.order.is_same(self._order):
            self._adopt = False
            self._order = self._order._replace(heading=tick.state.heading)
        return self._order

    def engage(self, heading: float | None) -> None:
        """Order a `heading` [rad], or the present one."""
        self._adopt = heading is None
        self._give(OrderKind.HEADING, heading=math.nan if heading is None else wrap(heading))

    def give(self, order: Order) -> None:
        """Order something else: a trial, a rudder angle."""
        self._adopt = False
        self._order = order._replace(serial=self._order.serial + 1)

    def turn_to(self, heading: float) -> None:
        """Change the heading [rad] ordered; the same serial: no wish to engage again after an override."""
        if self._order.kind is OrderKind.HEADING:
            self._adopt = False
            self._order = self._order._replace(heading=wrap(heading), is_led=False)

    def stand_by(self) -> None:
        """Order the rudder to be given back."""
        self.give(Order())

    def acknowledge(self) -> None:
        """Silence what sounds."""
        self.heard = True

    def type_line(self, line: str) -> str:
        """Act on a typed line and return what to answer. Raises InputError."""
        word, _, rest = line.strip().partition(" ")
        if word in ("", "?", "h", "help"):
            return HELP
        if word == "q":
            self.quit = True
            return "leaving"
        if word == "a":
            self.acknowledge()
            return "alarms are silent; they are shown while they last"
        if word == "s":
            self.give(Order())
            return "standby: the rudder is yours"
        if word == "e":
            self.engage(heading_of(rest) if rest else None)
            return "engaging"
        if word == "r":
            angle = math.radians(_number(rest))
            if abs(angle) > self._rudder_max:
                raise InputError(f"rudder {rest}: allowed is up to {math.degrees(self._rudder_max):.0f} deg each side")
            self.give(Order(OrderKind.RUDDER, rudder=angle))
            return f"rudder {rest} deg"
        if word[0] in "+-":
            return self._change(math.radians(_number(line.strip().replace(" ", ""))))
        raise InputError(f"{printable(repr(word), SHOWN)} is no command; {HELP}")

    def _change(self, turn: float) -> str:
        if self._order.kind is not OrderKind.HEADING or not math.isfinite(self._order.heading):
            raise InputError("no heading is being steered yet: engage first with e")
        heading = wrap(self._order.heading + turn)
        # the same serial: a change of heading is no wish to engage again after an override
        self._order = self._order._replace(heading=heading, is_led=False)
        return f"heading {compass_deg(heading):05.1f} deg"

    def _give(self, kind: OrderKind, heading: float) -> None:
        self._order = Order(kind, heading, serial=self._order.serial + 1)


def heading_of(text: str) -> float:
    """Return a heading typed in degrees, 0 to 360, in rad. Raises InputError."""
    degrees = _number(text)
    if not 0.0 <= degrees <= 360.0:
        raise InputError(f"heading {text}: allowed is 0 to 360 degrees")
    return wrap(math.radians(degrees))


def _number(text: str) -> float:
    try:
        return typed_number(text)
    except InputError as error:
        raise InputError(f"{error} of degrees") from None
