"""The gains that a vessel asks for: designed by a response level or a bandwidth, for its model, rudder and delay."""

from __future__ import annotations

from dataclasses import astuple, replace
from typing import Any, NamedTuple

from autopilot.control.design import DESIGNED, design_backstepping, placed, spared_gains
from autopilot.control.registry import LAWS
from autopilot.errors import RefusedError
from autopilot.runtime.build import gear_of, law_boat_of, limits_of, model_of
from autopilot.vessel.file import rounded
from autopilot.vessel.schema import Vessel


class GainRequest(NamedTuple):
    """What the loop is to be like: a response level, or a bandwidth [rad/s] with its damping ratio; whether it spares
    the rudder, None: as the file's gains do."""

    level: int = 5
    bandwidth: float | None = None
    damping: float = 0.8
    spares: bool | None = None


def designed(vessel: Vessel, request: GainRequest = GainRequest()) -> Vessel:  # noqa: B008 - nobody can change it
    """Return the vessel with gains designed for it. Raises RefusedError where no gain serves."""
    model, spares = model_of(vessel), spares_rudder(vessel, request)
    try:
        if request.bandwidth is not None:
            loop = spared_gains(model, request.bandwidth) if spares else placed(request.bandwidth, request.damping)
        else:
            rate_max, delay = limits_of(vessel).rate_max, vessel.control.loop_delay_s
            loop = design_backstepping(model, gear_of(vessel), rate_max, delay, request.level, spares=spares)
    except ValueError as error:
        raise RefusedError(f"vessel {vessel.name!r}: {error}") from error
    boat = law_boat_of(vessel)
    sections = {name: _rounded(law.design.of(boat, loop)) for name, law in LAWS.items() if law.design}
    return replace(vessel, control=replace(vessel.control, **sections))


def _rounded(section: Any) -> Any:
    return type(section)(*(rounded(gain) for gain in astuple(section)))


def spares_rudder(vessel: Vessel, request: GainRequest) -> bool:
    """Return whether designed gains are to weigh the rudder's rate."""
    filed = getattr(vessel.control, DESIGNED)
    return request.spares if request.spares is not None else filed is not None and filed.smoothing_s > 0.0
