"""Download and upload against a vehicle behind a link that loses, repeats and reorders, on a manual clock."""

from __future__ import annotations

import math
import random
import struct
from typing import Any

import pytest
from parameter_vehicle import BadLink, ParameterVehicle, converse
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.firmware.download import Download, NamedDownload, table_hash
from autopilot.firmware.file import Wanted
from autopilot.firmware.protocol import Patience, Requests, Target, encode, same_value
from autopilot.firmware.upload import Outcome, Upload, Verdict

INT8, INT16, INT32, REAL32 = 2, 4, 6, 9
RANGES = {INT8: 127, INT16: 32767}


def table_of(count: int, bytewise: bool) -> dict[str, tuple[float, int]]:
    """A table of every type; integers beyond 2^24 only where they travel bytewise."""
    rng = random.Random(count)
    table: dict[str, tuple[float, int]] = {}
    for number in range(count):
        kind = rng.choice([INT8, INT16, INT32, REAL32])
        largest = RANGES.get(kind, 2**31 - 1 if bytewise else 2**24 - 1)
        value: float = rng.randint(-largest, largest - 1)
        if kind == REAL32:
            value = struct.unpack("<f", struct.pack("<f", rng.uniform(-1e4, 1e4)))[0]
        table[f"P{number:04d}"] = (value, kind)
    return table


def links(loss: float) -> tuple[BadLink, BadLink]:
    """Both directions: packets come late by up to 0.1 s, so out of order, and every tenth twice."""
    return BadLink(1, loss, 0.1, (0.005, 0.1)), BadLink(2, loss, 0.1, (0.005, 0.1))


def upload(vehicle: ParameterVehicle, wanted: list[Wanted], loss: float = 0.0) -> dict[str, Outcome]:
    client = Upload(Target(1, 1, vehicle.bytewise), wanted)
    lines = links(loss)
    while not client.is_over:
        converse(client, vehicle, *lines, limit_s=400.0)
        client.proceed()
    return {outcome.name: outcome for outcome in client.outcomes()}


@pytest.mark.parametrize("bytewise", [False, True])
@pytest.mark.parametrize("loss", [0.0, 0.05, 0.3])
def test_a_download_is_complete_and_bit_exact(bytewise: bool, loss: float) -> None:
    vehicle = ParameterVehicle(table_of(1000, bytewise), bytewise)
    client = Download(Target(1, 1, bytewise))
    converse(client, vehicle, *links(loss), limit_s=60.0)
    assert {name: value.value for name, value in client.values.items()} == {
        name: entry[0] for name, entry in vehicle.table.items()
    }
    assert client.missing == []


@pytest.mark.parametrize("bytewise", [False, True])
@pytest.mark.parametrize("loss", [0.0, 0.05, 0.3])
def test_an_upload_is_complete_and_bit_exact(bytewise: bool, loss: float) -> None:
    vehicle = ParameterVehicle(table_of(1000, bytewise), bytewise)
    wanted = [Wanted((name,), value + 1) for name, (value, _) in vehicle.table.items()]
    outcomes = upload(vehicle, wanted, loss)
    assert {outcome.verdict for outcome in outcomes.values()} == {Verdict.SET}
    for each in wanted:
        held, kind = vehicle.table[each.name]
        assert same_value(held, each.value, kind)


class SharedVehicle(ParameterVehicle):
    """Another ground station writes to it without a pause: the answers go to everybody."""

    def transmit(self, at_most: int) -> list[bytes]:
        self.table["OTHER"][0] += 1.0
        self.waiting += [("OTHER", 65535), ("P0", 65535)]
        return super().transmit(at_most)


def test_another_station_that_writes_all_the_time_does_not_hold_an_upload_up() -> None:
    vehicle = SharedVehicle({f"P{number}": (0.0, REAL32) for number in range(99)} | {"OTHER": (0.0, REAL32)})
    wanted = [Wanted((f"P{number}",), 1.0) for number in range(99)] + [Wanted(("OTHER",), 0.5)]
    outcomes = upload(vehicle, wanted, loss=0.1)
    assert outcomes.pop("OTHER").verdict is Verdict.CONSTRAINED
    assert {each.verdict for each in outcomes.values()} == {Verdict.SET}


