"""Faults of instruments, of rudder and engine, of the flight controller, and of the lines to the boat.

What a kind of fault says of itself (`Kind`): what it does, how large it is, and where in the simulator it acts. A kind
is a line in the table KINDS of one of the modules that `sitl.registry` names. It acts by a function at one of the
places below, which is called while it is at work, or by what it silences; nobody else asks its name.

Faults of one instrument act one after the other: what is late or frozen first, then what is added to it. Texts of the
flight controller are those of ArduRover 4.6: AC_Fence.cpp ("Polygon fence breached", notice) and AP_BattMonitor.cpp
("Battery 1 is low ...", warning). ArduRover has no text of its own for shallow water; boats say it from a script.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from autopilot.angles import wrap, wrap_positive
from autopilot.models.steering_gear import SteeringGear, clip
from sitl.boat import EARTH_RADIUS, Disturbance

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


if TYPE_CHECKING:
    from sitl.firmware import Firmware
    from sitl.sensors import Reading

TRAILING_S = 0.5
"""A rudder that nothing holds trails amidships with this time constant; assumed."""
UNLIMITED = math.radians(20.0)
"""Rate [rad/s] of which a slow rudder has a share, where the file knows no rate."""


def delayed(waiting: deque[tuple[float, float]], time: float, value: float, delay: float) -> float:
    """Return the value that was `delay` [s] ago, the first of all where `waiting` does not go back so far.

    `waiting` holds (time [s], value), the oldest first; `value` is added to it.
    """
    waiting.append((time, value))
    while len(waiting) > 1 and waiting[1][0] <= time - delay + 1.0e-9:
        waiting.popleft()
    return waiting[0][1]


def late_order(fault: Acting, given: Ordered) -> float:
    """Return the order of some time ago."""
    return delayed(fault.memory.setdefault("waiting", deque()), fault.time, given.order, fault.size)


def play(fault: Acting, given: Ordered) -> float:
    """Return where the gear drags the rudder along at either end of the play."""
    half = math.radians(fault.size)
    return clip(given.rudder, given.order - half, given.order + half)


def slow(fault: Acting, moved: Moved) -> float:
    """Return as far as a share of the rate gets."""
    rate = moved.gear.rate_max if math.isfinite(moved.gear.rate_max) else UNLIMITED
    return clip(moved.after, moved.before - fault.size * rate * moved.dt, moved.before + fault.size * rate * moved.dt)


def one_way(fault: Acting, moved: Moved) -> float:
    """Return the rudder of a gear of which one valve, or one direction of the pump, is dead."""
    return max(moved.after, moved.before) if fault.size > 0.0 else min(moved.after, moved.before)


def creeping(fault: Acting, moved: Moved) -> float:
    """Return a rudder that leaking oil lets go by so much a second, to starboard for a positive size."""
    most = moved.gear.angle_max
    return clip(moved.after + math.radians(fault.size) * moved.dt, -most, most)


def trailing(fault: Acting, moved: Moved) -> float:
    """Return a rudder on its way amidships by itself."""
    return moved.before * math.exp(-moved.dt / TRAILING_S)


def one_fouled(fault: Acting, pair: tuple[float, float]) -> tuple[float, float]:
    """Return a pair of thrusters of which the right one, or for a negative size the left one, has weed on it, which
    takes such a share of its thrust."""
    left = math.sqrt(1.0 - max(-fault.size, 0.0))
    right = math.sqrt(1.0 - max(fault.size, 0.0))
    return left * pair[0], right * pair[1]


def streamed(fault: Acting, heading: float, on: Disturbance) -> Disturbance:
    """Return what acts on the boat, with a stream along the heading at which it began."""
    towards = fault.memory.setdefault("towards", heading)
    return on._replace(
        current_north=on.current_north + fault.size * math.cos(towards),
        current_east=on.current_east + fault.size * math.sin(towards),
    )


Reads = Callable[[Acting, "Reading", Dice], "Reading"]
SPEEDS = ("water_speed", "ground_speed", "north_speed", "east_speed")
"""Through the water, over the ground, and that one's parts: a GPS is wrong in all of them at once."""
WRAPPED = {"heading": wrap_positive, "wind_angle": wrap}
"""What an instrument shows as an angle of one turn."""


