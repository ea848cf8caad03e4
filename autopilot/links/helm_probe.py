"""Whether the vehicle takes our steering, found out before the pilot may engage and without moving the rudder. Pure.

ArduPilot ignores overrides in silence: from a system id that is not its ground station's, while the pilot's override
switch is off, or when its parameters are other than they were read. So a pulse is sent that differs from the present
one by a few microseconds, inside the dead zone where there is one, and RC_CHANNELS must show exactly that pulse. Then
nothing is sent for a moment, in which it must stay: whoever else overrides the input shows then.
"""

from __future__ import annotations

import math

from autopilot.links.companion_output import SteeringOutput
from autopilot.links.mavlink_codec import Message

REPEAT_S = 0.1
PATIENCE_S = 2.5
"""A slow telemetry radio may take this long from our message to the vehicle's report of it."""
RETRY_S = 4.0
SEEN_REPORTS = 3
"""So many reports in a row must show the pulse: a stick that a hand moves passes by."""
PAUSE_S = 0.35
"""Others repeat their overrides at 5 Hz at least."""
PAUSE_REPORTS = 2
OTHER = (
    "another pilot or ground station overrides the steering input: RC channel {number} went to {pulse} us while "
    "{ours} us was sent last; stop it, or start with --with-other-pilot"
)
REPORT_TIMEOUT_S = 3.0


class HelmProbe:
    """One proof for each start of the vehicle. `may_share`: others may override the input too.

    Attributes:
        reason: why the helm is not ours yet; empty once the vehicle has shown that it takes our steering.
    """

    def __init__(self, output: SteeringOutput, may_share: bool = False) -> None:
        self._output = output
        self._may_share = may_share
        self.reset()

    def reset(self) -> None:
        """Ask for the proof anew, as after a reboot."""
        self.reason = "waiting for the vehicle to report its steering input (RC_CHANNELS)"
        self._reported: int | None = None
        self._report_time = -math.inf
        self._message: Message | None = None
        self._pulse = 0
        self._began = self._next = -math.inf
        self._seen = 0
        self._paused: float | None = None

    @property
    def pulse(self) -> int:
        """The input [us] that the proof asks for."""
        return self._pulse

    @property
    def passed(self) -> bool:
        """Whether the vehicle has shown that it takes our steering."""
        return not self.reason

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
        if self._seen >= SEEN_REPORTS:
            self._paused, self._seen = now, 0
            if self._may_share:
                self.reason, self._message = "", None
        elif now - self._began > PATIENCE_S:
            self._refuse(
                now,
                f"the vehicle does not take our steering: RC channel {number} stays at {pulse} us while {self._pulse} "
                "us is sent; switch radio override on, close other ground stations, or start with --as-gcs",
            )

    def _judge_pause(self, now: float, number: int, pulse: int) -> None:
        assert self._paused is not None
        if pulse != self._pulse:
            self._refuse(now, OTHER.format(number=number, pulse=pulse, ours=self._pulse))
            return
        self._seen += 1
        if now - self._paused >= PAUSE_S and self._seen >= PAUSE_REPORTS:
            self.reason, self._message, self._paused = "", None, None

    def _refuse(self, now: float, reason: str) -> None:
        self._message, self._reported, self._paused, self._next = None, None, None, now + RETRY_S
        self.reason = reason

    def due(self, now: float) -> Message | None:
        """Return the message to send at `now` [s], None where none is."""
        if self.passed or now < self._next:
            return None
        if now - self._report_time > REPORT_TIMEOUT_S:
            self._message = self._paused = None
            return None
        if self._paused is not None:
            return None
        if self._message is None:
            if self._reported is None:
                return None
            found = self._output.unmoving(self._reported)
            if found is None:
                return None
            self._message, self._pulse = found
            self._began, self._seen = now, 0
            tried = self.reason.startswith(("the vehicle does", "another pilot"))
            self.reason = self.reason if tried else "checking the steering input"
        self._next = now + REPEAT_S
        return self._message