class EchoingVehicle(ParameterVehicle):
    """Answers a set with the value asked for, whatever it does with it; P_0 has its old value again `later` turns on.

    The group P_ is silent when its switch is off.
    """

    def __init__(self, later: int) -> None:
        super().__init__({f"P_{number}": (float(number), REAL32) for number in range(9)} | {"SIXTEEN_CHARS_16": (0, 2)})
        self.table["P_ENABLE"] = [1, 2]
        self.later = later
        self.back = -1

    def set(self, message: Any) -> None:
        value, name = message.param_value, message.param_id
        echo = dialect.MAVLink_param_value_message(name.encode(), value, message.param_type, len(self.table), 65535)
        self.replies.append(bytes(echo.pack(self.mavlink)))
        if name != "P_0" or self.later:
            self.table[name][0] = value
        self.back = self.later if name == "P_0" else self.back

    def transmit(self, at_most: int) -> list[bytes]:
        self.back -= 1
        if self.back == 0:
            self.table["P_0"][0] = 0.0
        if not self.table["P_ENABLE"][0]:
            self.waiting = [each for each in self.waiting if each[0] == "P_ENABLE" or not each[0].startswith("P_")]
        return super().transmit(at_most)


@pytest.mark.parametrize("later", [0, 25])
@pytest.mark.parametrize("goes_off", [False, True])
@pytest.mark.parametrize("seed", range(2))
def test_an_echo_of_a_set_is_not_taken_for_what_the_vehicle_holds(later: int, goes_off: bool, seed: int) -> None:
    vehicle = EchoingVehicle(later)
    wanted = [Wanted((name,), value + 1.0) for name, (value, _) in vehicle.table.items() if name != "P_ENABLE"]
    client = Upload(Target(1, 1), [*wanted, *([Wanted(("P_ENABLE",), 0)] if goes_off else [])])
    lines = BadLink(2 * seed, 0.1, 0.3, (0.005, 0.5)), BadLink(2 * seed + 1, 0.1, 0.3, (0.005, 0.5))
    while not client.is_over:
        converse(client, vehicle, *lines, limit_s=400.0)
        client.proceed()
    first, *others = client.outcomes()
    assert (first.verdict, first.now, vehicle.table["P_0"][0]) == (Verdict.REJECTED, 0.0, 0.0)
    assert {each.verdict for each in others} == {Verdict.SET}
    assert {each.reason for each in others[:-2]} == {"its group is switched off" if goes_off else ""}


