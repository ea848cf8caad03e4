"""What a heading law is: one record of pure functions over NamedTuples, and nobody else asks its name.

A law is one module with a constant LAW, and one line in `autopilot.control.registry`. From that alone follow its
section of the vessel file, its parameters, its place in `autopilot gains`, its margins, and its part in campaigns, for
which numba compiles the very same `step`. A law's memory is a value that the pilot keeps between two ticks.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, NamedTuple

from autopilot.signals import NavState, Reference

if TYPE_CHECKING:
    from autopilot.control.backstepping import BacksteppingGains
    from autopilot.control.limits import RudderLimits
    from autopilot.models.norrbin import Norrbin
    from autopilot.models.steering_gear import SteeringGear


class LawBoat(NamedTuple):
    """What a law's gains are worked out for: model at the speed of the trial, steering gear, what may be ordered of the
    rudder, the dead time [s] from measurement to rudder, and whether steering moves a gear that wears."""

    model: Norrbin
    gear: SteeringGear
    limits: RudderLimits
    delay: float
    wears: bool = True


class RollInput(NamedTuple):
    """Roll [rad], its rate [rad/s] and the age [s] of both; not numbers where no roll was measured."""

    angle: float
    rate: float
    age: float


NO_ROLL = RollInput(math.nan, math.nan, math.inf)


class LawInput(NamedTuple):
    """What a law is given at a tick: the model at the present speed, that speed over the one at which the gains hold,
    the reference, the state to steer by, the roll, the rudder [rad] that its last demand came to once it was limited,
    the largest rudder angle [rad], the time [s] since the tick before, and whether state and reference are those of
    when the rudder has come to the order."""

    model: Norrbin
    ratio: float
    reference: Reference
    state: NavState
    roll: RollInput
    last_rudder: float
    rudder_max: float
    dt: float
    is_ahead: bool = False


class LoopGains(NamedTuple):
    """proportional [rad/rad], integral [1/s], derivative [s]: rudder on heading error, its integral, the rate;
    smoothing [s], the time in which the rudder goes there; ahead [s]: they act on the state so much later, which is
    reckoned from the rudder that was ordered."""

    proportional: float
    integral: float
    derivative: float
    smoothing: float = 0.0
    ahead: float = 0.0


class NoMemory(NamedTuple):
    """What a law without a memory remembers."""


def forgets(gains: object, rudder: float) -> NoMemory:
    """Return the memory of a law that has none."""
    return NoMemory()


def at_any_speed(gains: Any, ratio: float) -> Any:
    """Return the gains of a law that knows no speed."""
    return gains


def as_filed(section: Any, gains: object, ratio: float) -> dict[str, float]:
    """Return the numbers of a section by their keys."""
    return {key: float(value) for key, value in asdict(section).items()}


def in_units_of_file(section: Any, now: tuple[float, ...], filed: tuple[float, ...]) -> dict[str, float]:
    """Return the numbers of a `section` by their keys, each as much changed as `now` is from `filed`, gain by gain."""
    shares = (new / old if old else 1.0 for new, old in zip(now, filed, strict=True))
    return {key: value * share for (key, value), share in zip(as_filed(section, now, 1.0).items(), shares, strict=True)}


class LawDesign(NamedTuple):
    """How sections of a law come about: `of` the loop that was designed for a boat; `quicker` than another, the loop's
    bandwidth times a factor; and `begin`, where a search in simulation begins, from that of the file."""

    of: Callable[[LawBoat, BacksteppingGains], Any]
    quicker: Callable[[Any, float], Any]
    begin: Callable[[Any], Any] = lambda section: section


class Law(NamedTuple):
    """A heading law.

    name: the key of its section in the vessel file's `control`, and its value of `control.law`.
    title, prefix: what heads its gains on a ground station, and begins the names of their parameters.
    section: the frozen dataclass of that section; None: it has no gains.
    numbers: the NamedTuple that `gains(section, boat)` returns, the gains in force; ValueError where they must not be.
    step: the rudder demand [rad], not limited, and the new memory, of gains, memory and input.
    linear: gains with the model at their speed as a linear controller about straight running, for the margins; None:
        the law closes no loop.
    first: memory with which the law begins at a rudder [rad], so that engaging makes no bump.
    at: the gains at so many times the speed at which they hold.
    shown: the gains at so many times that speed, by their keys and in their units, to be read by people.
    design: None: its gains are not worked out by `autopilot gains`, and campaigns do not sail it.
    uses_bias: it steers by the estimated bias; False: it learns wind and trim by itself.
    takes_roll: it damps roll too, where roll is measured.
    advice: where its gains come from where nothing works them out, for those who have none.
    """

    name: str
    title: str
    prefix: str
    section: type[Any] | None
    numbers: type[Any]
    gains: Callable[[Any, LawBoat], Any]
    step: Callable[[Any, Any, LawInput], tuple[float, Any]]
    linear: Callable[[Any, Norrbin], LoopGains] | None
    first: Callable[[Any, float], Any] = forgets
    at: Callable[[Any, float], Any] = at_any_speed
    shown: Callable[[Any, Any, float], dict[str, float]] = as_filed
    design: LawDesign | None = None
    uses_bias: bool = True
    takes_roll: bool = False
    advice: str = ""


class LawInForce(NamedTuple):
    """A law with the gains of a boat."""

    kind: Law
    gains: Any

    @property
    def name(self) -> str:
        """The law's name."""
        return self.kind.name

    def first(self, rudder: float) -> Any:
        """Return the memory with which the law begins at `rudder` [rad]."""
        return self.kind.first(self.gains, rudder)

    def step(self, memory: Any, given: LawInput) -> tuple[float, Any]:
        """Return the rudder demand [rad] and the new memory."""
        return self.kind.step(self.gains, memory, given)
