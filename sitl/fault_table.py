"""Faults of instruments, of rudder and engine, of the flight controller, and of the lines to the boat.

Those of one instrument act one after the other: what is late or frozen first, then what is added to it. Texts of the
flight controller are those of ArduRover 4.6: AC_Fence.cpp ("Polygon fence breached", notice) and AP_BattMonitor.cpp
("Battery 1 is low ...", warning). ArduRover has no text of its own for shallow water; boats say it from a script.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

from autopilot.angles import wrap, wrap_positive
from autopilot.models.steering_gear import clip
from sitl.boat import EARTH_RADIUS, Disturbance
from sitl.fault_kind import COMPASS, EVERYTHING, GPS, RECEIVER, Acting, Damage, Dice, Kind, Moved, Ordered

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


def reversed_order(fault: Acting, given: Ordered) -> float:
    """Return the order to the other side."""
    return -given.order


def slipped(fault: Acting, given: Ordered) -> float:
    """Return the order beside which the rudder goes."""
    return given.order + math.radians(fault.size)


def hard_over(fault: Acting, given: Ordered) -> float:
    """Return the end stop."""
    return math.copysign(given.gear.angle_max, fault.size)


def play(fault: Acting, given: Ordered) -> float:
    """Return where the gear drags the rudder along at either end of the play."""
    half = math.radians(fault.size)
    return clip(given.rudder, given.order - half, given.order + half)


def slow(fault: Acting, moved: Moved) -> float:
    """Return as far as a share of the rate gets."""
    rate = moved.gear.rate_max if math.isfinite(moved.gear.rate_max) else UNLIMITED
    return clip(moved.after, moved.before - fault.size * rate * moved.dt, moved.before + fault.size * rate * moved.dt)


def limited(fault: Acting, moved: Moved) -> float:
    """Return what is within the stop."""
    return clip(moved.after, -math.radians(fault.size), math.radians(fault.size))


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


def stuck(fault: Acting, moved: Moved) -> float:
    """Return the rudder as it was."""
    return moved.before


def astern(fault: Acting, thrust: float, cruise: float) -> float:
    """Return a speed astern."""
    return -fault.size * cruise


def stopped(fault: Acting, thrust: float, cruise: float) -> float:
    """Return no speed."""
    return 0.0


def one_dead(fault: Acting, pair: tuple[float, float]) -> tuple[float, float]:
    """Return a pair of thrusters of which the left one, or for a positive size the right one, stands still."""
    return (pair[0], 0.0) if fault.size > 0.0 else (0.0, pair[1])


def bow_dead(fault: Acting, share: float) -> float:
    """Return what a bow thruster runs at whose fuse has blown."""
    return 0.0


def one_fouled(fault: Acting, pair: tuple[float, float]) -> tuple[float, float]:
    """Return a pair of thrusters of which the right one, or for a negative size the left one, has weed on it, which
    takes such a share of its thrust."""
    left = math.sqrt(1.0 - max(-fault.size, 0.0))
    right = math.sqrt(1.0 - max(fault.size, 0.0))
    return left * pair[0], right * pair[1]


def turned(fault: Acting, heading: float, on: Disturbance) -> Disturbance:
    """Return what acts on the boat, with a yaw moment."""
    return on._replace(rudder=on.rudder + math.radians(fault.size))


def streamed(fault: Acting, heading: float, on: Disturbance) -> Disturbance:
    """Return what acts on the boat, with a stream along the heading at which it began."""
    towards = fault.memory.setdefault("towards", heading)
    return on._replace(
        current_north=on.current_north + fault.size * math.cos(towards),
        current_east=on.current_east + fault.size * math.sin(towards),
    )


def heeled(fault: Acting, heading: float, on: Disturbance) -> Disturbance:
    """Return what acts on the boat, with a slope of the water athwartships."""
    return on._replace(roll_slope=on.roll_slope + math.radians(fault.size))


def feedback_frozen(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show the rudder of the moment when it began."""
    return reading._replace(rudder=fault.memory.setdefault("rudder", reading.rudder))


