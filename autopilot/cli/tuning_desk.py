"""Response levels and learnt models as ground stations order them: gains are designed beside the loop, in a thread.

Designing takes some hundred milliseconds, which is several ticks; what comes out is put in force between two ticks, by
the loop itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import replace

from autopilot.cli.gains import Wish, designed
from autopilot.cli.learning_desk import LearningDesk
from autopilot.errors import InputError, RefusedError
from autopilot.loop.vessel_in_force import VesselInForce
from autopilot.params.vessel import Vessel

BUSY = "another change is being worked out: try again in a moment"


class Change:
    """One change under way: a `links.boat.tuning.Tuning`."""

    def __init__(self, work: Future[Vessel] | None, finish: Callable[[Vessel], str]) -> None:
        self._work, self._finish = work, finish
        self.is_over = False
        self.is_complete = False
        self.said = ""

    @property
    def progress(self) -> float:
        """Not known in between."""
        return 1.0 if self.is_over else 0.5

    def turn(self) -> None:
        """Put in force what has been worked out."""
        if self.is_over or self._work is None or not self._work.done():
            return
        try:
            self.end(self._finish(self._work.result()))
        except (InputError, RefusedError) as error:
            self.said = f"not changed: {error}"
            self.is_over = True

    def end(self, said: str) -> None:
        """It is in force."""
        self.said, self.is_over, self.is_complete = said, True, True


class TuningDesk:
    """A `links.boat.tuning.Tuner`. `learning`: what learns in this run, None where nothing does; `pool`: where gains
    are designed.

    Call `turn` after every tick, `close` at the end.
    """

    def __init__(self, in_force: VesselInForce, learning: LearningDesk | None, pool: Executor | None = None) -> None:
        self.level = math.nan
        self._in_force, self._learning = in_force, learning
        self._pool = pool or ThreadPoolExecutor(1, thread_name_prefix="design")
        self._change: Change | None = None

    def set_level(self, level: int) -> Change:
        """Begin to put a response level in force. Raises InputError."""
        if not 1 <= level <= 9:
            raise InputError(f"response level {level}: allowed is 1 (calm) to 9 (quick)")
        before = self._in_force.running

        def finish(vessel: Vessel) -> str:
            present = self._in_force.running
            if present.model != before.model or present.rudder != before.rudder:
                raise InputError("model or rudder were changed meanwhile; try again")
            ours, new = present.control, vessel.control
            gains = replace(ours, backstepping=new.backstepping, pid=new.pid, sliding=new.sliding)
            kept = self._in_force.adopt(replace(present, control=gains))
            self.level = float(level)
            return f"response level {level}{'; ' if kept else ''}{kept}"

        return self._begin(before, Wish(level), finish)

    def adopt(self) -> Change:
        """Begin to put the proved model in force, with gains for it. Raises InputError."""
        desk = self._desk()
        before, wanted = desk.wanted()
        wish = Wish(int(self.level)) if math.isfinite(self.level) else Wish()

        def finish(vessel: Vessel) -> str:
            if self._in_force.running != before:
                raise InputError("the vessel was changed meanwhile; try again")
            return desk.put(before, vessel)

        return self._begin(wanted, wish, finish)

    def revert(self) -> Change:
        """Put back in force what was before the latest adoption. Raises InputError."""
        change = Change(None, lambda _: "")
        change.end(self._desk().revert())
        return change

    def learnt(self) -> dict[str, float]:
        """Return what was learnt by names of at most ten characters."""
        return self._learning.values() if self._learning is not None else {}

    def turn(self) -> None:
        """Put in force what has been worked out since the last tick."""
        if self._change is not None:
            self._change.turn()

    def close(self) -> None:
        """Wait for what is being worked out."""
        self._pool.shutdown()

    def _begin(self, vessel: Vessel, wish: Wish, finish: Callable[[Vessel], str]) -> Change:
        if self._change is not None and not self._change.is_over:
            raise InputError(BUSY)
        self._change = Change(self._pool.submit(designed, vessel, wish), finish)
        return self._change

    def _desk(self) -> LearningDesk:
        if self._learning is None:
            raise InputError("nothing is learnt in this run: start with --learn")
        return self._learning
