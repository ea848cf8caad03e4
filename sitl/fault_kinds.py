"""Every fault the simulator can inject: its name, what its size means, and how large it is unless told."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple, get_args

FaultKind = Literal[
    "heading_dropout",
    "heading_frozen",
    "heading_jump",
    "heading_drift",
    "heading_noise",
    "heading_spikes",
    "heading_nan",
    "heading_late",
    "heading_lag",
    "rate_bias",
    "rate_frozen",
    "rate_noise",
    "rate_reversed",
    "rate_lag",
    "speed_lost",
    "log_lost",
    "speed_frozen",
    "speed_wrong",
    "position_lost",
    "position_jump",
    "rudder_stuck",
    "rudder_reversed",
    "rudder_slow",
    "rudder_late",
    "rudder_offset",
    "rudder_hard_over",
    "rudder_limited",
    "rudder_play",
    "rudder_free",
    "feedback_lost",
    "feedback_frozen",
    "feedback_offset",
    "engine_stopped",
    "engine_astern",
    "yaw_push",
    "stream",
    "heel",
    "reboot",
    "mode",
    "disarm",
    "stick",
    "steering_stick",
    "switch",
    "receiver_lost",
    "receiver_low",
    "heartbeat_lost",
    "overrides_ignored",
    "battery_low",
    "geofence",
    "shallow",
    "clock_step",
    "silence",
    "link_deaf",
    "link_half_open",
    "link_loss",
    "link_delay",
    "link_jitter",
    "link_duplicate",
    "link_reorder",
    "link_corrupt",
    "link_truncate",
    "link_flood",
]

Source = Literal["both", "first", "second"]
"""Which compass and rate gyro fail: the flight controller's is the first, that on the NMEA line the second."""
SOURCES: tuple[Source, ...] = get_args(Source)
OF_A_COMPASS: frozenset[FaultKind] = frozenset(
    (
        "heading_dropout",
        "heading_frozen",
        "heading_jump",
        "heading_drift",
        "heading_noise",
        "heading_spikes",
        "heading_lag",
        "rate_bias",
        "rate_frozen",
        "rate_noise",
        "rate_reversed",
        "rate_lag",
    )
)
"""Faults that one of two compasses may have, with its rate gyro."""


class Kind(NamedTuple):
    """What a fault does; `unit` of its size, empty where it has none, the size unless told, and its range."""

    what: str
    unit: str = ""
    size: float = 1.0
    low: float = 1.0
    high: float = 1.0


_CHANCE = ("share of packets", 0.0, 1.0)


def _chance(what: str, size: float) -> Kind:
    unit, low, high = _CHANCE
    return Kind(what, unit, size, low, high)


