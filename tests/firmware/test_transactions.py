"""Whatever the vehicle, the link and the moment: an upload ends wholly done, and the way back wholly undone."""

from __future__ import annotations

from typing import Any, cast

import pytest
from hypothesis import HealthCheck, event, given, settings
from hypothesis import strategies as st
from parameter_vehicle import BadLink, ParameterVehicle, converse

from autopilot.firmware.file import Wanted
from autopilot.firmware.journal import Holds, Journal, carry_out, held_side, held_values, holds_side, put
from autopilot.firmware.protocol import ParameterValue
from autopilot.firmware.session import ParameterSession, Vehicle
from autopilot.firmware.upload import SETTLE_S, Change, Upload
from autopilot.links.mavlink.codec import MavlinkCodec

INT8, REAL32 = 2, 9
Table = dict[str, tuple[float, int]]


class PowerLostError(Exception):
    """The ground computer loses its power."""


class BenchSession:
    """Stands in for a session: a manual clock, and power until so many packets have been sent."""

    def __init__(
        self, vehicle: ParameterVehicle, loss: float, packets: int | None = None, seed: int = 1, latest_s: float = 0.05
    ) -> None:
        self.vehicle = Vehicle(1, 1, 3, 11, False)
        self._device = vehicle
        self._up, self._down = (BadLink(seed + side, loss, 0.1, (0.005, latest_s)) for side in (0, 1))
        self.now = 0.0
        self._left = packets
        plain = self._up.send

        def send(now: float, packet: bytes) -> None:
            self.now = now
            if self._left is not None:
                self._left -= 1
                if self._left < 0:
                    raise PowerLostError
            plain(now, packet)

        self._up.send = send  # type: ignore[method-assign]

    def deliver(self) -> None:
        """Let what is under way arrive; nobody hears the answers."""
        codec = MavlinkCodec(1, 1)
        for packet in self._up.arrived(1.0e9):
            for message in codec.decode(packet):
                self._device.handle(message)
        self._device.waiting.clear()

    def cut_after(self, packets: int | None) -> None:
        """Lose the power after so many packets more, None: never."""
        self._left = packets

    def run(self, client: Any, show: Any) -> None:
        self.now += converse(client, self._device, self._up, self._down, limit_s=600.0, begin=self.now)


def session(vehicle: ParameterVehicle, loss: float, packets: int | None = None) -> ParameterSession:
    return cast(ParameterSession, BenchSession(vehicle, loss, packets))


def quiet(done: int, total: int) -> None:
    return


class GroupedVehicle(ParameterVehicle):
    """Parameters of the group GRP_ are there only while GRP_ENABLE is on; their values last."""

    def __init__(self, table: Table) -> None:
        super().__init__(table)
        self.hidden: Table = {}
        self.says_errors = True
        self.hide()

    def hide(self) -> None:
        on = bool(self.table.get("GRP_ENABLE", [1])[0])
        if on:
            self.table.update({name: list(entry) for name, entry in self.hidden.items()})
            self.hidden = {}
        else:
            names = [name for name in self.table if name.startswith("GRP_") and name != "GRP_ENABLE"]
            self.hidden |= {name: tuple(self.table.pop(name)) for name in names}  # type: ignore[misc]

    def set(self, message: Any) -> None:
        super().set(message)
        self.hide()

    def everything(self) -> Table:
        return {name: (value, kind) for name, (value, kind) in (self.table | self.hidden).items()}


NAMES = ("A", "B", "C", "GRP_ENABLE", "GRP_GAIN", "GRP_LAG")


