"""What happens to the flight controller: reboots, hands on its sticks and switches, warnings, a clock that steps.

Texts are those of ArduRover 4.6: AC_Fence.cpp ("Polygon fence breached", notice) and AP_BattMonitor.cpp ("Battery 1 is
low ...", warning). ArduRover has no text of its own for shallow water; boats say it from a script.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sitl.fault_kind import EVERYTHING, RECEIVER, Acting, Kind

if TYPE_CHECKING:
    from sitl.firmware import Firmware

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
    """Return what is left of the battery's charge."""
    return fault.size


KINDS = {
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
    "geofence": Kind("STATUSTEXT: Polygon fence breached", happens=geofence),
    "shallow": Kind("STATUSTEXT: Shallow water", "m", 1.0, 0.0, 100.0, happens=shallow),
    "clock_step": Kind("the flight controller's clock steps, once", "s", 5.0, -86400.0, 86400.0, happens=clock_step),
    "silence": Kind("the boat sends nothing at all", silences=(EVERYTHING,)),
}
