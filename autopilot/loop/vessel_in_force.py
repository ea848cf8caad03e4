"""The vessel file's numbers while the pilot runs: changed by a ground station, in force at once, kept beside the file.

A change is refused with a sentence where the file's schema or the gains' margins do not allow it. What the pilot works
with (model, rudder, gains, limits, fail-safe, noise) takes effect at the next tick, without a bump; what the links were
opened with (control.rate_hz, helm, drive, sensors of the links) is kept for the next start, and said so.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from autopilot.build import pilot_config, verdict_of
from autopilot.build_laws import TRIAL_LAW, law_of
from autopilot.errors import InputError, RefusedError
from autopilot.params.saving import save_text
from autopilot.params.vessel import Vessel
from autopilot.params.vessel_file import dump_vessel
from autopilot.params.vessel_parameters import parameters_of, value_of, with_value
from autopilot.pilot import Pilot

LATER = ("control.rate_hz", "control.law", "helm.", "drive.")
"""Beginnings of the keys that count from the next start on."""


class ChangeLog(Protocol):
    """Where a change is written down, so that a replay makes it too."""

    def keep_vessel(self, text: str) -> None:
        """Append the vessel as it is from the next tick on."""


class VesselInForce:
    """A `ParameterStore` over the running pilot's vessel.

    Args:
        vessel: as it was read.  law: the law that steers, None for the file's own.
        saved_as: the file that changes are kept in.
        save: writes a text to a file; may do so later, from another thread.

    Attributes:
        vessel: as it is now.  log: where changes are written down, None without a log.  changed: told of every change
        that is in force, for what works with the vessel outside of the pilot.
    """

    def __init__(
        self,
        vessel: Vessel,
        pilot: Pilot,
        law: str | None,
        saved_as: Path,
        save: Callable[[Path, str], None] = save_text,
    ) -> None:
        self.vessel = vessel
        self.saved_as = saved_as
        self.log: ChangeLog | None = None
        self.changed: Callable[[Vessel], None] = lambda _: None
        self._pilot, self._law, self._save = pilot, law, save
        self._table = {parameter.name: parameter for parameter in parameters_of(vessel)}

    @property
    def names(self) -> tuple[str, ...]:
        """All names, in the order of the file."""
        return tuple(self._table)

    def get(self, name: str) -> float:
        """Return the value in force, or kept for the next start."""
        return value_of(self.vessel, self._table[name])

    def set(self, name: str, value: float) -> str:
        """Put a value in force and keep it; return '' or what people should know: a refusal, or when it counts."""
        parameter = self._table[name]
        try:
            vessel = with_value(self.vessel, parameter, value)
            if vessel == self.vessel:
                return ""
            later = parameter.path.startswith(LATER)
            if not later:
                self._put_in_force(vessel)
        except (ValueError, RefusedError) as error:
            return f"{name} not changed: {error}"
        self.vessel = vessel
        try:
            self._save(self.saved_as, dump_vessel(vessel))
        except InputError as error:
            return f"{name} changed, but not kept: {error}"
        return f"{name} counts from the next start on" if later else ""

    def adopt(self, vessel: Vessel) -> str:
        """Put all of `vessel` in force and keep it; return '' or that it could not be kept.

        Raises RefusedError where its gains must not be engaged, or the rudder stands outside its limits.
        """
        self._put_in_force(vessel)
        self.vessel = vessel
        try:
            self._save(self.saved_as, dump_vessel(vessel))
        except InputError as error:
            return f"in force, but not kept: {error}"
        return ""

    def _put_in_force(self, vessel: Vessel) -> None:
        if self._law != TRIAL_LAW and (verdict := verdict_of(vessel, self._law)).refusal:
            raise RefusedError(verdict.refusal)
        config = pilot_config(vessel, self._law)
        if abs(self._pilot.told.angle) > config.limits.angle_max:
            raise RefusedError("the rudder stands further over now; try again when it is nearer to amidships")
        self._pilot.reconfigure(config, law_of(vessel, self._law))
        self.changed(vessel)
        if self.log is not None:
            self.log.keep_vessel(dump_vessel(vessel))


def tuned_file(vessel_path: str) -> Path:
    """Return the file beside the one that was started from, in which changes are kept: boat.yaml, boat.tuned.yaml.

    A boat that ships with the program (`lanxin`) is tuned in the present folder.
    """
    path = Path(vessel_path)
    return path.with_name(f"{path.stem}.tuned.yaml")