@pytest.mark.parametrize(
    ("value", "kind", "reason"),
    [
        (math.inf, INT32, "the vehicle holds it as INT32, a whole number is needed"),
        (math.nan, INT32, "the vehicle holds it as INT32, a whole number is needed"),
        (1e39, INT32, "the vehicle holds it as INT32, allowed are -2147483648 to 2147483647"),
        (-1e39, REAL32, r"the vehicle holds it as REAL32, which goes to 3\.4e\+38"),
    ],
)
def test_a_number_that_no_type_holds_is_refused_with_the_reason(value: float, kind: int, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        encode(value, kind, bytewise=False)


def test_px4s_checksum_of_the_table_is_checked() -> None:
    vehicle = ParameterVehicle(table_of(50, True), bytewise=True)
    vehicle.hash = True
    client = Download(Target(1, 1, True))
    converse(client, vehicle, *links(0.0), limit_s=20.0)
    assert client.hash_agrees is True
    name = next(iter(client.values))
    other = client.values[name]._replace(value=client.values[name].value + 1)
    assert table_hash(client.values.values()) != table_hash({**client.values, name: other}.values())
    misfit = other._replace(name="\N{REPLACEMENT CHARACTER}")
    assert table_hash([misfit]) != table_hash([other]), "a name that is none ends nothing"
    assert "_HASH_CHECK" not in client.values
    plain = Download(Target(1, 1))
    converse(plain, ParameterVehicle(table_of(5, False)), *links(0.0), limit_s=20.0)
    assert plain.hash_agrees is None


def test_a_refusal_says_why() -> None:
    vehicle = ParameterVehicle({"A": (1.0, REAL32)})
    vehicle.read_only.add("A")
    vehicle.says_errors = True
    outcome = upload(vehicle, [Wanted(("A",), 2.0, allowed="; documented are 0 to 1")])["A"]
    assert outcome.verdict is Verdict.REJECTED
    assert outcome.reason == "the vehicle keeps its old value; documented are 0 to 1; the vehicle says: read only"


def test_a_vehicle_that_says_that_it_has_no_such_name_is_believed_at_once() -> None:
    vehicle = ParameterVehicle({"A": (1.0, REAL32)})
    vehicle.says_errors = True
    client = NamedDownload(Target(1, 1), ["NOPE"])
    assert converse(client, vehicle, BadLink(1, 0.0), BadLink(2, 0.0), limit_s=1.0) < 0.2
    assert client.unknown == ["NOPE"]


def test_a_list_that_stops_half_way_is_completed_by_index() -> None:
    vehicle = ParameterVehicle(table_of(100, False))
    vehicle.list_stops_after = 17
    client = Download(Target(1, 1))
    converse(client, vehicle, *links(0.0), limit_s=20.0)
    assert len(client.values) == 100


class WrongPlaces(ParameterVehicle):
    """Gives a share of its answers the place of another parameter."""

    share, rng = 0.2, random.Random(20261129)

    def packet(self, name: str, index: int) -> bytes:
        return super().packet(name, (index + 7) % len(self.table) if self.rng.random() < self.share else index)


def test_answers_at_the_place_of_another_lose_no_parameter() -> None:
    vehicle = WrongPlaces(table_of(500, False))
    client = Download(Target(1, 1))
    converse(client, vehicle, *links(0.0), limit_s=90.0)
    assert {name: value.value for name, value in client.values.items()} == {
        name: entry[0] for name, entry in vehicle.table.items()
    }


class OneTwice(ParameterVehicle):
    """Says the same of two places."""

    def packet(self, name: str, index: int) -> bytes:
        return super().packet("P0004" if index == 3 else name, index)


def test_places_that_stay_doubled_are_missing_in_the_end() -> None:
    vehicle = OneTwice(table_of(50, False))
    client = Download(Target(1, 1))
    converse(client, vehicle, *links(0.0), limit_s=90.0)
    assert client.missing == [3, 4]


def test_a_table_that_grows_while_it_is_read_is_read_again() -> None:
    vehicle = ParameterVehicle(table_of(100, False))
    client = Download(Target(1, 1))
    up, down = links(0.0)
    with pytest.raises(AssertionError, match="not finished"):
        converse(client, vehicle, up, down, limit_s=0.1, rate=5)
    vehicle.table["NEW"] = [1.0, REAL32]
    converse(client, vehicle, up, down, limit_s=20.0)
    assert len(client.values) == 101
    assert client.values["NEW"].value == 1.0


def test_a_vehicle_that_says_nothing_ends_the_download_empty() -> None:
    client = Download(Target(1, 1))
    converse(client, ParameterVehicle({}), *links(1.0), limit_s=20.0)
    assert client.progress == (0, 0)


def test_another_vehicle_on_the_link_is_not_taken_for_ours() -> None:
    other = ParameterVehicle({"A": (1.0, REAL32)})
    client = Download(Target(7, 1))
    converse(client, other, *links(0.0), limit_s=20.0)
    assert client.values == {}


def test_named_parameters_and_those_that_do_not_exist() -> None:
    client = NamedDownload(Target(1, 1), ["P0003", "NOPE"])
    converse(client, ParameterVehicle(table_of(10, False)), *links(0.05), limit_s=20.0)
    assert list(client.values) == ["P0003"]
    assert client.unknown == ["NOPE"]


def test_each_way_an_upload_can_fail_has_its_verdict() -> None:
    vehicle = ParameterVehicle(
        {
            "SAME": (5, INT16),
            "PLAIN": (1, INT16),
            "LIMITED": (1.0, REAL32),
            "FIXED": (3.0, REAL32),
            "SMALL": (1, INT8),
            "WHOLE": (1, INT8),
            "NEWNAME": (1, INT16),
            "QUIET": (1.0, REAL32),
        }
    )
    vehicle.limits["LIMITED"] = (0.0, 2.0)
    vehicle.read_only.add("FIXED")
    vehicle.silent_sets.add("QUIET")
    wanted = [
        Wanted(("SAME",), 5),
        Wanted(("PLAIN",), 2),
        Wanted(("LIMITED",), 9.0),
        Wanted(("FIXED",), 4.0),
        Wanted(("SMALL",), 300),
        Wanted(("WHOLE",), 1.5),
        Wanted(("OLDNAME", "NEWNAME"), 7),
        Wanted(("QUIET",), 0.1),
        Wanted(("MISSING",), 1),
    ]
    outcomes = upload(vehicle, wanted, loss=0.05)
    assert {name: outcome.verdict for name, outcome in outcomes.items()} == {
        "SAME": Verdict.UNCHANGED,
        "PLAIN": Verdict.SET,
        "LIMITED": Verdict.CONSTRAINED,
        "FIXED": Verdict.REJECTED,
        "SMALL": Verdict.REJECTED,
        "WHOLE": Verdict.REJECTED,
        "NEWNAME": Verdict.SET,
        "QUIET": Verdict.SET,
        "MISSING": Verdict.UNKNOWN,
    }
    assert outcomes["LIMITED"].now == 2.0
    assert outcomes["SMALL"].reason == "the vehicle holds it as INT8, allowed are -128 to 127"
    assert outcomes["WHOLE"].reason == "the vehicle holds it as INT8, a whole number is needed"
    assert (vehicle.table["SMALL"][0], vehicle.table["WHOLE"][0]) == (1, 1)


def test_parameters_that_an_enabling_one_brings_into_being_are_set_too() -> None:
    vehicle = ParameterVehicle({"GRP_ENABLE": (0, INT8)})
    vehicle.enables["GRP_ENABLE"] = {"GRP_GAIN": (1.0, REAL32)}
    outcomes = upload(vehicle, [Wanted(("GRP_GAIN",), 2.5), Wanted(("GRP_ENABLE",), 1)])
    assert outcomes["GRP_GAIN"].verdict is Verdict.SET
    assert vehicle.table["GRP_GAIN"][0] == 2.5


def test_nothing_is_set_before_proceed() -> None:
    vehicle = ParameterVehicle({"A": (1, INT16), "B": (1.0, REAL32)})
    client = Upload(Target(1, 1), [Wanted(("A",), 2), Wanted(("B",), 1.0)])
    converse(client, vehicle, *links(0.0), limit_s=20.0)
    assert client.finished
    assert client.differs
    assert vehicle.sets_received == 0
    assert [outcome.verdict for outcome in client.outcomes()] == [Verdict.WOULD_SET, Verdict.UNCHANGED]
    client.proceed()
    assert not client.finished


def test_a_vehicle_that_falls_silent_after_the_sets_leaves_them_unconfirmed() -> None:
    vehicle = ParameterVehicle({"A": (1, INT16)})
    client = Upload(Target(1, 1), [Wanted(("A",), 2)])
    converse(client, vehicle, *links(0.0), limit_s=20.0)
    client.proceed()
    converse(client, vehicle, *links(1.0), limit_s=60.0)
    assert client.outcomes()[0].verdict is Verdict.UNCONFIRMED


def test_requests_keep_to_their_window_and_their_tries() -> None:
    requests = Requests(["a", "b", "c"], Patience(interval_s=1.0, tries=2, window=2))
    assert requests.due(0.0) == ["a", "b"]
    assert requests.due(0.5) == []
    requests.answered("a", 0.5)
    assert requests.due(0.5) == ["c"]
    assert requests.due(1.0) == ["b"]
    assert requests.due(2.1) == ["c"]
    assert (requests.given_up, requests.done) == (["b"], False)
    requests.answered("c", 2.2)
    assert requests.done


def test_integers_travel_as_numbers_or_as_bytes() -> None:
    assert encode(-1, INT32, bytewise=False) == struct.pack("<f", -1.0)
    assert encode(-1, INT32, bytewise=True) == b"\xff\xff\xff\xff"
    assert encode(-5_000_000, INT32, bytewise=True) == struct.pack("<i", -5_000_000)
    assert encode(200, 1, bytewise=True) == b"\xc8\0\0\0"
    assert same_value(struct.unpack("<f", struct.pack("<f", 0.1))[0], 0.1, REAL32)
    assert not same_value(16_777_216, 16_777_217, INT32)
