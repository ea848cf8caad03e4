"""Upload of parameters: read what is there, set what differs, read all of it back, and say what became of each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from enum import StrEnum
from typing import NamedTuple

from autopilot.params.firmware_file import Wanted
from autopilot.params.protocol import Message, ParameterValue, Target, parameter_value, read_by_name, set_value
from autopilot.params.requests import PATIENCE, Patience, Requests
from autopilot.params.value_coding import Number, encode, same_value

MISMATCHES_TO_BELIEVE = 3
"""A different value must come this often before it is the vehicle's last word: single ones may be late answers."""


ROUNDS_MAX = 3
"""So often is a parameter set again that was read back different: on a lossy link the sets alone may have got
lost while their reads came through."""


class Verdict(StrEnum):
    """What became of a parameter."""

    UNCHANGED = "unchanged"
    SET = "set"
    WOULD_SET = "would set"
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


class Phase(StrEnum):
    """Where an upload stands."""

    READING = "reading"
    COMPARED = "compared"
    SETTING = "setting"
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
        self.was_sent = False
        self.mismatches = 0
        self.is_settled = False

    def holds_wanted(self) -> bool:
        return self.now is not None and same_value(self.now.value, self.wanted.value, self.now.kind)


class Upload:
    """Writes `wanted` to the target. Give `receive` every message and send what `due` returns, until `finished`.

    It is finished a first time when everything is read and compared; `proceed` then sets what differs.
    Names that stay unanswered at first are asked once more after the rest has been set, because an enabling
    parameter can bring its group into being. Only `outcomes` after `finished` are the vehicle's last word;
    before that they say what is known so far.
    """

    def __init__(
        self,
        target: Target,
        wanted: Sequence[Wanted],
        patience: Patience = PATIENCE,
    ) -> None:
        self._target = target
        self._patience = patience
        self._items = [_Item(each) for each in wanted]
        self._by_name = {name: item for item in self._items for name in item.wanted.names}
        self._may_set = False
        self._has_reread_unknown = False
        self._rounds = 0
        self.phase = Phase.READING
        self._requests = self._reads(self._items)

    @property
    def finished(self) -> bool:
        """Whether every parameter is compared, or after `proceed`, has its last verdict."""
        return self.phase in (Phase.COMPARED, Phase.FINISHED)

    @property
    def differs(self) -> bool:
        """Whether there is anything that `proceed` would set."""
        return any(self._must_be_set(item) for item in self._items)

    def proceed(self) -> None:
        """Set what differs, as soon as everything is compared."""
        self._may_set = True
        if self.phase is Phase.COMPARED:
            self._begin_setting()

    @property
    def progress(self) -> tuple[int, int]:
        """Steps done, of three a parameter: read, set, verified."""
        if self.finished:
            return 3 * len(self._items), 3 * len(self._items)
        done = sum((item.old is not None) + item.holds_wanted() + item.is_settled for item in self._items)
        return done, 3 * len(self._items)

    def receive(self, now: float, message: Message) -> None:
        """Take any message; those that are not the target's PARAM_VALUE of a name wanted are ignored."""
        value = parameter_value(message, self._target)
        if value is None or self.finished:
            return
        item = self._by_name.get(value.name)
        if item is None or item.is_settled or (item.old is not None and item.name != value.name):
            return
        item.now = value
        if self.phase is Phase.READING:
            self._take_first(item, value, now)
        elif self._is_believed(item):
            self._requests.answered(value.name, now)
            # a late answer to an earlier question must not overwrite what was read back
            item.is_settled = self.phase is Phase.VERIFYING

    def _take_first(self, item: _Item, value: ParameterValue, now: float) -> None:
        item.name = value.name
        item.old = value
        for name in item.wanted.names:
            self._requests.answered(name, now)

    def _is_believed(self, item: _Item) -> bool:
        if item.holds_wanted():
            return True
        item.mismatches += 1
        return min(item.mismatches, self._requests.tries(item.name)) >= MISMATCHES_TO_BELIEVE

    def due(self, now: float) -> list[Message]:
        """Return the messages to send now."""
        if self.finished:
            return []
        while self._requests.done and not self.finished:
            self._next_phase()
        messages: list[Message] = []
        for name in self._requests.due(now):
            messages += self._questions(name)
        return messages

    def _questions(self, name: str) -> list[Message]:
        """A set is followed by a read from its second try on: some firmware sets without a word."""
        if self.phase is not Phase.SETTING:
            return [read_by_name(self._target, name)]
        item = self._by_name[name]
        assert item.old is not None
        item.was_sent = True
        message = set_value(self._target, name, item.wanted.value, item.old.kind)
        return [message] if self._requests.tries(name) == 1 else [message, read_by_name(self._target, name)]

    def _next_phase(self) -> None:
        if self.phase is Phase.READING:
            self._find_unsettable()
            if self._may_set:
                self._begin_setting()
            else:
                self.phase = Phase.COMPARED
        elif self.phase is Phase.SETTING and not self._has_reread_unknown and self._unknown():
            self._has_reread_unknown = True
            self.phase = Phase.READING
            self._requests = self._reads(self._unknown())
        elif self.phase is Phase.SETTING:
            self._begin_verifying()
        elif self._rounds < ROUNDS_MAX and self._begin_another_round():
            return
        else:
            self.phase = Phase.FINISHED

    def _begin_another_round(self) -> bool:
        doubtful = [item for item in self._items if item.was_sent and item.is_settled and not item.holds_wanted()]
        for item in doubtful:
            item.is_settled = False
            item.mismatches = 0
        if doubtful:
            self.phase = Phase.SETTING
            self._requests = Requests([item.name for item in doubtful], self._patience)
        return bool(doubtful)

    def _begin_setting(self) -> None:
        names = [item.name for item in self._items if self._must_be_set(item)]
        self.phase = Phase.SETTING
        self._has_reread_unknown = self._has_reread_unknown or not names
        self._requests = Requests(names, self._patience)

    def _find_unsettable(self) -> None:
        for item in self._items:
            if item.old is None:
                continue
            try:
                encode(item.wanted.value, item.old.kind, self._target.bytewise)
            except ValueError as error:
                item.reason = str(error)

    def _must_be_set(self, item: _Item) -> bool:
        return not (item.old is None or item.reason or item.was_sent or item.holds_wanted())

    def _begin_verifying(self) -> None:
        self.phase = Phase.VERIFYING
        self._rounds += 1
        sent = [item for item in self._items if item.was_sent]
        for item in sent:
            item.mismatches = 0
        known = [item for item in self._items if item.old is not None and not item.reason and not item.is_settled]
        self._requests = Requests([item.name for item in known], self._patience) if sent else Requests([], PATIENCE)

    def _unknown(self) -> list[_Item]:
        return [item for item in self._items if item.old is None]

    def _reads(self, items: Iterable[_Item]) -> Requests[str]:
        return Requests([name for item in items for name in item.wanted.names], self._patience)

    def outcomes(self) -> list[Outcome]:
        """Return what is known of each parameter, in the order of the file."""
        unanswered = set(self._requests.given_up) if self.phase in (Phase.VERIFYING, Phase.FINISHED) else set()
        return [self._outcome(item, item.name in unanswered) for item in self._items]

    def _outcome(self, item: _Item, is_unanswered: bool) -> Outcome:
        old = item.old.value if item.old else None
        now = item.now.value if item.now else None
        verdict, reason = self._verdict(item, is_unanswered)
        return Outcome(item.name, old, item.wanted.value, now, verdict, reason, item.wanted.reboot)

    def _verdict(self, item: _Item, is_unanswered: bool) -> tuple[Verdict, str]:
        if item.old is None or item.now is None:
            return (
                Verdict.UNKNOWN,
                "the vehicle never answered for this name" if self.finished else "not yet answered for",
            )
        if item.reason:
            return Verdict.REJECTED, item.reason
        if not item.was_sent and item.holds_wanted():
            return Verdict.UNCHANGED, ""
        if not item.was_sent:
            return Verdict.WOULD_SET, ""
        if is_unanswered or self.phase is not Phase.FINISHED:
            return Verdict.UNCONFIRMED, "sent, but not read back"
        if item.holds_wanted():
            return Verdict.SET, ""
        if item.now.value == item.old.value:
            return Verdict.REJECTED, "the vehicle keeps its old value"
        return Verdict.CONSTRAINED, "the vehicle holds another value than was sent"