def _frozen(*fields: str) -> Reads:
    """Show what was shown when it began."""

    def reads(fault: Acting, reading: Reading, dice: Dice) -> Reading:
        return reading._replace(**fault.memory.setdefault("shown", {name: getattr(reading, name) for name in fields}))

    return reads


def _old(field: str) -> Reads:
    """Show the value of some time ago, under the time stamp of now."""

    def reads(fault: Acting, reading: Reading, dice: Dice) -> Reading:
        waiting = fault.memory.setdefault("waiting", deque())
        return reading._replace(**{field: delayed(waiting, fault.time, getattr(reading, field), fault.size)})

    return reads


def _times(*fields: str) -> Reads:
    """Show so many times the values."""
    return lambda fault, reading, dice: reading._replace(
        **{name: getattr(reading, name) * fault.size for name in fields}
    )


def _beside(field: str, off: Callable[[Acting, Dice], float]) -> Reads:
    """Show a value that is off the true one by so much, in the reading's unit."""

    def reads(fault: Acting, reading: Reading, dice: Dice) -> Reading:
        return reading._replace(**{field: WRAPPED.get(field, float)(getattr(reading, field) + off(fault, dice))})

    return reads


def by_degrees(fault: Acting, dice: Dice) -> float:
    """Return the size, of degrees, in radians."""
    return math.radians(fault.size)


def by_chance(fault: Acting, dice: Dice) -> float:
    """Return noise whose standard deviation is the size, of degrees."""
    return math.radians(fault.size) * dice.deviate()


def spikes(fault: Acting, dice: Dice) -> float:
    """Return any angle at all now and then, else none."""
    return 2.0 * math.pi * dice.share() if dice.share() < fault.size else 0.0


STICK_FULL_US = 500
SWITCH_LOW_US = 1000
EMPTY_MV, FULL_MV = 10500, 12600
CAPACITY_MAH = 10000


def battery_mv(per_cent: float) -> int:
    """Return the voltage [mV] of a battery that is so full; linear, assumed."""
    return round(EMPTY_MV + (FULL_MV - EMPTY_MV) * per_cent / 100.0)


def mode(fault: Acting, firmware: Firmware) -> None:
    """Change the mode."""
    firmware.set_mode(round(fault.size))


def disarm(fault: Acting, firmware: Firmware) -> None:
    """Disarm."""
    firmware.set_armed(False)


def clock_step(fault: Acting, firmware: Firmware) -> None:
    """Put the clock forward."""
    firmware.boot_time -= fault.size


def battery_low(fault: Acting, firmware: Firmware) -> None:
    """Say that the battery is low."""
    volts, used = battery_mv(fault.size) / 1000.0, CAPACITY_MAH * (1.0 - fault.size / 100.0)
    firmware.notices.append((4, f"Battery 1 is low {volts:.2f}V used {used:.0f} mAh"))


def stick(fault: Acting, firmware: Firmware) -> dict[int, int]:
    """Move both axes of the stick, as a hand that grabs it does."""
    pulse = 1500 + round(fault.size * STICK_FULL_US)
    return {firmware.setup.steering_channel: pulse, firmware.setup.pitch_channel: pulse}


def steering_stick(fault: Acting, firmware: Firmware) -> dict[int, int]:
    """Move the steering axis."""
    return {firmware.setup.steering_channel: 1500 + round(fault.size * STICK_FULL_US)}


def switch(fault: Acting, firmware: Firmware) -> dict[int, int]:
    """Put the switch for overrides low, where there is one."""
    channel = firmware.setup.override_switch
    return {} if channel is None else {channel: SWITCH_LOW_US}


