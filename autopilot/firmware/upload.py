"""Upload of parameters: read what is there, set what differs, read all of it back, and say what became of each.

What became of each parameter of an upload, and what an upload changes, for the journal and the way back.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from enum import StrEnum
from typing import NamedTuple

from autopilot.firmware.file import Wanted
from autopilot.firmware.protocol import (
    PATIENCE,
    LinkQuality,
    Message,
    Number,
    ParameterValue,
    Requests,
    Target,
    controls,
    encode,
    is_from,
    parameter_value,
    read_by_name,
    refused_name,
    refused_value,
    request_list,
    same_value,
    set_value,
)


class Verdict(StrEnum):
    """What became of a parameter."""

    UNCHANGED = "unchanged"
    SET = "set"
    WOULD_SET = "would set"
    DIFFERENT = "differs"
    CONSTRAINED = "constrained"
    REJECTED = "rejected"
    UNKNOWN = "unknown"
    UNCONFIRMED = "unconfirmed"


GOOD = frozenset({Verdict.UNCHANGED, Verdict.SET})


class Outcome(NamedTuple):
    """One parameter of the file after the upload. `old` and `now` are None where the vehicle gave no answer."""

    name: str
    old: Number | None
    wanted: Number
    now: Number | None
    verdict: Verdict
    reason: str = ""
    reboot: bool = False

    @property
    def is_good(self) -> bool:
        """Whether the vehicle holds what was wanted."""
        return self.verdict in GOOD


class Change(NamedTuple):
    """One parameter that an upload changes: its MAV_PARAM_TYPE, the value before and the value wanted."""

    name: str
    kind: int
    old: Number
    new: Number


ENABLING_ENDS = ("_ENABLE", "_ENABLED", "_EN", "_TYPE", "_MONITOR")
"""Ends of the names of ArduPilot parameters that bring the rest of their group into being (AP_PARAM_FLAG_ENABLE)."""


def enabled_group(name: str) -> str | None:
    """Return the beginning of the names in the group that parameter `name` switches: `GRP_` for `GRP_ENABLE`."""
    for end in ENABLING_ENDS:
        if name.endswith(end) and len(name) > len(end):
            return name.removesuffix(end) + "_"
    return None


MISMATCHES_TO_ACCEPT = 3
"""A different value must come this often before it is the vehicle's last word: single ones may be late answers."""

LIST_FROM = 64
"""From so many parameters on, the vehicle's whole list is asked for first: it comes quicker than so many answers, one
by one, and what it leaves out is asked for by name."""
LIST_QUIET_S = 0.8
"""A list that has paused this long has ended."""
SETTLE_S = 2.0
"""After the last set, so long until what the vehicle says is taken for what it holds: an answer to a set may be an
echo, ArduPilot's slowest checks of a parameter run once a second (one_second_loop), and late echoes have come by
then."""
SETTLE_ROUND_TRIPS = 4.0
"""And no less than so many round trips of this link."""
ROUNDS_MAX = 3
"""So often is a parameter set again that was read back different: on a lossy link the sets alone may have got
lost while their reads came through."""


GOES_OFF = 2
"""The rank of what switches a group off: last."""


class Phase(StrEnum):
    """Where an upload stands."""

    READING = "reading"
    COMPARED = "compared"
    SETTING = "setting"
    READING_AGAIN = "reading again"
    VERIFYING = "verifying"
    FINISHED = "finished"


class _Item:
    """One parameter on its way."""

    def __init__(self, wanted: Wanted) -> None:
        self.wanted = wanted
        self.name = wanted.name
        self.old: ParameterValue | None = None
        self.now: ParameterValue | None = None
        self.reason = ""
        self.refusal = ""
        self.is_due = False
        self.was_sent = False
        self.mismatches = 0
        self.is_settled = False
        self.was_read = False

    def holds_wanted(self) -> bool:
        return self.now is not None and same_value(self.now.value, self.wanted.value, self.now.kind)

    def rank(self) -> int:
        """What is switched on goes first, for it brings others into being; what is switched off goes last."""
        if enabled_group(self.name) is None and not self.wanted.enables:
            return 1
        return 0 if self.wanted.value else GOES_OFF


def _is_of(item: _Item, switches: Iterable[_Item]) -> bool:
    """Whether a parameter is in the group of one of the switches."""
    return any((group := enabled_group(each.name)) and item.name.startswith(group) for each in switches)


