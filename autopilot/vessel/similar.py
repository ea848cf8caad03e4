"""A first model for a boat that nobody has identified: that of a known boat of like length and speed, scaled.

In the prime system (SNAME) K' = K L/U, T' = T U/L and n3' = n3 (U/L)^2 belong to the hull's form alone, so that

    K = K_i (U/U_i)(L_i/L),  T = T_i (L/L_i)(U_i/U),  n3 = n3_i (L/L_i)^2 (U_i/U)^2

is a guess that is good enough to sail a zigzag by, and to no other end. The boat taken is the nearest in the logarithms
of length and of Froude number U/sqrt(g L).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from autopilot.errors import InputError
from autopilot.vessel.file import load_vessel, rounded, shipped_vessels
from autopilot.vessel.schema import Helm, Model, Rudder, Vessel

GRAVITY = 9.81
KN = 0.514444


class Wanted(NamedTuple):
    """What is known of the new boat: length [m], speed [m/s], the rudder's end stop [deg] and rate [deg/s]."""

    length: float
    speed: float
    stop_deg: float
    rate_deg_s: float


class Similar(NamedTuple):
    """The boat that was found, by the name of its file."""

    name: str
    boat: Vessel
    wanted: Wanted

    @property
    def remark(self) -> str:
        """Where the model comes from, in a sentence."""
        return (
            f"first model scaled from {self.name} ({self.boat.length_m:g} m, "
            f"{self.boat.model.reference_speed_m_s / KN:.1f} kn): a guess to sail the zigzag by"
        )

    def vessel(self, name: str) -> Vessel:
        """Return the new boat: no gains, which need a model of its own."""
        known, wanted = self.boat.model, self.wanted
        assert self.boat.length_m is not None
        # how much longer the new boat takes for one length of itself
        slower = wanted.length / self.boat.length_m * known.reference_speed_m_s / wanted.speed
        model = Model(
            K_1_s=rounded(known.K_1_s / slower),
            T_s=rounded(known.T_s * slower),
            n1=known.n1,
            n3_s2_rad2=rounded(known.n3_s2_rad2 * slower**2),
            reference_speed_m_s=rounded(wanted.speed),
            source=self.remark,
        )
        rudder = Rudder(
            wanted.stop_deg, rounded(wanted.rate_deg_s), source="stops and time from side to side, measured"
        )
        helm = Helm(rudder_at_full_pwm_deg=wanted.stop_deg, source="assumed to be the end stop; measure it")
        return Vessel(schema_version=self.boat.schema_version, name=name, model=model, rudder=rudder, helm=helm)


def similar_boat(wanted: Wanted, names: Iterable[str] | None = None) -> Similar:
    """Return the shipped boat that is most like the one `wanted`. Raises InputError where none has a length."""
    known = [(name, load_vessel(name)) for name in (shipped_vessels() if names is None else names)]
    lengths = [(name, boat, boat.length_m) for name, boat in known if boat.length_m is not None]
    if not lengths:
        raise InputError("no shipped vessel names its length; copy a vessel file and set the model by hand")
    froude = wanted.speed / math.sqrt(GRAVITY * wanted.length)

    def distance(boat: Vessel, length: float) -> float:
        of_boat = boat.model.reference_speed_m_s / math.sqrt(GRAVITY * length)
        return math.hypot(math.log(length / wanted.length), math.log(of_boat / froude))

    name, boat, _ = min(lengths, key=lambda each: distance(each[1], each[2]))
    return Similar(name, boat, wanted)