KINDS: Mapping[FaultKind, Kind] = {
    "heading_dropout": Kind("the compass sends nothing"),
    "heading_frozen": Kind("the compass repeats its last heading"),
    "heading_jump": Kind("the compass is off by a constant", "deg", 40.0, -180.0, 180.0),
    "heading_drift": Kind("the compass wanders off", "deg/s", 1.0, -30.0, 30.0),
    "heading_noise": Kind("the compass is noisy, standard deviation", "deg", 10.0, 0.0, 180.0),
    "heading_spikes": Kind("single headings are anything at all", "share of headings", 0.1, 0.0, 1.0),
    "heading_nan": Kind("the flight controller sends a heading that is no number"),
    "heading_late": Kind("heading, rate and roll leave the sensor late", "s", 1.0, 0.0, 10.0),
    "heading_lag": Kind("headings are older than their time stamps say", "s", 0.3, 0.0, 10.0),
    "rate_bias": Kind("the rate gyro is off by a constant", "deg/s", 5.0, -90.0, 90.0),
    "rate_frozen": Kind("the rate gyro repeats its last value"),
    "rate_noise": Kind("the rate gyro is noisy, standard deviation", "deg/s", 5.0, 0.0, 90.0),
    "rate_reversed": Kind("the rate gyro has the wrong sign"),
    "rate_lag": Kind("rates of turn are older than their time stamps say", "s", 0.3, 0.0, 10.0),
    "speed_lost": Kind("no speed, through the water or over the ground, is sent"),
    "log_lost": Kind("no speed through the water is sent; that over the ground remains"),
    "speed_frozen": Kind("speeds repeat their last values"),
    "speed_wrong": Kind("speeds are multiplied", "times", 3.0, 0.0, 100.0),
    "position_lost": Kind("the GPS has no position"),
    "position_jump": Kind("the GPS shows a place to the north", "m", 200.0, -20000.0, 20000.0),
    "rudder_stuck": Kind("the rudder stays where it is"),
    "rudder_reversed": Kind("the rudder goes to the other side"),
    "rudder_slow": Kind("the rudder moves at a share of its rate", "share of the rate", 0.1, 0.0, 1.0),
    "rudder_late": Kind("orders reach the steering gear late", "s", 0.3, 0.0, 10.0),
    "rudder_offset": Kind("the linkage has slipped", "deg", 8.0, -45.0, 45.0),
    "rudder_hard_over": Kind("the rudder runs to a stop, starboard for a positive size", "sign", 1.0, -1.0, 1.0),
    "rudder_limited": Kind("the rudder meets a stop at this angle", "deg", 5.0, 0.0, 45.0),
    "rudder_play": Kind("the linkage has play, each way", "deg", 3.0, 0.0, 45.0),
    "rudder_free": Kind("the linkage is broken: the rudder trails amidships"),
    "feedback_lost": Kind("the rudder sensor sends nothing"),
    "feedback_frozen": Kind("the rudder sensor repeats its last angle"),
    "feedback_offset": Kind("the rudder sensor is off by a constant", "deg", 8.0, -45.0, 45.0),
    "engine_stopped": Kind("the engine gives no thrust"),
    "engine_astern": Kind("the engine pushes astern, a share of the speed", "share of the speed", 0.5, 0.0, 1.0),
    "yaw_push": Kind("something turns the boat: a gust, a line in the water", "deg of rudder", 10.0, -90.0, 90.0),
    "stream": Kind("a stream along the heading that was; against it for a negative size", "m/s", -2.0, -10.0, 10.0),
    "heel": Kind("the boat heels, starboard down for a positive size", "deg", 35.0, -90.0, 90.0),
    "reboot": Kind("the firmware reboots, once"),
    "mode": Kind("somebody changes the mode, once", "mode number", 4.0, 0.0, 15.0),
    "disarm": Kind("somebody disarms, once"),
    "stick": Kind("a hand moves the sticks for steering and pitch", "share of the throw", 0.8, -1.0, 1.0),
    "steering_stick": Kind("a hand moves the steering stick alone", "share of the throw", 1.0, -1.0, 1.0),
    "switch": Kind("the radio's switch for overrides is low"),
    "receiver_lost": Kind("the radio receiver is silent"),
    "receiver_low": Kind("the receiver has lost its radio and sends this throttle", "us", 900.0, 800.0, 2200.0),
    "heartbeat_lost": Kind("the flight controller sends everything but heartbeats"),
    "overrides_ignored": Kind("the flight controller ignores overrides and headings without a word"),
    "battery_low": Kind("the battery is low, SYS_STATUS and STATUSTEXT say so", "per cent left", 10.0, 0.0, 100.0),
    "geofence": Kind("STATUSTEXT: Polygon fence breached"),
    "shallow": Kind("STATUSTEXT: Shallow water", "m", 1.0, 0.0, 100.0),
    "clock_step": Kind("the flight controller's clock steps, once", "s", 5.0, -86400.0, 86400.0),
    "silence": Kind("the boat sends nothing at all"),
    "link_deaf": Kind("nothing that is sent to the boat arrives"),
    "link_half_open": Kind("nothing arrives either way, and nobody is told"),
    "link_loss": _chance("packets are lost", 0.3),
    "link_delay": Kind("packets come late", "s", 0.3, 0.0, 30.0),
    "link_jitter": Kind("packets come late by up to", "s", 0.3, 0.0, 30.0),
    "link_duplicate": _chance("packets come twice", 0.3),
    "link_reorder": _chance("packets are overtaken by the next ones", 0.3),
    "link_corrupt": _chance("packets have changed bytes", 0.3),
    "link_truncate": _chance("packets are cut short", 0.3),
    "link_flood": Kind("noise comes in between", "packets/s", 500.0, 0.0, 20000.0),
}


def wrong_source(kind: FaultKind, source: Source) -> str:
    """Return the sentence that says why only one source cannot have this fault, empty where it can."""
    if source == "both" or kind in OF_A_COMPASS:
        return ""
    return f"{kind} is no fault of one compass; leave source out, or choose {', '.join(sorted(OF_A_COMPASS))}."


def wrong_size(kind: FaultKind, size: float | None) -> str:
    """Return the sentence that says why a size cannot be, empty where it can; None is the default size."""
    if size is None:
        return ""
    allowed = KINDS[kind]
    if not allowed.unit:
        return f"{kind} has no size; leave size out."
    if not allowed.low <= size <= allowed.high:
        return f"the size of {kind} is {size:g}, allowed is {allowed.low:g} to {allowed.high:g} ({allowed.unit})."
    return ""
