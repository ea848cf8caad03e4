"""Whether the vehicle takes our steering, found out before the pilot may engage and without moving the rudder. Pure.

ArduPilot ignores overrides in silence: from a system id that is not its ground station's, while the pilot's override
switch is off, or when its parameters are other than they were read. So a pulse is sent that differs from the present
one by a few microseconds, inside the dead zone where there is one, and RC_CHANNELS must show exactly that pulse. Then
nothing is sent for a moment, in which it must stay: whoever else overrides the input shows then.

It is proved at the start, so that the skipper hears early of what stands in the way, and anew for each engagement:
another pilot may have taken the helm since.
"""

from __future__ import annotations

import math
from enum import Enum

from autopilot.links.companion_output import TOLD_APART_US, SteeringOutput
from autopilot.links.mavlink_codec import Message

REPEAT_S = 0.1
PATIENCE_S = 2.5
"""A slow telemetry radio may take this long from our message to the vehicle's report of it."""
RETRY_S = 4.0
SEEN_REPORTS = 3
"""So many reports in a row must show the pulse: a stick that a hand moves passes by."""
STRANGE_REPORTS = 2
"""One report may have been overtaken on its way."""
PAUSE_S = 0.35
"""Others repeat their overrides at 5 Hz at least."""
PAUSE_REPORTS = 2
OTHER = (
    "another pilot or ground station overrides the steering input: RC channel {number} went to {pulse} us while "
    "{ours} us was sent last; stop it, or start with --with-other-pilot"
)
MOVES = (
    "another pilot or ground station, or a hand, moves the steering input (RC channel {number}) and ours does not "
    "show: hold the stick still, and stop what else steers"
)
REPORT_TIMEOUT_S = 3.0
CHECKED_ON_ENGAGING = "the steering input is checked anew when an order to engage comes"
CHECKING = "checking the steering input"


class Stage(Enum):
    """How far a proof is; the reason says it in words."""

    WAITING = "nothing is reported yet"
    CHECKING = "a pulse of ours is sent, or will be"
    NOT_TAKEN = "the vehicle does not take our steering"
    SHARED = "somebody else, or a hand, moves the input"
    GROWN_OLD = "proved once, and proved anew when somebody waits for it"
    PASSED = "the vehicle takes our steering"


class HelmProbe:
    """One proof when the vehicle starts and one for each engagement. `may_share`: others may override the input too.

    Attributes:
        reason: why the helm is not ours yet; empty once the vehicle has shown that it takes our steering.
        stage: how far the proof is.
    """

    def __init__(self, output: SteeringOutput, may_share: bool = False) -> None:
        self._output = output
        self._may_share = may_share
        self._is_waited_for = True
        self.reset()

    def reset(self) -> None:
        """Ask for the proof anew, as after a reboot."""
        self.stage = Stage.WAITING
        self.reason = "waiting for the vehicle to report its steering input (RC_CHANNELS)"
        self._reported: int | None = None
        self._report_time = -math.inf  # unheard of for ever is silent
        self._message: Message | None = None
        self._pulse = 0
        self._began = self._next = -math.inf
        self._base = self._seen = self._strange = self._moves = 0
        self._has_shown = False
        self._paused: float | None = None

    def wanted(self, waits: bool) -> None:
        """Take whether an order to engage waits, while we do not steer: a proof that nobody waits for grows old.

        Where others may override the input too the first proof is enough, and another would not come through.
        """
        if self._may_share:
            return
        self._is_waited_for = waits
        if waits and self.stage is Stage.GROWN_OLD:
            self.stage, self.reason = Stage.CHECKING, CHECKING
        elif not waits and self.passed:
            self.stage, self.reason = Stage.GROWN_OLD, CHECKED_ON_ENGAGING

    @property
    def pulse(self) -> int:
        """The input [us] that the proof asks for."""
        return self._pulse

    @property
    def passed(self) -> bool:
        """Whether the vehicle has shown that it takes our steering."""
        return self.stage is Stage.PASSED

    @property
    def under_way(self) -> bool:
        """Whether a pulse of ours is being sent."""
        return self._message is not None

    def report(self, now: float, number: int, pulse: int) -> None:
        """Take what RC_CHANNELS says of the steering channel `number`."""
        self._report_time = now
        if self._message is None:
            self._reported = pulse
            return
        if self._paused is not None:
            self._judge_pause(now, number, pulse)
            return
        self._seen = self._seen + 1 if pulse == self._pulse else 0
        self._has_shown = self._has_shown or self._seen > 0
        # an override stays for seconds: what shows behind ours is no stick
        self._strange += self._has_shown and pulse != self._pulse
        if self._strange >= STRANGE_REPORTS and not self._may_share:
            self._refuse(now, Stage.SHARED, OTHER.format(number=number, pulse=pulse, ours=self._pulse))
        elif self._seen >= SEEN_REPORTS:
            self._paused, self._seen = now, 0
            if self._may_share:
                self.stage, self.reason, self._message = Stage.PASSED, "", None
        elif now - self._began > PATIENCE_S and self._moves >= STRANGE_REPORTS:
            self._refuse(now, Stage.SHARED, MOVES.format(number=number))
        elif now - self._began > PATIENCE_S:
            self._refuse(
                now,
                Stage.NOT_TAKEN,
                f"the vehicle does not take our steering: RC channel {number} stays at {pulse} us while {self._pulse} "
                "us is sent; switch radio override on, close other ground stations, or start with --as-gcs",
            )
        elif not self._has_shown and abs(pulse - self._base) > TOLD_APART_US:
            self._moves += 1
            self._aim(pulse)  # where the rudder was is no place to hold it

    def _aim(self, pulse: int) -> None:
        """Have a pulse sent that leaves the servo where an input `pulse` [us] has it."""
        found = self._output.unmoving(pulse)
        if found is not None:
            self._base = pulse
            self._message, self._pulse = found

    def _judge_pause(self, now: float, number: int, pulse: int) -> None:
        assert self._paused is not None
        if pulse != self._pulse:
            self._refuse(now, Stage.SHARED, OTHER.format(number=number, pulse=pulse, ours=self._pulse))
            return
        self._seen += 1
        if now - self._paused >= PAUSE_S and self._seen >= PAUSE_REPORTS:
            self.stage, self.reason, self._message, self._paused = Stage.PASSED, "", None, None

    def _refuse(self, now: float, stage: Stage, reason: str) -> None:
        self._message, self._reported, self._paused, self._next = None, None, None, now + RETRY_S
        self.stage, self.reason = stage, reason

    def due(self, now: float) -> Message | None:
        """Return the message to send at `now` [s], None where none is."""
        if self.stage in (Stage.PASSED, Stage.GROWN_OLD) or now < self._next:
            return None
        if self._message is None and not self._is_waited_for and self.stage is Stage.SHARED:
            return None  # to try again would disturb who steers
        if now - self._report_time > REPORT_TIMEOUT_S:
            self._message = self._paused = None
            return None
        if self._paused is not None:
            return None
        if self._message is None:
            if self._reported is None:
                return None
            self._aim(self._reported)
            if self._message is None:
                return None
            self._began, self._seen, self._strange, self._moves, self._has_shown = now, 0, 0, 0, False
            # what the last try found stays said while the next is under way
            if self.stage not in (Stage.NOT_TAKEN, Stage.SHARED):
                self.stage, self.reason = Stage.CHECKING, CHECKING
        self._next = now + REPEAT_S
        return self._message
