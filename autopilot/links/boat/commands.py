"""Commands of ground stations as the boat carries them out: always acknowledged, unknown ones UNSUPPORTED. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.angles import wrap
from autopilot.links.boat.telemetry import HEADING, MANUAL
from autopilot.signals import Mode, OrderKind, Tick

ACCEPTED = int(dialect.MAV_RESULT_ACCEPTED)
REJECTED = int(dialect.MAV_RESULT_TEMPORARILY_REJECTED)
DENIED = int(dialect.MAV_RESULT_DENIED)
UNSUPPORTED = int(dialect.MAV_RESULT_UNSUPPORTED)
COUNTERCLOCKWISE = -1.0
RAW_HEADING, COURSE_OVER_GROUND = 1, 0


class Helmsman(Protocol):
    """Who carries out what is ordered: the same one as listens to the skipper at the terminal."""

    def engage(self, heading: float | None) -> None:
        """Order a heading [rad], or the present one."""

    def turn_to(self, heading: float) -> None:
        """Change the heading [rad] that is being steered: no wish to engage again after an override."""

    def stand_by(self) -> None:
        """Give the rudder back."""


class Commands:
    """Carries commands out. `armed`: a ground station, or `run --engage`, has said that the pilot may engage."""

    def __init__(self, helmsman: Helmsman, armed: bool) -> None:
        self._helmsman = helmsman
        self.armed = armed
        self.refusal = ""
        """Why the last command was refused, for people."""
        self._actions: dict[int, Callable[[Tick | None, tuple[float, ...]], int]] = {
            int(dialect.MAV_CMD_COMPONENT_ARM_DISARM): self._arm,
            int(dialect.MAV_CMD_DO_SET_MODE): self._set_mode,
            int(dialect.MAV_CMD_CONDITION_YAW): self._yaw,
            int(dialect.MAV_CMD_GUIDED_CHANGE_HEADING): self._change_heading,
        }

    def execute(self, command: int, parameters: tuple[float, ...], tick: Tick | None) -> int:
        """Carry out `command` with its parameters 1 to 7, the pilot being at `tick`; return the MAV_RESULT."""
        self.refusal = ""
        action = self._actions.get(command)
        return action(tick, parameters) if action else UNSUPPORTED

    def set_mode(self, mode: int, tick: Tick | None) -> int:
        """Go to one of our custom modes; return the MAV_RESULT."""
        self.refusal = ""
        if mode == MANUAL:
            self._helmsman.stand_by()
            return ACCEPTED
        if mode != HEADING:
            return self._refuse(DENIED, f"mode {mode} is not known: MANUAL ({MANUAL}) and GUIDED ({HEADING}) are")
        if not self.armed:
            return self._refuse(REJECTED, "arm first")
        if not _steers(tick):
            self._helmsman.engage(None)
        return ACCEPTED

    def _arm(self, tick: Tick | None, parameters: tuple[float, ...]) -> int:
        if parameters[0] not in (0.0, 1.0):
            return UNSUPPORTED
        self.armed = parameters[0] == 1.0
        if not self.armed:
            self._helmsman.stand_by()
        return ACCEPTED

    def _set_mode(self, tick: Tick | None, parameters: tuple[float, ...]) -> int:
        base, custom = parameters[:2]
        if not (math.isfinite(base) and math.isfinite(custom) and custom == int(custom)):
            return DENIED
        if not int(base) & dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return UNSUPPORTED
        return self.set_mode(int(custom), tick)

    def _yaw(self, tick: Tick | None, parameters: tuple[float, ...]) -> int:
        angle_deg, _, direction, relative = parameters[:4]
        if not math.isfinite(angle_deg) or relative not in (0.0, 1.0):
            return DENIED
        if relative == 0.0:
            return self._steer(tick, math.radians(angle_deg))
        if tick is None or not math.isfinite(tick.order.heading):
            return self._refuse(REJECTED, "no heading is being steered yet")
        turn = -abs(angle_deg) if direction == COUNTERCLOCKWISE else angle_deg
        return self._steer(tick, tick.order.heading + math.radians(turn))

    def _change_heading(self, tick: Tick | None, parameters: tuple[float, ...]) -> int:
        kind, heading_deg = parameters[:2]
        if kind == COURSE_OVER_GROUND:
            return self._refuse(UNSUPPORTED, "a course over the ground cannot be steered; give a heading (type 1)")
        if kind != RAW_HEADING or not math.isfinite(heading_deg):
            return DENIED
        return self._steer(tick, math.radians(heading_deg))

    def _steer(self, tick: Tick | None, heading: float) -> int:
        if not _steers(tick):
            return self._refuse(REJECTED, "not engaged: arm and set mode GUIDED first")
        self._helmsman.turn_to(wrap(heading))
        return ACCEPTED

    def _refuse(self, result: int, reason: str) -> int:
        self.refusal = reason
        return result


def _steers(tick: Tick | None) -> bool:
    return tick is not None and tick.mode is Mode.ENGAGED and tick.order.kind is OrderKind.HEADING
