"""What a kind of fault says of itself: what it does, how large it is, and where in the simulator it acts.

A kind is a line in the table KINDS of one of the modules that `sitl.registry` names. It acts by a function at one of
the places below, which is called while it is at work, or by what it silences; nobody else asks its name.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from autopilot.models.steering_gear import SteeringGear
from sitl.boat import Disturbance

if TYPE_CHECKING:
    from sitl.firmware import Firmware
    from sitl.sensors import Reading


COMPASS, GPS, RECEIVER, EVERYTHING = "compass", "GPS", "receiver", "everything"
"""What can fall silent beside single messages: the compass, the GPS, the radio receiver, the whole boat."""


class Acting(NamedTuple):
    """A fault at work: its size, the time [s since the start], what it remembers while it lasts, and for how long [s]
    it has been at work."""

    size: float
    time: float
    memory: dict[str, Any]
    lasted: float


class Dice(NamedTuple):
    """The chance of one instrument: standard normal deviates, and shares from 0 to 1."""

    deviate: Callable[[], float]
    share: Callable[[], float]


class Damage(NamedTuple):
    """How bad a line is: shares of packets, seconds, and packets of noise a second; still: nothing passes."""

    loss: float = 0.0
    delay: float = 0.0
    jitter: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    corrupt: float = 0.0
    truncate: float = 0.0
    flood: float = 0.0
    still: bool = False


class Ordered(NamedTuple):
    """An order [rad] on its way to the steering gear, and the rudder [rad] as it stands."""

    gear: SteeringGear
    order: float
    rudder: float


class Moved(NamedTuple):
    """A rudder [rad] that the gear has moved in `dt` [s]."""

    gear: SteeringGear
    before: float
    after: float
    dt: float


class Kind(NamedTuple):
    """What a fault does; `unit` of its size, empty where it has none, the default size, and its range.

    of_a_compass: one of two compasses may have it, with its rate gyro. silences: messages and sentences that it keeps
    from being sent or, sent to the flight controller, from being obeyed; and COMPASS, GPS, RECEIVER, EVERYTHING.
    order: what the gear is given for an order [rad]. reached: where the rudder [rad] really is. thrust: the speed [m/s]
    that the engine reaches, of that which is asked for and that of the start. motors: what the left and the right
    thruster of two run at, -1 to 1; bow: what a bow thruster does. push: what acts on the boat, of its heading [rad].
    reads: what an instrument shows.
    latency: when [s] it is heard of. attitude: the heading [rad] that ATTITUDE carries. charge: the per cent that
    SYS_STATUS says of the battery. variance: what EKF_STATUS_REPORT says of the compass. happens: what is done to the
    firmware, when it begins. sticks: where a hand has the radio's channels [us]. line: how bad the lines are; to_boat:
    on the way to the boat alone.
    """

    what: str
    unit: str = ""
    size: float = 1.0
    low: float = 1.0
    high: float = 1.0
    of_a_compass: bool = False
    silences: tuple[str, ...] = ()
    order: Callable[[Acting, Ordered], float] | None = None
    reached: Callable[[Acting, Moved], float] | None = None
    thrust: Callable[[Acting, float, float], float] | None = None
    motors: Callable[[Acting, tuple[float, float]], tuple[float, float]] | None = None
    bow: Callable[[Acting, float], float] | None = None
    push: Callable[[Acting, float, Disturbance], Disturbance] | None = None
    reads: Callable[[Acting, Reading, Dice], Reading] | None = None
    latency: Callable[[Acting, float], float] | None = None
    attitude: Callable[[Acting, float], float] | None = None
    charge: Callable[[Acting, float], float] | None = None
    variance: Callable[[Acting, float], float] | None = None
    happens: Callable[[Acting, Firmware], None] | None = None
    sticks: Callable[[Acting, Firmware], dict[int, int]] | None = None
    line: Callable[[Acting, Damage], Damage] | None = None
    to_boat: Callable[[Acting, Damage], Damage] | None = None
