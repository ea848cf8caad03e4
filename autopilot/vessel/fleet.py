"""The real and published boats among the shipped vessel files: what is expected of a boat before it has sailed."""

from __future__ import annotations

import math
from collections.abc import Collection
from functools import cache

from autopilot.identification.boat_prior import BoatPrior, KnownBoat, prior_of
from autopilot.models.norrbin import Norrbin
from autopilot.vessel.file import load_vessel, rounded
from autopilot.vessel.schema import Model

PUBLISHED = (
    "container_ship",
    "esso_osaka",
    "esso_tanker",
    "frigate",
    "mariner",
    "mmg_tanker",
    "naval_vessel",
    "small_craft",
    "twin_thruster",
    "zeefakkel",
)
"""Lanxin is none of them, for nothing that is published here says how long it is; the outboard is a construction of the
simulator, and roll_ship is naval_vessel once more."""


def published_boats() -> tuple[KnownBoat, ...]:
    """Return the boats by name, each with its length and model."""
    return tuple(_known(name) for name in PUBLISHED)


def boats_prior(length: float, without: Collection[str] = ()) -> BoatPrior:
    """Return what the published boats say of one of `length` [m]; those called `without`, by file or by name, are left
    out, so that no boat is its own witness."""
    titles = {name: load_vessel(name).name for name in PUBLISHED}
    boats = [boat for boat in published_boats() if not {boat.name, titles[boat.name]} & set(without)]
    return prior_of(boats, length)


def first_model(length: float, speed: float) -> Model:
    """Return what the published boats let expect of one of `length` [m] at `speed` [m/s]: good enough to sail a zigzag
    by, and to no other end."""
    expected = boats_prior(length).at(speed)
    a, b, d = math.exp(expected.mean[0]), float(expected.mean[1]), math.exp(expected.mean[2])
    time_constant = 1.0 / abs(b)
    return Model(
        K_1_s=rounded(a * time_constant),
        T_s=rounded(time_constant),
        n1=math.copysign(1.0, b),
        n3_s2_rad2=rounded(d * time_constant),
        reference_speed_m_s=rounded(speed),
        source=f"expected of a boat of {length:g} m by {expected.boats} published ones: a guess to sail the zigzag by",
    )


@cache
def _known(name: str) -> KnownBoat:
    vessel = load_vessel(name)
    assert vessel.length_m is not None, name
    errors = vessel.model.standard_errors
    return KnownBoat(name, vessel.length_m, _model(vessel.model), errors.n3_s2_rad2 or 0.0)


def _model(model: Model) -> Norrbin:
    return Norrbin(
        gain=model.K_1_s,
        time_constant=model.T_s,
        n3=model.n3_s2_rad2,
        n1=model.n1,
        reference_speed=model.reference_speed_m_s,
    )