def receiver_low(fault: Acting, firmware: Firmware) -> dict[int, int]:
    """Put the throttle where a receiver without a radio puts it."""
    return {firmware.setup.throttle_channel: round(fault.size)}


def _size(fault: Acting, usual: float) -> float:
    return fault.size


def _still(fault: Acting, damage: Damage) -> Damage:
    return damage._replace(still=True)


def _bad(field: str) -> Callable[[Acting, Damage], Damage]:
    """Return what gives one field of the damage the fault's size."""
    return lambda fault, damage: Damage(**damage._asdict() | {field: fault.size})


def _chance(what: str, size: float, field: str) -> Kind:
    return Kind(what, "share of packets", size, 0.0, 1.0, line=_bad(field))


def _compass(reads: Reads, what: str, unit: str = "", size: float = 1.0, low: float = 1.0, high: float = 1.0) -> Kind:
    return Kind(what, unit, size, low, high, of_a_compass=True, reads=reads)


KINDS = {
    "heading_dropout": Kind("the compass sends nothing", silences=("ATTITUDE", COMPASS), of_a_compass=True),
    "rate_lag": _compass(_old("rate"), "rates of turn are older than their time stamps say", "s", 0.3, 0.0, 10.0),
    "rate_frozen": _compass(_frozen("rate", "roll_rate"), "the rate gyro repeats its last value"),
    "rate_reversed": _compass(
        lambda fault, reading, dice: reading._replace(rate=-reading.rate), "the rate gyro has the wrong sign"
    ),
    "rate_bias": _compass(_beside("rate", by_degrees), "the rate gyro is off by a constant", "deg/s", 5.0, -90.0, 90.0),
    "rate_noise": _compass(
        _beside("rate", by_chance), "the rate gyro is noisy, standard deviation", "deg/s", 5.0, 0.0, 90.0
    ),
    "rate_scaled": _compass(
        _times("rate"),
        "the rate gyro's scale is wrong, 57.3 for degrees that are taken for radians",
        "times",
        57.3,
        -100.0,
        100.0,
    ),
    "heading_late": Kind(
        "heading, rate and roll leave the sensor late",
        "s",
        1.0,
        0.0,
        10.0,
        latency=lambda fault, latency: latency + fault.size,
    ),
    "heading_lag": _compass(_old("heading"), "headings are older than their time stamps say", "s", 0.3, 0.0, 10.0),
    "heading_frozen": _compass(_frozen("heading"), "the compass repeats its last heading"),
    "heading_jump": _compass(
        _beside("heading", by_degrees), "the compass is off by a constant", "deg", 40.0, -180.0, 180.0
    ),
    "heading_drift": _compass(
        _beside("heading", lambda fault, dice: math.radians(fault.size * fault.lasted)),
        "the compass wanders off",
        "deg/s",
        1.0,
        -30.0,
        30.0,
    ),
    "heading_noise": _compass(
        _beside("heading", by_chance), "the compass is noisy, standard deviation", "deg", 10.0, 0.0, 180.0
    ),
    "heading_spikes": _compass(
        _beside("heading", spikes), "single headings are anything at all", "share of headings", 0.1, 0.0, 1.0
    ),
    "heading_nan": Kind(
        "the flight controller sends a heading that is no number", attitude=lambda fault, heading: math.nan
    ),
    "speed_lost": Kind(
        "no speed, through the water or over the ground, is sent",
        silences=("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED", "VFR_HUD", "VHW", "VTG"),
    ),
    "log_lost": Kind("no speed through the water is sent; that over the ground remains", silences=("VHW",)),
    "speed_frozen": Kind("speeds repeat their last values", reads=_frozen(*SPEEDS)),
    "speed_wrong": Kind("speeds are multiplied", "times", 3.0, 0.0, 100.0, reads=_times(*SPEEDS)),
    "position_lost": Kind("the GPS has no position", silences=("RMC", GPS)),
    "wind_lost": Kind("no wind is sent", silences=("MWV", "WIND")),
    "wind_frozen": Kind("the wind vane repeats its last wind", reads=_frozen("wind_angle", "wind_speed")),
    "wind_jump": Kind(
        "the wind vane is off by a constant", "deg", 40.0, -180.0, 180.0, reads=_beside("wind_angle", by_degrees)
    ),
    "position_jump": Kind(
        "the GPS shows a place to the north",
        "m",
        200.0,
        -20000.0,
        20000.0,
        reads=_beside("latitude", lambda fault, dice: math.degrees(fault.size / EARTH_RADIUS)),
    ),
    "rudder_late": Kind("orders reach the steering gear late", "s", 0.3, 0.0, 10.0, order=late_order),
    "rudder_reversed": Kind("the rudder goes to the other side", order=lambda fault, given: -given.order),
    "rudder_offset": Kind(
        "the linkage has slipped",
        "deg",
        8.0,
        -45.0,
        45.0,
        order=lambda fault, given: given.order + math.radians(fault.size),
    ),
    "rudder_hard_over": Kind(
        "the rudder runs to a stop, starboard for a positive size",
        "sign",
        1.0,
        -1.0,
        1.0,
        order=lambda fault, given: math.copysign(given.gear.angle_max, fault.size),
    ),
    "rudder_play": Kind("the linkage has play, each way", "deg", 3.0, 0.0, 45.0, order=play),
    "rudder_slow": Kind("the rudder moves at a share of its rate", "share of the rate", 0.1, 0.0, 1.0, reached=slow),
    "rudder_limited": Kind(
        "the rudder meets a stop at this angle",
        "deg",
        5.0,
        0.0,
        45.0,
        reached=lambda fault, moved: clip(moved.after, -math.radians(fault.size), math.radians(fault.size)),
    ),
    "rudder_free": Kind("the linkage is broken: the rudder trails amidships", reached=trailing),
    "rudder_stuck": Kind("the rudder stays where it is", reached=lambda fault, moved: moved.before),
    "rudder_one_way": Kind(
        "the rudder moves to one side only, to starboard for a positive size", "sign", 1.0, -1.0, 1.0, reached=one_way
    ),
    "rudder_creeps": Kind("the rudder creeps by itself", "deg/s", 0.2, -5.0, 5.0, reached=creeping),
    "feedback_lost": Kind("the rudder sensor sends nothing", silences=("SERVO_OUTPUT_RAW", "RC_CHANNELS", "RSA")),
    "feedback_frozen": Kind("the rudder sensor repeats its last angle", reads=_frozen("rudder")),
    "feedback_offset": Kind(
        "the rudder sensor is off by a constant", "deg", 8.0, -45.0, 45.0, reads=_beside("rudder", by_degrees)
    ),
    "engine_astern": Kind(
        "the engine pushes astern, a share of the speed",
        "share of the speed",
        0.5,
        0.0,
        1.0,
        thrust=lambda fault, thrust, cruise: -fault.size * cruise,
    ),
    "engine_stopped": Kind("the engine gives no thrust", thrust=lambda fault, thrust, cruise: 0.0),
    "thruster_dead": Kind(
        "one of two thrusters stands still, the right one for a positive size",
        "sign",
        -1.0,
        -1.0,
        1.0,
        motors=lambda fault, pair: (pair[0], 0.0) if fault.size > 0.0 else (0.0, pair[1]),
    ),
    "thruster_weed": Kind(
        "weed takes a share of one thruster's thrust, of the right one's for a positive size",
        "share of the thrust",
        0.6,
        -1.0,
        1.0,
        motors=one_fouled,
    ),
    "bow_thruster_dead": Kind("the bow thruster stands still", bow=lambda fault, share: 0.0),
    "yaw_push": Kind(
        "something turns the boat: a gust, a line in the water",
        "deg of rudder",
        10.0,
        -90.0,
        90.0,
        push=lambda fault, heading, on: on._replace(rudder=on.rudder + math.radians(fault.size)),
    ),
    "stream": Kind(
        "a stream along the heading that was; against it for a negative size", "m/s", -2.0, -10.0, 10.0, push=streamed
    ),
    "heel": Kind(
        "the boat heels, starboard down for a positive size",
        "deg",
        35.0,
        -90.0,
        90.0,
        push=lambda fault, heading, on: on._replace(roll_slope=on.roll_slope + math.radians(fault.size)),
    ),
    "reboot": Kind("the firmware reboots, once", happens=lambda fault, firmware: firmware.reboot(fault.time)),
    "mode": Kind("somebody changes the mode, once", "mode number", 4.0, 0.0, 15.0, happens=mode),
    "disarm": Kind("somebody disarms, once", happens=disarm),
    "stick": Kind("a hand moves the sticks for steering and pitch", "share of the throw", 0.8, -1.0, 1.0, sticks=stick),
    "steering_stick": Kind(
        "a hand moves the steering stick alone", "share of the throw", 1.0, -1.0, 1.0, sticks=steering_stick
    ),
    "switch": Kind("the radio's switch for overrides is low", sticks=switch),
    "receiver_lost": Kind("the radio receiver is silent", silences=(RECEIVER,)),
    "receiver_low": Kind(
        "the receiver has lost its radio and sends this throttle", "us", 900.0, 800.0, 2200.0, sticks=receiver_low
    ),
    "heartbeat_lost": Kind("the flight controller sends everything but heartbeats", silences=("HEARTBEAT",)),
    "overrides_ignored": Kind(
        "the flight controller ignores overrides and headings without a word",
        silences=("RC_CHANNELS_OVERRIDE", "MANUAL_CONTROL", "SET_ATTITUDE_TARGET"),
    ),
    "battery_low": Kind(
        "the battery is low, SYS_STATUS and STATUSTEXT say so",
        "per cent left",
        10.0,
        0.0,
        100.0,
        happens=battery_low,
        charge=_size,
    ),
    "compass_variance": Kind(
        "the compass does not go with gyro and GPS, EKF_STATUS_REPORT says so",
        "of what its filter lets pass",
        1.2,
        0.0,
        10.0,
        variance=_size,
    ),
    "geofence": Kind(
        "STATUSTEXT: Polygon fence breached",
        happens=lambda fault, firmware: firmware.notices.append((5, "Polygon fence breached")),
    ),
    "shallow": Kind(
        "STATUSTEXT: Shallow water",
        "m",
        1.0,
        0.0,
        100.0,
        happens=lambda fault, firmware: firmware.notices.append((4, f"Shallow water {fault.size:.1f} m")),
    ),
    "clock_step": Kind("the flight controller's clock steps, once", "s", 5.0, -86400.0, 86400.0, happens=clock_step),
    "silence": Kind("the boat sends nothing at all", silences=(EVERYTHING,)),
    "link_deaf": Kind("nothing that is sent to the boat arrives", to_boat=_still),
    "link_loss": _chance("packets are lost", 0.3, "loss"),
    "link_delay": Kind("packets come late", "s", 0.3, 0.0, 30.0, line=_bad("delay")),
    "link_jitter": Kind("packets come late by up to", "s", 0.3, 0.0, 30.0, line=_bad("jitter")),
    "link_duplicate": _chance("packets come twice", 0.3, "duplicate"),
    "link_reorder": _chance("packets are overtaken by the next ones", 0.3, "reorder"),
    "link_corrupt": _chance("packets have changed bytes", 0.3, "corrupt"),
    "link_truncate": _chance("packets are cut short", 0.3, "truncate"),
    "link_flood": Kind("noise comes in between", "packets/s", 500.0, 0.0, 20000.0, line=_bad("flood")),
    "link_half_open": Kind("nothing arrives either way, without an error", line=_still),
}
