"""What happens to the flight controller: reboots, hands on its sticks and switches, warnings, a clock that steps.

Texts are those of ArduRover 4.6: AC_Fence.cpp ("Polygon fence breached", notice) and AP_BattMonitor.cpp ("Battery 1 is
low ...", warning). ArduRover has no text of its own for shallow water; boats say it from a script.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sitl.fault_kinds import FaultKind

if TYPE_CHECKING:
    from sitl.firmware import Firmware

STICK_FULL_US = 500
SWITCH_LOW_US, SWITCH_HIGH_US = 1000, 2000
EMPTY_MV, FULL_MV = 10500, 12600
CAPACITY_MAH = 10000
ONCE: tuple[FaultKind, ...] = ("reboot", "mode", "disarm", "battery_low", "geofence", "shallow", "clock_step")
"""Faults that happen when they begin; the others last."""


def battery_mv(per_cent: float) -> int:
    """Return the voltage [mV] of a battery that is so full; linear, assumed."""
    return round(EMPTY_MV + (FULL_MV - EMPTY_MV) * per_cent / 100.0)


class VehicleFaults:
    """Called once a step, before the firmware reads its sticks. Memory: what had begun, and the sticks at rest."""

    def __init__(self, firmware: Firmware) -> None:
        self._firmware = firmware
        self._faults = firmware.world.faults
        self._begun: set[FaultKind] = set()
        self._rest: dict[int, int] = {}

    def work(self, time: float) -> None:
        """Do what the faults do at `time` [s]."""
        if not self._faults and not self._rest:
            return
        for kind in ONCE:
            size = self._faults.size(kind, time)
            if size is None:
                self._begun.discard(kind)
            elif kind not in self._begun:
                self._begun.add(kind)
                self._happen(kind, size, time)
        self._move_sticks(time)
        self._firmware.receiver = self._firmware.has_receiver and not self._faults.is_on("receiver_lost", time)

    def _happen(self, kind: FaultKind, size: float, time: float) -> None:
        firmware = self._firmware
        if kind == "reboot":
            firmware.reboot(time)
        elif kind == "mode":
            firmware.set_mode(round(size))
        elif kind == "disarm":
            firmware.set_armed(False)
        elif kind == "clock_step":
            firmware.boot_time -= size
        elif kind == "geofence":
            firmware.notices.append((5, "Polygon fence breached"))
        elif kind == "shallow":
            firmware.notices.append((4, f"Shallow water {size:.1f} m"))
        else:
            volts, used = battery_mv(size) / 1000.0, CAPACITY_MAH * (1.0 - size / 100.0)
            firmware.notices.append((4, f"Battery 1 is low {volts:.2f}V used {used:.0f} mAh"))

    def _move_sticks(self, time: float) -> None:
        """Put the sticks where the faults have them, and back to where they were."""
        setup = self._firmware.setup
        wanted: dict[int, int] = {}
        if (share := self._faults.size("stick", time)) is not None:
            # a hand that grabs a stick moves both of its axes
            for channel in (setup.steering_channel, setup.pitch_channel):
                wanted[channel] = 1500 + round(share * STICK_FULL_US)
        if (share := self._faults.size("steering_stick", time)) is not None:
            wanted[setup.steering_channel] = 1500 + round(share * STICK_FULL_US)
        if (pulse_us := self._faults.size("receiver_low", time)) is not None:
            wanted[setup.throttle_channel] = round(pulse_us)
        if self._faults.is_on("switch", time) and setup.override_switch is not None:
            wanted[setup.override_switch] = SWITCH_LOW_US
        sticks = self._firmware.sticks
        for channel in [channel for channel in self._rest if channel not in wanted]:
            sticks[channel - 1] = self._rest.pop(channel)
        for channel, pulse in wanted.items():
            # a switch that was never touched rests in between, where it allows nothing anew
            is_switch = channel == setup.override_switch
            self._rest.setdefault(channel, SWITCH_HIGH_US if is_switch else sticks[channel - 1])
            sticks[channel - 1] = pulse
