"""The vessel of a running pilot, kept beside the file it came from, and changed by ground stations.

What counts at once is put in force between two ticks, what waits for the next start is stored alone, and the answer
says so (`vessel.parameters`). A change is refused with a sentence where the schema or the gains' margins do not allow
it, for what runs or for what the next start finds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from autopilot.errors import InputError, RefusedError
from autopilot.files.saving import save_text
from autopilot.pilot import Pilot
from autopilot.runtime.build import build_pilot, law_of, pilot_config, refusal_to_engage
from autopilot.vessel.file import doubts, dump_vessel, problems
from autopilot.vessel.parameters import Vessels, parameters_of, value_of, with_value
from autopilot.vessel.schema import Vessel

if TYPE_CHECKING:
    from autopilot.runtime.record import Recorder


class VesselStore:
    """A `ParameterStore` over the running pilot's vessel.

    Args:
        vessel: as it was read.  law: the law that steers, None for the file's own.
        saved_as: the file that changes are kept in.
        save: writes a text to a file; may do so later, from another thread.
        refuse: raises RefusedError where a vessel could not be started with the links of this run.

    Attributes:
        revision: counts the changes.
        log: where changes of what runs are written down, None without a log.  changed: is given every vessel that
        runs from now on, for what works with it outside of the pilot.
    """

    def __init__(
        self,
        vessel: Vessel,
        pilot: Pilot,
        law: str | None,
        saved_as: Path,
        save: Callable[[Path, str], None] = save_text,
        refuse: Callable[[Vessel], None] = lambda _: None,
    ) -> None:
        self.saved_as = saved_as
        self.revision = 0
        self.log: Recorder | None = None
        self.changed: Callable[[Vessel], None] = lambda _: None
        self._vessels = Vessels(vessel, vessel)
        self._pilot, self._save, self._refuse = pilot, save, refuse
        # a run with another law than the file's must leave the file's own as startable as it was
        self._law, self._starts = law, (law, None) if law is not None and _starts(vessel, None) else (law,)
        self._table = {parameter.name: parameter for parameter in parameters_of(vessel)}

    @property
    def running(self) -> Vessel:
        """What pilot and links work with."""
        return self._vessels.running

    @property
    def stored(self) -> Vessel:
        """What the next start reads; a parameter's value is that of this."""
        return self._vessels.stored

    @property
    def waiting(self) -> tuple[str, ...]:
        """The keys that are stored otherwise than they run."""
        return self._vessels.waiting

    @property
    def names(self) -> tuple[str, ...]:
        """All names, in the order of the file."""
        return tuple(self._table)

    def get(self, name: str) -> float:
        """Return the value that is stored: in force, or kept for the next start."""
        return value_of(self.stored, self._table[name])

    def set(self, name: str, value: float) -> str:
        """Change a value and keep it; return '' or what people should know: a refusal, or when it counts."""
        parameter = self._table[name]
        try:
            stored = with_value(self.stored, parameter, value)
            kept = "" if stored == self.stored else self.put(stored)
        except (ValueError, RefusedError) as error:
            return f"{name} not changed: {error}"
        if kept:
            return f"{name} changed, but not kept: {kept}"
        said = [f"{name} counts from the next start on"] if parameter.path in self.waiting else []
        said += [sentence for path, sentence in doubts(stored) if path == parameter.path]
        return "; ".join(said)

    def keep_compass(self, source: str) -> str:
        """Keep which compass was chosen, '' for none; return '' or why it could not be kept."""
        sensors = replace(self.stored.sensors, compass=source)
        try:
            return self.put(replace(self.stored, sensors=sensors))
        except RefusedError as error:
            return str(error)

    def put(self, stored: Vessel) -> str:
        """Keep `stored` and put in force what of it counts at once; return '' or why it could not be kept.

        Raises RefusedError where it would be refused at the next start, its gains must not be engaged, or the rudder
        stands outside its limits.
        """
        vessels = self._vessels.storing(stored)
        for each in vessels:
            for _, sentence in problems(each):
                raise RefusedError(sentence)
        self._refuse(stored)
        try:
            for law in self._starts:
                build_pilot(stored, law)
            if vessels.running != self.running:
                self._put_in_force(vessels.running)
        except ArithmeticError as error:
            # what a station writes must never end the run
            raise RefusedError(f"no pilot can be worked out for it ({error})") from error
        self._vessels = vessels
        self.revision += 1
        try:
            self._save(self.saved_as, dump_vessel(stored))
        except InputError as error:
            return str(error)
        return ""

    def _put_in_force(self, vessel: Vessel) -> None:
        if refusal := refusal_to_engage(vessel, self._law):
            raise RefusedError(refusal)
        config = pilot_config(vessel, self._law)
        if abs(self._pilot.last_command.angle) > config.limits.angle_max:
            raise RefusedError("the rudder stands further over now; try again when it is nearer to amidships")
        self._pilot.reconfigure(config, law_of(vessel, self._law))
        self.changed(vessel)
        if self.log is not None:
            self.log.keep_vessel(dump_vessel(vessel))


def _starts(vessel: Vessel, law: str | None) -> bool:
    try:
        build_pilot(vessel, law)
    except (ValueError, RefusedError):
        return False
    return True


def tuned_file(vessel_path: str) -> Path:
    """Return the file beside the one that was started from, in which changes are kept: boat.yaml, boat.tuned.yaml.

    A boat that ships with the program (`lanxin`) is tuned in the present folder.
    """
    path = Path(vessel_path)
    return path.with_name(f"{path.stem}.tuned.yaml")
