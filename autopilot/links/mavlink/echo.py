"""The echo of an override: whether the vehicle's reports of a channel, and of its output, show what we ask for.

The same for the steering and for a bow thruster. Pure; times in seconds.
"""

from __future__ import annotations

import math

DISOBEDIENCE_S = 1.0
"""The rudder may differ from the command this long: reports come at 5 to 10 Hz and are as old as the link."""
AGREEMENT_WEIGHT = 0.5
"""Reports that agree make good half as much: a rudder that follows somebody else every other time is found out too."""
PULSE_TOLERANCE_US = 3
HISTORY_S = 1.0


class OverrideEcho:
    """Whether an override shows in what the vehicle reports: one for each channel that is overridden. Times in seconds.

    Attributes:
        began: when the overriding began.  report_time: when something was reported last, -inf before.
    """

    def __init__(self) -> None:
        self.began = self.report_time = -math.inf
        self._is_held = False
        self._sent: dict[int, float] = {}
        self._doubts: dict[str, tuple[float, float]] = {}

    def commanded(self, now: float, pulse: int | None) -> None:
        """Take a command as it was sent: the input pulse [us] it asks for, None where it asks for something else."""
        if not self._is_held:
            self._is_held, self._doubts = True, {}
            self.began = self.report_time = now
        if pulse is not None:
            self._sent.pop(pulse, None)  # its last time orders it
            self._sent[pulse] = now
        for oldest in [*self._sent]:
            if now - self._sent[oldest] <= HISTORY_S:
                break
            del self._sent[oldest]

    def released(self) -> None:
        """Take note that nothing is overridden any more."""
        self._is_held = False
        self._sent.clear()

    @property
    def pulses(self) -> list[int]:
        """Input pulses [us] commanded in the `HISTORY_S` before the last command, each once, the newest last."""
        return [*self._sent]

    def shows(self, now: float, what: str, pulse: int, expected: list[int]) -> str:
        """Compare a reported `pulse` [us] with those that the commands of late ask for, the newest last; return what it
        is that has differed for too long, '' where nothing has.

        It is one of them: between two that lie on either side a pulse that stands still would seem to obey for as long
        as the order swings about it. `what` names the report, such as "RC channel 1" or "servo 1".
        """
        return differing(what, pulse, expected) if self.disagrees(now, what, agrees_with(pulse, expected)) else ""

    def disagrees(self, now: float, what: str, agrees: bool) -> bool:
        """Take whether the report `what` agrees with what is commanded; return whether it has not for too long."""
        self.report_time = now
        last, doubt = self._doubts.get(what, (self.began, 0.0))
        passed = now - last if now - last < DISOBEDIENCE_S else DISOBEDIENCE_S
        doubt += -AGREEMENT_WEIGHT * passed if agrees else passed
        self._doubts[what] = (now, doubt if doubt > 0.0 else 0.0)
        return doubt > DISOBEDIENCE_S


def agrees_with(pulse: int, expected: list[int]) -> bool:
    """Return whether a reported `pulse` [us] is one of those that are expected."""
    return any(-PULSE_TOLERANCE_US <= pulse - each <= PULSE_TOLERANCE_US for each in expected)


def differing(what: str, pulse: int, expected: list[int]) -> str:
    """Return what is said of a reported `pulse` [us] that is none of those that are expected."""
    return f"{what} is at {pulse} us while {expected[-1]} is commanded"