class Upload:
    """Writes `wanted` to the target. Give `receive` every message and send what `due` returns, until `finished`.

    It is finished a first time when everything is read and compared; `proceed` then sets what differs, what is
    switched on before the rest. Names that were unanswered are asked once more afterwards, because a parameter
    switched on can bring its group into being; where that finds some, it is finished again, so that their old
    values can be kept, and `proceed` goes on. After the last set the vehicle is left alone for `SETTLE_S`, whatever it
    says does not count, and then it is asked for everything; what was set in a group that goes off with this upload is
    asked for in the same way before it does. It `is_over` when all is read back. Only `outcomes` after that are the
    vehicle's last word; before they say what is known so far.

    settles: an upload that was cut off came before, and its last sets, with their answers, may be on the way: the
    vehicle is left alone for as long before the first question, too.
    """

    def __init__(self, target: Target, wanted: Sequence[Wanted], *, settles: bool = False) -> None:
        self._target = target
        self._quality = LinkQuality()
        self._items = [_Item(each) for each in wanted]
        self._by_name = {name: item for item in self._items for name in item.wanted.names}
        self._has_read_again = self._has_read_before_off = False
        self._rounds = 0
        self._list_since: float | None = None
        self._settles = settles
        self._settled_at: float | None = None
        self.phase = Phase.READING
        self._requests = self._reads(self._items)
        self._wants_list = self._is_long()

    @property
    def finished(self) -> bool:
        """Whether there is nothing to do until `proceed`."""
        return self.phase in (Phase.COMPARED, Phase.FINISHED)

    @property
    def is_over(self) -> bool:
        """Whether everything is set and read back."""
        return self.phase is Phase.FINISHED

    @property
    def differs(self) -> bool:
        """Whether there is anything that `proceed` would set."""
        return any(item.is_due for item in self._items)

    @property
    def may_bring_unknown(self) -> bool:
        """Whether something is to be switched on that can bring every unknown name into being."""
        groups = [enabled_group(item.name) or "" for item in self._items if item.is_due and item.rank() == 0]
        return all(item.name.startswith(tuple(groups)) for item in self._unknown()) if groups else False

    def proceed(self) -> None:
        """Set what differs; it must be `finished` comparing."""
        if self.phase is Phase.COMPARED:
            self._set_next()

    @property
    def held(self) -> dict[str, ParameterValue]:
        """What the vehicle has said last of each name that it answers for."""
        return {item.name: item.now for item in self._items if item.now is not None}

    def changes(self) -> list[Change]:
        """Return what has been or will be set next, with the values before."""
        return [
            Change(item.name, item.old.kind, item.old.value, item.wanted.value)
            for item in self._items
            if item.old is not None and (item.is_due or item.was_sent)
        ]

    @property
    def progress(self) -> tuple[int, int]:
        """Steps done, of three a parameter: read, set, verified."""
        if self.is_over:
            return 3 * len(self._items), 3 * len(self._items)
        done = sum((item.old is not None) + item.holds_wanted() + item.is_settled for item in self._items)
        return done, 3 * len(self._items)

    def receive(self, now: float, message: Message) -> None:
        """Take any message; those that are not the target's PARAM_VALUE of a name wanted are ignored."""
        if is_from(message, self._target):
            self._quality.on_packet(now)
        is_asking = self.phase is not Phase.SETTING and not self._settles
        if is_asking and (refused := refused_name(message, self._target)) is not None:
            self._requests.refused(refused)
        if (refusal := refused_value(message, self._target)) is not None and refusal[0] in self._by_name:
            self._by_name[refusal[0]].refusal = f"; the vehicle says: {refusal[1]}"
        value = parameter_value(message, self._target)
        if value is None or self.finished or self._settles:
            return
        if value.position == 0:
            self._quality.control_answered()
        item = self._by_name.get(value.name)
        if item is None or item.is_settled or (item.old is not None and item.name != value.name):
            return
        item.now = value
        is_new = item.old is None
        if is_new:
            self._take_first(item, value, now)
        elif self._is_accepted(item):
            self._requests.answered(value.name, now)
            # a late answer to an earlier question must not overwrite what was read back
            item.is_settled = item.was_read = self.phase is Phase.VERIFYING
        # what another station asks for or writes meanwhile brings the same names again and again
        if self._list_since is not None and (is_new or item.is_settled):
            self._list_since = now

    def _take_first(self, item: _Item, value: ParameterValue, now: float) -> None:
        item.name = value.name
        item.old = value
        for name in item.wanted.names:
            self._requests.answered(name, now)
        try:
            encode(item.wanted.value, value.kind, self._target.bytewise)
        except ValueError as error:
            item.reason = str(error)
        item.is_due = not item.reason and not item.holds_wanted()

    def _is_accepted(self, item: _Item) -> bool:
        if item.holds_wanted() or self.phase in (Phase.READING, Phase.READING_AGAIN):
            return True
        item.mismatches += 1
        self._requests.doubt(item.name)
        return min(item.mismatches, self._requests.tries(item.name)) >= MISMATCHES_TO_ACCEPT

    def due(self, now: float) -> list[Message]:
        """Return the messages to send now."""
        while self._requests.done and not self.finished:
            self._next_phase()
        if self.finished:
            return []
        if self._settles:
            if self._settled_at is None:
                self._settled_at = now + max(SETTLE_S, SETTLE_ROUND_TRIPS * self._quality.round_trip_s)
            if now < self._settled_at:
                return []
            self._settles, self._settled_at = False, None
        if self._requests.done or (self._list_since is not None and now - self._list_since > LIST_QUIET_S):
            self._list_since = None
        if self._wants_list:
            self._wants_list, self._list_since = False, now
            return [request_list(self._target)]
        if self._list_since is not None:
            return []
        names = self._requests.due(now)
        is_reading = self.phase in (Phase.READING, Phase.READING_AGAIN)
        return [message for name in names for message in self._questions(name)] + controls(
            self._target, self._quality, is_reading and self._requests.repeats(names)
        )

    def _questions(self, name: str) -> list[Message]:
        """A set is followed by a read from its second try on: some firmware sets without a word."""
        if self.phase is not Phase.SETTING:
            return [read_by_name(self._target, name)]
        item = self._by_name[name]
        assert item.old is not None
        message = set_value(self._target, name, item.wanted.value, item.old.kind)
        return [message] if self._requests.tries(name) == 1 else [message, read_by_name(self._target, name)]

    def _next_phase(self) -> None:
        if self.phase is Phase.READING:
            self.phase = Phase.COMPARED
        elif self.phase is Phase.SETTING and not self._has_read_again and self._unknown():
            self._has_read_again = True
            self.phase = Phase.READING_AGAIN
            self._requests = self._reads(self._unknown())
        elif self.phase is Phase.VERIFYING:
            is_again = self._rounds < ROUNDS_MAX and self._find_doubtful()
            self._has_read_before_off &= not is_again
            if self.differs:
                self._set_next()
            else:
                self.phase = Phase.FINISHED
        elif self.phase is not Phase.SETTING and any(item.is_due and not item.was_sent for item in self._items):
            self.phase = Phase.COMPARED
        else:
            self._set_next()

    def _set_next(self) -> None:
        """Set what is due and goes first; with nothing due any more, read everything back.

        A group that goes off is read back before: it may be silent afterwards.
        """
        due = [item for item in self._items if item.is_due]
        if not due:
            self._verify(self._items)
            return
        first = min(item.rank() for item in due)
        now = [item for item in due if item.rank() == first]
        if first == GOES_OFF:
            hidden = [item for item in self._items if item.was_sent and not item.was_read and _is_of(item, now)]
            if hidden and not self._has_read_before_off:
                self._has_read_before_off = True
                self._verify(hidden)
                return
            self._rounds = self._rounds if any(item.was_sent for item in now) else 0
        for item in now:
            item.is_due, item.was_sent, item.was_read, item.mismatches = False, True, False, 0
        self.phase = Phase.SETTING
        self._requests = Requests([item.name for item in now], PATIENCE, self._quality)

    def _verify(self, items: Sequence[_Item]) -> None:
        self.phase = Phase.VERIFYING
        self._rounds += 1
        for item in self._items:
            item.mismatches, item.is_settled = 0, False
        sent = any(item.was_sent for item in items)
        known = [item for item in items if item.old is not None and not item.reason]
        self._requests = Requests([item.name for item in known if sent], PATIENCE, self._quality)
        self._settles = not self._requests.done
        self._wants_list = self._is_long() and len(known) >= LIST_FROM

    def _is_long(self) -> bool:
        return not self._requests.done and len(self._items) >= LIST_FROM

    def _find_doubtful(self) -> bool:
        """Mark what was read back different to be set once more; return whether there is any.

        What was right before and is not now has changed as another parameter was set.
        """
        doubtful = [item for item in self._items if item.is_settled and not item.holds_wanted()]
        for item in doubtful:
            item.is_settled, item.is_due = False, True
        return bool(doubtful)

    def _unknown(self) -> list[_Item]:
        return [item for item in self._items if item.old is None]

    def _reads(self, items: Iterable[_Item]) -> Requests[str]:
        return Requests([name for item in items for name in item.wanted.names], PATIENCE, self._quality)

    def outcomes(self) -> list[Outcome]:
        """Return what is known of each parameter, in the order of the file."""
        return [self._outcome(item) for item in self._items]

    def _outcome(self, item: _Item) -> Outcome:
        old = item.old.value if item.old else None
        now = item.now.value if item.now else None
        verdict, reason = self._verdict(item)
        return Outcome(item.name, old, item.wanted.value, now, verdict, reason, item.wanted.reboot)

    def _verdict(self, item: _Item) -> tuple[Verdict, str]:
        if item.old is None or item.now is None:
            known = "the vehicle never answered for this name" if self.finished else "not yet answered for"
            return Verdict.UNKNOWN, known
        if item.reason:
            return Verdict.REJECTED, item.reason
        if not item.was_sent:
            return (Verdict.UNCHANGED if item.holds_wanted() else Verdict.WOULD_SET), ""
        is_hidden = not item.is_settled and self._is_hidden(item)
        if not (self.is_over and item.was_read and (item.is_settled or is_hidden)):
            return Verdict.UNCONFIRMED, "sent, but not read back"
        if item.holds_wanted():
            return Verdict.SET, "its group is switched off" if is_hidden else ""
        if same_value(item.now.value, item.old.value, item.now.kind):
            return Verdict.REJECTED, f"the vehicle keeps its old value{item.wanted.allowed}{item.refusal}"
        return Verdict.CONSTRAINED, f"the vehicle holds another value than was sent{item.wanted.allowed}{item.refusal}"

    def _is_hidden(self, item: _Item) -> bool:
        """Whether this upload has switched off the group of a parameter, which is silent since."""
        return _is_of(item, (other for other in self._items if other.rank() == GOES_OFF and other.holds_wanted()))
