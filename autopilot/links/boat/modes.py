"""The boat's modes: their numbers and names, which of them steers now, and the messages that list them. Pure.

Numbered as the ArduRover modes nearest to them (MANUAL, GUIDED, AUTO, STEERING), because ground stations name the modes
of every surface boat by that list. Who asks for AVAILABLE_MODES gets names of our own.
"""

from __future__ import annotations

from typing import NamedTuple

from autopilot.links.extra_messages import AvailableModes, CurrentMode
from autopilot.signals import Mode, OrderKind, Tick

MANUAL, HEADING, TRACK, TRIAL = 0, 15, 10, 3
NON_STANDARD, MISSION = 0, 6
"""MAV_STANDARD_MODE."""
NOT_SELECTABLE = 2
"""MAV_MODE_PROPERTY: a trial is begun by its command."""


class BoatMode(NamedTuple):
    """Our number, what people read, the standard mode it is, and MAV_MODE_PROPERTY bits."""

    number: int
    name: str
    standard: int = NON_STANDARD
    properties: int = 0


MODES = (
    BoatMode(MANUAL, "Manual"),
    BoatMode(HEADING, "Heading"),
    BoatMode(TRACK, "Track", MISSION),
    BoatMode(TRIAL, "Trial", NON_STANDARD, NOT_SELECTABLE),
)


def mode_of(tick: Tick, follows_route: bool = False) -> int:
    """Return our custom mode: who steers, and what to."""
    if tick.mode is not Mode.ENGAGED:
        return MANUAL
    if tick.order.kind is not OrderKind.HEADING:
        return TRIAL
    return TRACK if follows_route else HEADING


def available_modes(index: float) -> list[AvailableModes]:
    """Return AVAILABLE_MODES of the mode `index`, counted from 1, or of all of them for 0; [] for another."""
    return [
        AvailableModes(len(MODES), number, mode.standard, mode.number, mode.properties, mode.name.encode())
        for number, mode in enumerate(MODES, 1)
        if index in (0.0, float(number))
    ]


def current_mode(number: int) -> CurrentMode:
    """Return CURRENT_MODE: we take a mode or refuse it, so that none is ever only intended."""
    standard = next(mode.standard for mode in MODES if mode.number == number)
    return CurrentMode(standard, number, number)
