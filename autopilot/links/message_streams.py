"""Which messages the vehicle shall send and how often: asked for with SET_MESSAGE_INTERVAL until they come. Pure."""

from __future__ import annotations

import math

from autopilot.signals import AlarmEvent

FIRST_CHECK_S = 0.7
CHECK_S = 2.0
ENOUGH = 0.6
"""A stream below this share of its rate is asked for again: requests get lost, and ground stations change rates."""
PATIENT_CHECKS = 3
"""So many checks in a row may find the most wanted stream too slow before people are told."""
HEADINGS_IN_TIMEOUT = 3
"""Headings that must come within the time in which they grow too old: two may be lost in a row, as one in ten are on a
line that loses a third."""
WAITING = "waiting for headings (ATTITUDE) at the rate asked for"


TOO_SLOW = (
    "headings (ATTITUDE) come at {rate:.1f} Hz, and {least:.1f} Hz is the least to steer by "
    "(3 within failsafe.heading_timeout_s); they are asked for on and on: raise the link's baud rate (SERIALn_BAUD), "
    "or let ground stations ask for less (SRn_ parameters)"
)


class MessageStreams:
    """Counts what arrives and names what must be asked for.

    Args:
        rates_hz: wanted rate by message id, the most wanted first.
        timeout [s]: age at which the most wanted counts as lost; inf: at none.
    """

    def __init__(self, rates_hz: dict[int, float], timeout: float = math.inf) -> None:
        self._rates = dict(rates_hz)
        # what was asked for cannot be too slow
        self._least = min(HEADINGS_IN_TIMEOUT / timeout, ENOUGH * next(iter(self._rates.values())))
        self.reset()

    @property
    def waiting(self) -> str:
        """Why it is too soon to engage: the first stream has not come at its rate yet, or stays too slow to steer by.

        '' once it has come, or is slower than asked for and fast enough.
        """
        return self._too_slow if self._settled else WAITING

    @property
    def slow(self) -> AlarmEvent | None:
        """The alarm of a first stream that stays slow however often it is asked for; None where it does not."""
        return self._slow

    def reset(self) -> None:
        """Ask for everything anew, as after a reboot."""
        self._slow: AlarmEvent | None = None
        self._too_slow = ""
        self._slow_checks = 0
        self._settled = False
        self._counts = dict.fromkeys(self._rates, 0)
        self._since: float | None = None
        self._checked = False

    def count(self, message_id: int) -> None:
        """Note that a message of a wanted id has come."""
        self._counts[message_id] += 1

    def due(self, now: float) -> list[tuple[int, int]]:
        """Return (message id, interval [us]) of the streams to ask for at `now` [s]."""
        passed = 0.0 if self._since is None else now - self._since
        if self._since is not None and passed < (CHECK_S if self._checked else FIRST_CHECK_S):
            return []
        first = self._since is None
        if not first:
            self._checked = True
            self._watch_first(passed)
        needed = passed * ENOUGH
        wanted = [
            (identity, round(1.0e6 / rate))
            for identity, rate in self._rates.items()
            if first or self._counts[identity] < rate * needed
        ]
        self._since = now
        self._counts = dict.fromkeys(self._rates, 0)
        return wanted

    def _watch_first(self, seconds: float) -> None:
        identity, wanted = next(iter(self._rates.items()))
        rate = self._counts[identity] / seconds
        self._too_slow = TOO_SLOW.format(rate=rate, least=self._least) if 0.0 < rate < self._least else ""
        if rate >= wanted * ENOUGH:
            self._slow, self._slow_checks, self._settled = None, 0, True
            return
        self._slow_checks += 1
        if self._slow_checks < PATIENT_CHECKS:
            return
        self._settled = True
        # said once: a rate that wavers is no news; that nothing comes at all others will say
        if self._counts[identity] and not self._slow:
            self._slow = AlarmEvent("headings_slow", f"{rate:.0f} Hz though {wanted:.0f} Hz")