def feedback_offset(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show a rudder beside the true one."""
    return reading._replace(rudder=reading.rudder + math.radians(fault.size))


def _off(reading: Reading, angle: float) -> Reading:
    return reading._replace(heading=wrap_positive(reading.heading + angle)) if angle else reading


def heading_lag(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show the heading of some time ago, under the time stamp of now."""
    waiting = fault.memory.setdefault("waiting", deque())
    return reading._replace(heading=delayed(waiting, fault.time, reading.heading, fault.size))


def heading_frozen(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show the heading of the moment when it began."""
    return reading._replace(heading=fault.memory.setdefault("heading", reading.heading))


def heading_jump(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show a heading beside the true one."""
    return _off(reading, math.radians(fault.size))


def heading_drift(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show a heading that goes away from the true one."""
    return _off(reading, math.radians(fault.size * fault.lasted))


def heading_noise(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show a heading with noise."""
    return _off(reading, math.radians(fault.size) * dice.deviate())


def heading_spikes(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show anything now and then."""
    return _off(reading, 2.0 * math.pi * dice.share()) if dice.share() < fault.size else reading


def rate_lag(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show the rate of turn of some time ago, under the time stamp of now."""
    waiting = fault.memory.setdefault("waiting", deque())
    return reading._replace(rate=delayed(waiting, fault.time, reading.rate, fault.size))


def rate_frozen(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show the rates of the moment when it began."""
    rate, roll_rate = fault.memory.setdefault("rates", (reading.rate, reading.roll_rate))
    return reading._replace(rate=rate, roll_rate=roll_rate)


def rate_reversed(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show a turn to the other side."""
    return reading._replace(rate=-reading.rate)


def rate_bias(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show a rate beside the true one."""
    return reading._replace(rate=reading.rate + math.radians(fault.size))


def rate_noise(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show a rate with noise."""
    return reading._replace(rate=reading.rate + math.radians(fault.size) * dice.deviate())


def rate_scaled(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show so many times the rate."""
    return reading._replace(rate=reading.rate * fault.size)


SPEEDS = ("water_speed", "ground_speed", "north_speed", "east_speed")
"""Through the water, over the ground, and that one's parts: a GPS is wrong in all of them at once."""


def speed_frozen(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show the speeds of the moment when it began."""
    return reading._replace(**fault.memory.setdefault("speeds", {name: getattr(reading, name) for name in SPEEDS}))


def speed_wrong(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show so many times the speeds."""
    return reading._replace(**{name: getattr(reading, name) * fault.size for name in SPEEDS})


def position_jump(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show a place to the north."""
    return reading._replace(latitude=reading.latitude + math.degrees(fault.size / EARTH_RADIUS))


def wind_frozen(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show the apparent wind of the moment when it began."""
    angle, speed = fault.memory.setdefault("wind", (reading.wind_angle, reading.wind_speed))
    return reading._replace(wind_angle=angle, wind_speed=speed)


def wind_jump(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show an apparent wind beside the true one."""
    return reading._replace(wind_angle=wrap(reading.wind_angle + math.radians(fault.size)))


def late(fault: Acting, latency: float) -> float:
    """Return the time [s] to the sensor's end, longer."""
    return latency + fault.size


def no_number(fault: Acting, heading: float) -> float:
    """Return what is no number."""
    return math.nan


STICK_FULL_US = 500
SWITCH_LOW_US = 1000
EMPTY_MV, FULL_MV = 10500, 12600
CAPACITY_MAH = 10000


def battery_mv(per_cent: float) -> int:
    """Return the voltage [mV] of a battery that is so full; linear, assumed."""
    return round(EMPTY_MV + (FULL_MV - EMPTY_MV) * per_cent / 100.0)


def reboot(fault: Acting, firmware: Firmware) -> None:
    """Reboot."""
    firmware.reboot(fault.time)


def mode(fault: Acting, firmware: Firmware) -> None:
    """Change the mode."""
    firmware.set_mode(round(fault.size))


def disarm(fault: Acting, firmware: Firmware) -> None:
    """Disarm."""
    firmware.set_armed(False)


def clock_step(fault: Acting, firmware: Firmware) -> None:
    """Put the clock forward."""
    firmware.boot_time -= fault.size


def geofence(fault: Acting, firmware: Firmware) -> None:
    """Say that the fence was crossed."""
    firmware.notices.append((5, "Polygon fence breached"))


def shallow(fault: Acting, firmware: Firmware) -> None:
    """Say how little water there is."""
    firmware.notices.append((4, f"Shallow water {fault.size:.1f} m"))


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


def left(fault: Acting, per_cent: float) -> float:
    """Return the size: what is left of the battery's charge, or what the filter says of the compass."""
    return fault.size


def still(fault: Acting, damage: Damage) -> Damage:
    """Return a line over which nothing passes."""
    return damage._replace(still=True)


def _bad(field: str) -> Callable[[Acting, Damage], Damage]:
    """Return what gives one field of the damage the fault's size."""
    return lambda fault, damage: Damage(**damage._asdict() | {field: fault.size})


def _chance(what: str, size: float, field: str) -> Kind:
    return Kind(what, "share of packets", size, 0.0, 1.0, line=_bad(field))


KINDS = {
    "heading_dropout": Kind("the compass sends nothing", silences=("ATTITUDE", COMPASS), of_a_compass=True),
    "rate_lag": Kind(
        "rates of turn are older than their time stamps say", "s", 0.3, 0.0, 10.0, of_a_compass=True, reads=rate_lag
    ),
    "rate_frozen": Kind("the rate gyro repeats its last value", of_a_compass=True, reads=rate_frozen),
    "rate_reversed": Kind("the rate gyro has the wrong sign", of_a_compass=True, reads=rate_reversed),
    "rate_bias": Kind(
        "the rate gyro is off by a constant", "deg/s", 5.0, -90.0, 90.0, of_a_compass=True, reads=rate_bias
    ),
    "rate_noise": Kind(
        "the rate gyro is noisy, standard deviation", "deg/s", 5.0, 0.0, 90.0, of_a_compass=True, reads=rate_noise
    ),
    "rate_scaled": Kind(
        "the rate gyro's scale is wrong, 57.3 for degrees that are taken for radians",
        "times",
        57.3,
        -100.0,
        100.0,
        of_a_compass=True,
        reads=rate_scaled,
    ),
    "heading_late": Kind("heading, rate and roll leave the sensor late", "s", 1.0, 0.0, 10.0, latency=late),
    "heading_lag": Kind(
        "headings are older than their time stamps say", "s", 0.3, 0.0, 10.0, of_a_compass=True, reads=heading_lag
    ),
    "heading_frozen": Kind("the compass repeats its last heading", of_a_compass=True, reads=heading_frozen),
    "heading_jump": Kind(
        "the compass is off by a constant", "deg", 40.0, -180.0, 180.0, of_a_compass=True, reads=heading_jump
    ),
    "heading_drift": Kind("the compass wanders off", "deg/s", 1.0, -30.0, 30.0, of_a_compass=True, reads=heading_drift),
    "heading_noise": Kind(
        "the compass is noisy, standard deviation", "deg", 10.0, 0.0, 180.0, of_a_compass=True, reads=heading_noise
    ),
    "heading_spikes": Kind(
        "single headings are anything at all",
        "share of headings",
        0.1,
        0.0,
        1.0,
        of_a_compass=True,
        reads=heading_spikes,
    ),
    "heading_nan": Kind("the flight controller sends a heading that is no number", attitude=no_number),
    "speed_lost": Kind(
        "no speed, through the water or over the ground, is sent",
        silences=(
            "GLOBAL_POSITION_INT",
            "LOCAL_POSITION_NED",
            "VFR_HUD",
            "VHW",
            "VTG",
        ),
    ),
    "log_lost": Kind("no speed through the water is sent; that over the ground remains", silences=("VHW",)),
    "speed_frozen": Kind("speeds repeat their last values", reads=speed_frozen),
    "speed_wrong": Kind("speeds are multiplied", "times", 3.0, 0.0, 100.0, reads=speed_wrong),
    "position_lost": Kind("the GPS has no position", silences=("RMC", GPS)),
    "wind_lost": Kind("no wind is sent", silences=("MWV", "WIND")),
    "wind_frozen": Kind("the wind vane repeats its last wind", reads=wind_frozen),
    "wind_jump": Kind("the wind vane is off by a constant", "deg", 40.0, -180.0, 180.0, reads=wind_jump),
    "position_jump": Kind("the GPS shows a place to the north", "m", 200.0, -20000.0, 20000.0, reads=position_jump),
    "rudder_late": Kind("orders reach the steering gear late", "s", 0.3, 0.0, 10.0, order=late_order),
    "rudder_reversed": Kind("the rudder goes to the other side", order=reversed_order),
    "rudder_offset": Kind("the linkage has slipped", "deg", 8.0, -45.0, 45.0, order=slipped),
    "rudder_hard_over": Kind(
        "the rudder runs to a stop, starboard for a positive size", "sign", 1.0, -1.0, 1.0, order=hard_over
    ),
    "rudder_play": Kind("the linkage has play, each way", "deg", 3.0, 0.0, 45.0, order=play),
    "rudder_slow": Kind("the rudder moves at a share of its rate", "share of the rate", 0.1, 0.0, 1.0, reached=slow),
    "rudder_limited": Kind("the rudder meets a stop at this angle", "deg", 5.0, 0.0, 45.0, reached=limited),
    "rudder_free": Kind("the linkage is broken: the rudder trails amidships", reached=trailing),
    "rudder_stuck": Kind("the rudder stays where it is", reached=stuck),
    "rudder_one_way": Kind(
        "the rudder moves to one side only, to starboard for a positive size", "sign", 1.0, -1.0, 1.0, reached=one_way
    ),
    "rudder_creeps": Kind("the rudder creeps by itself", "deg/s", 0.2, -5.0, 5.0, reached=creeping),
    "feedback_lost": Kind(
        "the rudder sensor sends nothing",
        silences=(
            "SERVO_OUTPUT_RAW",
            "RC_CHANNELS",
            "RSA",
        ),
    ),
    "feedback_frozen": Kind("the rudder sensor repeats its last angle", reads=feedback_frozen),
    "feedback_offset": Kind("the rudder sensor is off by a constant", "deg", 8.0, -45.0, 45.0, reads=feedback_offset),
    "engine_astern": Kind(
        "the engine pushes astern, a share of the speed", "share of the speed", 0.5, 0.0, 1.0, thrust=astern
    ),
    "engine_stopped": Kind("the engine gives no thrust", thrust=stopped),
    "thruster_dead": Kind(
        "one of two thrusters stands still, the right one for a positive size", "sign", -1.0, -1.0, 1.0, motors=one_dead
    ),
    "thruster_weed": Kind(
        "weed takes a share of one thruster's thrust, of the right one's for a positive size",
        "share of the thrust",
        0.6,
        -1.0,
        1.0,
        motors=one_fouled,
    ),
    "bow_thruster_dead": Kind("the bow thruster stands still", bow=bow_dead),
    "yaw_push": Kind(
        "something turns the boat: a gust, a line in the water", "deg of rudder", 10.0, -90.0, 90.0, push=turned
    ),
    "stream": Kind(
        "a stream along the heading that was; against it for a negative size", "m/s", -2.0, -10.0, 10.0, push=streamed
    ),
    "heel": Kind("the boat heels, starboard down for a positive size", "deg", 35.0, -90.0, 90.0, push=heeled),
    "reboot": Kind("the firmware reboots, once", happens=reboot),
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
        charge=left,
    ),
    "compass_variance": Kind(
        "the compass does not go with gyro and GPS, EKF_STATUS_REPORT says so",
        "of what its filter lets pass",
        1.2,
        0.0,
        10.0,
        variance=left,
    ),
    "geofence": Kind("STATUSTEXT: Polygon fence breached", happens=geofence),
    "shallow": Kind("STATUSTEXT: Shallow water", "m", 1.0, 0.0, 100.0, happens=shallow),
    "clock_step": Kind("the flight controller's clock steps, once", "s", 5.0, -86400.0, 86400.0, happens=clock_step),
    "silence": Kind("the boat sends nothing at all", silences=(EVERYTHING,)),
    "link_deaf": Kind("nothing that is sent to the boat arrives", to_boat=still),
    "link_loss": _chance("packets are lost", 0.3, "loss"),
    "link_delay": Kind("packets come late", "s", 0.3, 0.0, 30.0, line=_bad("delay")),
    "link_jitter": Kind("packets come late by up to", "s", 0.3, 0.0, 30.0, line=_bad("jitter")),
    "link_duplicate": _chance("packets come twice", 0.3, "duplicate"),
    "link_reorder": _chance("packets are overtaken by the next ones", 0.3, "reorder"),
    "link_corrupt": _chance("packets have changed bytes", 0.3, "corrupt"),
    "link_truncate": _chance("packets are cut short", 0.3, "truncate"),
    "link_flood": Kind("noise comes in between", "packets/s", 500.0, 0.0, 20000.0, line=_bad("flood")),
    "link_half_open": Kind("nothing arrives either way, without an error", line=still),
}