def tables(*values: float) -> st.SearchStrategy[Table]:
    """Every parameter with one of the values, the group on or off."""
    return st.builds(
        lambda drawn, on: {
            name: (float(on), INT8) if name == "GRP_ENABLE" else (value, REAL32)
            for name, value in zip(NAMES, drawn, strict=True)
        },
        st.tuples(*[st.sampled_from(values)] * len(NAMES)),
        st.booleans(),
    )


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    old=tables(0.0, 1.0, 2.5),
    new=tables(2.5, 7.0, -3.25),
    order=st.permutations(NAMES),
    loss=st.sampled_from([0.0, 0.3]),
    packets=st.sampled_from(range(26)),
)
def test_a_cut_upload_is_made_whole_by_its_journal(
    old: Table, new: Table, order: list[str], loss: float, packets: int
) -> None:
    vehicle = GroupedVehicle(old)
    if not old["GRP_ENABLE"][0] and not new["GRP_ENABLE"][0]:
        order = [name for name in order if not name.startswith("GRP_")]  # the group is never there
    wanted = [Wanted((name,), new[name][0]) for name in order]
    goal = old | {name: new[name] for name in order}
    kept: list[list[Change]] = []
    upload = Upload(session(vehicle, loss).vehicle.target, wanted)
    cut = BenchSession(vehicle, loss, packets)
    try:
        cut.run(upload, quiet)
        carry_out(cast(ParameterSession, cut), upload, kept.append, quiet)
    except PowerLostError:
        cut.deliver()
    else:
        assert all(each.is_good for each in upload.outcomes()), upload.outcomes()
        assert vehicle.everything() == goal
    if not kept:
        assert vehicle.everything() == old
        return
    journal = Journal("f", "d", 1, "ardurover", "", "", tuple(kept[-1]))
    holds = held_side(journal.changes, held_values(session(vehicle, loss), journal, quiet))
    event(holds)
    before = vehicle.everything()
    if holds is not Holds.MIXED:
        # what was not yet read when the power went has not been set either: it belongs to both sides
        names = [change.name for change in journal.changes]
        side = old if holds is Holds.OLD else goal
        assert {name: before[name] for name in names} == {name: side[name] for name in names}
    outcomes = put(session(vehicle, loss), journal, Holds.OLD, quiet)
    assert all(each.is_good for each in outcomes), outcomes
    assert vehicle.everything() == old


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    old=tables(0.0, 1.0, 2.5),
    new=tables(2.5, 7.0, -3.25),
    present=tables(0.0, 7.0, 4.0),
    side=st.sampled_from([Holds.OLD, Holds.NEW]),
    loss=st.sampled_from([0.0, 0.3]),
    packets=st.sampled_from(range(40)),
)
def test_power_lost_on_the_way_to_a_side_leaves_a_journal_that_still_leads_there(
    old: Table, new: Table, present: Table, side: Holds, loss: float, packets: int
) -> None:
    on = {"GRP_ENABLE": (1.0, INT8)}
    old, new = old | on, new | on
    vehicle = GroupedVehicle(present | on)
    changes = tuple(Change(name, old[name][1], old[name][0], new[name][0]) for name in NAMES)
    journal = Journal("f", "d", 1, "ardurover", "", "", changes)
    cut = BenchSession(vehicle, loss, packets)
    try:
        put(cast(ParameterSession, cut), journal, side, quiet)
    except PowerLostError:
        cut.deliver()
    assert all(each.is_good for each in put(session(vehicle, loss), journal, side, quiet))
    assert vehicle.everything() == (old if side is Holds.OLD else new)
    assert held_side(journal.changes, held_values(session(vehicle, loss), journal, quiet)) in (side, Holds.NEW)


def held(**values: float) -> dict[str, ParameterValue]:
    return {name: ParameterValue(name, value, REAL32) for name, value in values.items()}


@pytest.mark.parametrize(
    ("values", "old", "new"),
    [
        (held(A=1.0, G_ENABLE=0.0), True, False),
        (held(A=2.0, G_ENABLE=1.0, G_X=2.0), False, True),
        (held(A=1.0, G_ENABLE=1.0, G_X=1.0), False, False),
        (held(A=1.0), False, False),
        (held(A=2.0, G_ENABLE=1.0), False, False),
        ({}, False, False),
    ],
)
def test_which_side_a_vehicle_is_on(values: dict[str, ParameterValue], old: bool, new: bool) -> None:
    changes = (Change("A", REAL32, 1.0, 2.0), Change("G_ENABLE", INT8, 0, 1), Change("G_X", REAL32, 1.0, 2.0))
    assert holds_side(changes, values, Holds.OLD) is old
    assert holds_side(changes, values, Holds.NEW) is new


@pytest.mark.parametrize("seed", range(12))
def test_a_set_that_is_still_under_way_does_not_outlive_the_way_back(seed: int) -> None:
    old = {f"P{number}": (float(number), REAL32) for number in range(9)}
    vehicle = ParameterVehicle(old)
    bench = BenchSession(vehicle, 0.0, None, 100 * seed, 0.5)
    upload = Upload(bench.vehicle.target, [Wanted((name,), value + 1.0) for name, (value, _) in old.items()])
    kept: list[list[Change]] = []
    with pytest.raises(PowerLostError):
        bench.run(upload, None)
        bench.cut_after(1 + seed % 8)
        carry_out(cast(ParameterSession, bench), upload, kept.append, quiet)
    bench.cut_after(None)
    journal = Journal("file", "", 1, "", "", "", tuple(kept[-1]))
    outcomes = put(cast(ParameterSession, bench), journal, Holds.OLD, quiet)
    assert len(outcomes) == 9 and all(each.is_good for each in outcomes)
    bench.deliver()
    assert {name: tuple(entry) for name, entry in vehicle.table.items()} == old


def test_a_way_back_from_values_just_read_does_not_wait_for_them_to_settle_again() -> None:
    def seconds(settles: bool) -> float:
        vehicle = ParameterVehicle({"A": (1.0, REAL32)})
        bench = BenchSession(vehicle, 0.0)
        journal = Journal("file", "", 1, "", "", "", (Change("A", REAL32, 0.0, 1.0),))
        held_values(cast(ParameterSession, bench), journal, quiet)
        begin = bench.now
        assert all(
            each.is_good for each in put(cast(ParameterSession, bench), journal, Holds.OLD, quiet, settles=settles)
        )
        return bench.now - begin

    assert seconds(settles=True) - seconds(settles=False) == pytest.approx(SETTLE_S, abs=0.2)
