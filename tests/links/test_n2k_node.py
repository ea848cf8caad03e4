"""Norrbin as a node of NMEA 2000: its address, fought for on python-can's virtual bus, and what it answers to whom."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from station_doubles import Skipper

from autopilot.links.n2k import node as nodes
from autopilot.links.n2k.link import BusLine, N2kLink, open_bus
from autopilot.links.n2k.node import NAME, Device, Node
from autopilot.links.n2k.packets import FAST, Frame, Framing, Message, identifier
from autopilot.links.n2k.session import READ, N2kSession, N2kSettings
from autopilot.signals import (
    HelmSample,
    Mode,
    NavState,
    Order,
    OrderKind,
    Reference,
    RudderCommand,
    Tick,
)

can = pytest.importorskip("can", reason="python-can is not installed (extra n2k)")


def claim(name: int, source: int) -> Message:
    return Message(60928, struct.pack("<Q", name), source)


def started(unique: int = 1) -> Node:
    made = Node(Device(unique, "1.0"), (127250,), lambda _: None, lambda *_: (0, []))
    (question,) = made.due(-0.25)
    assert (question.group, question.data, question.source) == (59904, b"\x00\xee\x00", 254)
    assert made.due(-0.01) == []
    assert made.due(0.0) == [claim(NAME | unique, 204)]
    return made


def ready(session: N2kSession) -> N2kSession:
    """Return a session that has its address since 0 s."""
    for now in (-0.6, -0.3):
        session.poll(now)
    session.due(0.0)
    return session


def test_the_name_says_what_we_are() -> None:
    """ISO 11783-5: unique number 21 bits, maker 11, instances 8, function 8, reserved 1, class 7, 4, industry 3, 1."""
    fields, name = [], NAME | 0x12345
    for width in (21, 11, 8, 8, 1, 7, 4, 3, 1):
        fields.append(name & ((1 << width) - 1))
        name >>= width
    assert fields == [0x12345, 2046, 0, 150, 0, 40, 0, 4, 1]
    assert name == 0
    assert identifier(60928, 204, 6) == 0x18EEFFCC


def test_nothing_but_the_claim_is_said_while_others_may_object() -> None:
    made = started()
    asked = Message(59904, (126996).to_bytes(3, "little"), 35, 204)
    assert (made.is_ready(0.2), made.due(0.2), made.take(0.2, asked)) == (False, [], [])
    assert made.is_ready(0.25)
    assert [each.group for each in made.due(0.25)] == [126993]
    assert [each.group for each in made.take(0.3, asked)] == [126996]


def test_whose_address_is_claimed_again_and_again_says_that_no_order_leaves() -> None:
    """A device with a lower NAME follows us from address to address, and we may say nothing for 0.25 s each time."""
    session = ready(N2kSession("bus"))
    node = session.node
    assert node is not None
    said: list[HelmSample] = []
    ordered: list[float] = []
    for step in range(1, 1200):
        now = 0.05 * step
        chased = step % 4 == 0 and 2.0 < now < 50.0
        samples = session.receive(now, [claim(node.name - 1, node.address)] if chased else [])
        said += [each for each in samples if isinstance(each, HelmSample)]
        session.send(now, RudderCommand(now, 0.1, True))
        session.poll(now)
        ordered += [now for each in session.due(now) if each.group == 127245]
    assert [each.available for each in said] == [True, *[False] * (len(said) - 2), True]
    lost, back = said[1], said[-1]
    assert 2.0 < lost.time < 3.5 and "claims our address" in lost.reason
    assert back.time > 50.0 and ordered[-1] > back.time, "it is not at the helm again before orders leave"
    assert not [each for each in ordered if lost.time < each < back.time - 0.1]


@pytest.mark.parametrize(("period", "loop"), [(0.26, 0.05), (0.3, 0.05), (0.3, 0.1), (0.26, 0.02)])
def test_the_helm_is_there_only_while_orders_leave_between_the_claims_of_others(period: float, loop: float) -> None:
    """We may speak for one turn of the loop in several: an order that was due while we might not waited for its next
    time, and none left for 25 s beside a helm that was said to be there."""
    session = ready(N2kSession("bus"))
    node = session.node
    assert node is not None
    now, chased, left, is_there, longest = 1.0, 2.0, 1.0, False, 0.0
    while now < 60.0:
        now += loop
        is_chased = now >= chased
        chased = now + period if is_chased else chased
        samples = session.receive(now, [claim(node.name - 1, node.address)] if is_chased else [])
        is_there = next((each.available for each in samples if isinstance(each, HelmSample)), is_there)
        session.send(now, RudderCommand(now, 0.1, True))
        session.poll(now)
        left = now if [each for each in session.due(now) if each.group == 127245] else left
        longest = max(longest, now - left if is_there else 0.0)
    assert 0.2 < longest < 1.2


def test_whom_a_tool_moves_from_address_to_address_says_so() -> None:
    session = ready(N2kSession("bus"))
    node = session.node
    assert node is not None
    said: list[HelmSample] = []
    for step in range(1, 80):
        moved = Message(65240, struct.pack("<QB", node.name, 100 + step // 4 % 2), 35)
        samples = session.receive(0.05 * step, [moved] if step > 20 and step % 4 == 0 else [])
        said += [each for each in samples if isinstance(each, HelmSample)]
    assert [each.available for each in said] == [True, False]
    assert "claims our address, or moves us," in said[1].reason


def test_one_claim_behind_a_loop_that_stood_still_is_no_contest() -> None:
    session = ready(N2kSession("bus"))
    node = session.node
    assert node is not None
    said = [each for now in (1.0, 1.1) for each in session.receive(now, [])]
    said += session.receive(9.0, [claim(node.name - 1, node.address)])
    said += [each for now in (9.1, 9.2, 9.3) for each in session.receive(now, [])]
    assert [each.available for each in said if isinstance(each, HelmSample)] == [True]


def test_an_address_that_is_heard_to_be_taken_is_not_wanted() -> None:
    made = Node(Device(1, "1.0"), (127250,), lambda _: None, lambda *_: (0, []))
    made.due(0.0)
    assert made.take(0.1, claim(made.name + 5, 204)) == [] and made.take(0.1, claim(made.name - 5, 128)) == []
    assert made.due(0.25) == [claim(made.name, 129)]


def test_an_address_is_kept_from_higher_names_and_left_to_lower_ones() -> None:
    made = started()
    ours = claim(made.name, 204)
    assert made.take(1.0, claim(made.name + 1, 204)) == [ours]
    assert made.is_ready(1.0), "who keeps an address need not be silent"
    assert made.take(1.0, claim(made.name, 204)) == [], "our own, come back from a gateway"
    assert made.take(1.0, claim(made.name - 1, 130)) == [], "another's address"
    assert made.take(1.0, Message(60928, bytes(7), 204)) == []
    assert made.take(1.0, claim(made.name - 1, 128)) == []
    assert made.take(1.0, claim(made.name - 1, 204)) == [claim(made.name, 129)], "128 and 130 are known to be taken"
    assert (made.address, made.is_ready(1.2), made.is_ready(1.25)) == (129, False, True)


def commanded(name: int, address: int) -> Message:
    return Message(65240, struct.pack("<QB", name, address), 3)


def test_a_commanded_address_is_claimed_and_contested_like_any_other() -> None:
    made = started()
    assert made.take(1.0, commanded(made.name, 130)) == [claim(made.name, 130)]
    assert (made.address, made.is_ready(1.2), made.is_ready(1.25)) == (130, False, True)
    for other in (commanded(made.name + 1, 140), commanded(made.name, 252), commanded(made.name, 254)):
        assert made.take(2.0, other) == []
    assert made.take(2.0, Message(65240, bytes(8), 3)) == [] and made.address == 130
    assert made.take(2.0, commanded(made.name, 130)) == [], "it is there"
    assert made.take(3.0, claim(made.name - 1, 130)) == [claim(made.name, 204)], "whose name is lower keeps it"


def broadcast(data: bytes, group: int = 65240, source: int = 3) -> list[Frame]:
    """The announcement of a broadcast, and its frames."""
    count = -(-len(data) // 7)
    head = bytes((32, *len(data).to_bytes(2, "little"), count, 255)) + group.to_bytes(3, "little")
    pieces = [bytes((at + 1,)) + data[7 * at : 7 * at + 7].ljust(7, b"\xff") for at in range(count)]
    return [Frame(identifier(60416, source, 7), head), *(Frame(identifier(60160, source, 7), each) for each in pieces)]


def test_a_broadcast_is_put_together_whole_and_in_order_alone() -> None:
    data = struct.pack("<QB", NAME | 1, 130)
    frames = broadcast(data)
    framing = Framing(FAST, READ)
    assert [framing.take(0.1 * place, frame) for place, frame in enumerate(frames)] == [
        None,
        None,
        Message(65240, data, 3, 255, 7),
    ]
    for wrong in (
        [frames[0], frames[2], frames[1]],
        frames[1:],
        [frames[0], frames[1], frames[1]],
        broadcast(data, 65241),
        broadcast(data[:8]),
        [frames[0], broadcast(data, source=4)[1], frames[2]],
    ):
        framing = Framing(FAST, READ)
        assert not any(framing.take(0.1 * place, frame) for place, frame in enumerate(wrong))
    framing = Framing(FAST, READ)
    assert not any(framing.take(0.8 * place, frame) for place, frame in enumerate(frames)), "too late"


def test_with_every_address_taken_we_say_so_and_fall_silent() -> None:
    made = started()
    taken = []
    while made.address != 254:
        taken.append(made.address)
        ((last),) = made.take(1.0, claim(0, made.address))
    assert taken == [204, *range(128, 204), *range(205, 252)]
    assert last == claim(made.name, 254), "cannot claim"
    assert (made.is_ready(math.inf), made.due(11.2)) == (False, [])
    asked = Message(59904, b"\x00\xee\x00", 35, 255)
    assert made.take(100.0, asked) == [claim(made.name, 254)]
    assert made.take(100.0, Message(59904, (126996).to_bytes(3, "little"), 35, 255)) == []


def test_a_node_that_lost_every_address_gets_one_when_who_took_them_has_gone() -> None:
    session = ready(N2kSession("bus", N2kSettings()))
    session.receive(1.0, [claim(0, address) for address in (204, *range(128, 252))])
    session.due(1.1)
    helm: list[HelmSample] = []
    asked: list[float] = []
    for step in range(400):
        now = 1.2 + 0.05 * step
        helm += [each for each in session.receive(now, []) if isinstance(each, HelmSample)]
        session.poll(now)
        asked += [now for each in session.due(now) if each.group == 59904]
    assert len(asked) == 1 and 11.0 <= asked[0] <= 11.7
    assert session.node is not None and session.node.address == 204 and session.node.is_ready(21.0)
    assert [each.available for each in helm] == [True], "the helm is free again, for a new order"


def test_a_session_without_an_address_says_that_it_cannot_steer() -> None:
    session = ready(N2kSession("bus", N2kSettings()))
    helm = []
    for address in (204, *range(128, 252)):
        helm += [each for each in session.receive(1.0, [claim(0, address)]) if isinstance(each, HelmSample)]
    assert [(each.available, each.reason[:21]) for each in helm] == [(True, ""), (False, "no address is free on")]
    session.due(1.1)
    session.send(2.0, RudderCommand(2.0, 0.1, True))
    assert session.due(2.0) == []


@pytest.mark.parametrize("group", [0x3FFFF, 0x40000, 0xFFFFFD, 0xFFFFFF])
def test_a_request_for_a_group_that_cannot_be_ends_nothing(group: int) -> None:
    session = ready(N2kSession("bus", N2kSettings()))
    session.receive(1.0, [Message(59904, group.to_bytes(3, "little"), 35, 204)])
    assert [each.group for each in session.due(1.0)] == ([59392] if group <= 0x3FFFF else [])


@settings(max_examples=200, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.sampled_from([60928, 59904, 126208]),
            st.binary(max_size=20),
            st.integers(0, 255),
            st.sampled_from([204, 255, 7]),
        ),
        max_size=30,
    )
)
def test_whatever_comes_the_answers_are_ours_and_fit_the_bus(said: list[tuple[int, bytes, int, int]]) -> None:
    made = started()
    for number, (group, data, source, destination) in enumerate(said):
        for answer in made.take(1.0 + number, Message(group, data, source, destination)):
            assert answer.source == made.address
            assert len(answer.data) <= (8 if answer.group in (59392, 59904, 60928, 126993) else 223)


class Device2:
    """Our link on a virtual bus, as one of several nodes."""

    def __init__(self, channel: str, unique: int) -> None:
        line = BusLine(channel, open_bus("x", "virtual", channel))
        self.link = N2kLink(line, N2kSettings(device=Device(unique)))
        assert self.link.session.node is not None
        self.node = self.link.session.node


def turn(devices: list[Device2], now: float) -> None:
    """Have all speak before any of them hears: their claims cross."""
    for each in devices:
        each.link.poll(now)
    for each in devices:
        each.link.receive(now)


@pytest.fixture
def network(request: pytest.FixtureRequest) -> Iterator[list[Device2]]:
    made = [Device2(request.node.name, unique) for unique in (30, 10, 20)]
    yield made
    for each in made:
        each.link.close()


def test_of_devices_with_one_address_the_lowest_name_keeps_it_and_all_end_apart(network: list[Device2]) -> None:
    for step in range(100):
        turn(network, step * 0.02)
    addresses = {each.node.name & 0x1FFFFF: each.node.address for each in network}
    assert addresses[10] == 204
    assert len(set(addresses.values())) == 3 and all(each.node.is_ready(2.0) for each in network)
    for each in network:
        others = {other.node.address: other.node.name for other in network if other is not each}
        assert {address: each.node.known.get(address) for address in others} == others
        assert all(each.node.is_pilot(address) for address in others)


def test_a_device_that_comes_later_takes_a_free_address(network: list[Device2]) -> None:
    late = network.pop(1)
    for step in range(50):
        turn(network, step * 0.02)
    assert sorted(each.node.address for each in network) == [128, 204]
    assert network[1].node.address == 204, "of the two that began together the lower name"
    for step in range(50, 100):
        turn([*network, late], step * 0.02)
    assert late.node.address == 129, "who comes later asks first, and moves nobody"
    assert [each.node.address for each in network] == [128, 204]
    assert len({each.node.address for each in (*network, late)}) == 3
    network.append(late)


def test_heartbeats_come_every_minute_are_counted_and_can_be_had_more_often() -> None:
    made = started()
    beats = [(now, each.data) for now in range(1, 200) for each in made.due(float(now))]
    assert [now for now, _ in beats] == [1, 61, 121, 181]
    assert [struct.unpack_from("<HB", data) for _, data in beats] == [(6000, 1), (6000, 2), (6000, 3), (6000, 4)]
    answers = [answer_to(made, 200.0, request(126993, interval)) for interval in (5000, 500, 70000, 0)]
    assert [each[4] >> 4 for each in answers] == [0, 2, 1, 1], "done, too often, not that, not never"
    assert [now for now in range(200, 230) if made.due(float(now))] == [200, 205, 210, 215, 220, 225]
    assert answer_to(made, 230.0, request(126993, 0xFFFFFFFE))[4] == 0, "back to the usual"
    assert [now for now in range(230, 400) if made.due(float(now))] == [230, 290, 350]


def request(group: int, interval: int = 0xFFFFFFFF, count: int = 0, pairs: bytes = b"") -> bytes:
    return struct.pack("<B3sIHB", 0, group.to_bytes(3, "little"), interval, 0xFFFF, count) + pairs


def command(group: int, *pairs: tuple[int, bytes], priority: int = 8) -> bytes:
    head = struct.pack("<B3sBB", 1, group.to_bytes(3, "little"), 0xF0 | priority, len(pairs))
    return head + b"".join(bytes((index,)) + value for index, value in pairs)


def answer_to(made: Node, now: float, data: bytes) -> bytes:
    answer = made.take(now, Message(126208, data, 35, made.address))[0]
    assert (answer.group, answer.destination, answer.data[0]) == (126208, 35, 2)
    return answer.data


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (request(126996), (126996, 0, 0, b"")),
        (request(126996, 1000), (126996, 0, 1, b"")),
        (request(126996, count=1, pairs=b"\x01\x00\x00"), (126996, 4, 0, b"\xf5")),
        (request(130306), (130306, 1, 0, b"")),
        (command(130306, (2, b"\x01\x02")), (130306, 1, 0, b"\xf5")),
        (command(60928, (1, b"\x00\x00\x00"), (3, b"\x00")), (60928, 1, 0, b"\x55")),
        (command(127237, (99, b"\x00")), (127237, 4, 0, b"\xf1")),
        (command(127237, (11, b"\x00")), (127237, 4, 0, b"\xf1")),
        (b"\x03" + (127237).to_bytes(3, "little") + bytes(5), (127237, 6, 0, b"")),
        (b"\x05" + (127237).to_bytes(3, "little") + bytes(5), (127237, 6, 0, b"")),
    ],
)
def test_group_functions_are_acknowledged_with_the_code_that_fits(
    data: bytes, expected: tuple[int, int, int, bytes]
) -> None:
    answer = answer_to(started(), 1.0, data)
    group, code, other, fields = expected
    assert int.from_bytes(answer[1:4], "little") == group
    assert (answer[4] & 15, answer[4] >> 4, answer[6:]) == (code, other, fields)


def test_who_is_asked_with_everybody_acknowledges_nothing() -> None:
    made = started()
    for data, groups in ((request(126996), [126996]), (request(130306), []), (command(127237, (5, b"\0")), [])):
        assert [each.group for each in made.take(1.0, Message(126208, data, 35, 255))] == groups
    assert made.take(1.0, Message(126208, request(126996), 35, 7)) == [], "another is asked"
    assert made.take(1.0, Message(126208, b"\x02\x05\xf1\x01\x00\x00", 35, 204)) == [], "an acknowledgement"
    unknown = Message(59904, (130306).to_bytes(3, "little"), 35)
    assert made.take(1.0, unknown) == []
    (refusal,) = made.take(1.0, unknown._replace(destination=204))
    assert (refusal.group, refusal.destination, refusal.data) == (59392, 35, b"\x01\xff\xff\xff\xff\x02\xfd\x01")


MODE = {"main": 0xF8, "non-follow-up": 0xF9, "follow-up": 0xFA, "heading": 0xFC, "track": 0xFD, "unknown": 0xFF}
DONE, DENIED, UNSUPPORTED, NOT_NOW = 0, 3, 4, 2


def ordered(
    *pairs: tuple[int, bytes],
    takes: bool = True,
    mode: Mode = Mode.STANDBY,
    is_led: bool = False,
    is_valid: bool = True,
    **changes: object,
) -> tuple[int, bytes, list[tuple[str, float | None]]]:
    """Return code and field codes of the acknowledgement, and what the skipper got."""
    skipper = Skipper()
    settings = N2kSettings(takes_orders=takes, **changes)  # type: ignore[arg-type]
    session = ready(N2kSession("bus", settings, helm=skipper))
    state = NavState(1.0, 0.25, 0.0, 4.0, 0.0, 0.0, 0.1, is_valid)
    order = Order(OrderKind.HEADING, 0.5, is_led=is_led)
    session.on_tick(Tick(0, 1.0, (), order, state, Reference(0.0), 0.0, RudderCommand(1.0, 0.0, True), mode, ()))
    session.due(1.0)
    session.receive(1.0, [Message(126208, command(127237, *pairs), 35, 204)])
    (answer,) = session.due(1.0)
    assert answer.data[5] == len(pairs)
    return answer.data[4] & 15, answer.data[6:], skipper.orders


def course(angle: float) -> tuple[int, bytes]:
    return 11, struct.pack("<H", round(angle * 1e4))


def steering(name: str) -> tuple[int, bytes]:
    return 5, bytes((MODE[name] & 7,))


TRUE, MAGNETIC = (7, b"\0"), (7, b"\1")
ENGAGED = Mode.ENGAGED


def test_the_steering_can_be_ended_from_any_node_and_nothing_else_unless_that_is_wanted() -> None:
    assert ordered(steering("main"), takes=False) == (DONE, b"\xf0", [("stand by", None)])
    assert ordered(steering("main"), (10, b"\0\0"), mode=ENGAGED) == (DONE, b"\x50", [("stand by", None)])
    for pairs in ([steering("heading")], [steering("track")], [course(1.0)]):
        assert ordered(*pairs, takes=False, mode=ENGAGED) == (DENIED, b"\xf4", [])


@pytest.mark.parametrize(
    ("pairs", "mode", "is_led", "orders"),
    [
        ([steering("heading")], Mode.STANDBY, False, [("engage", None)]),
        ([steering("heading"), TRUE, course(1.5)], Mode.STANDBY, False, [("engage", 1.5)]),
        ([steering("heading"), course(1.5)], ENGAGED, False, [("turn", 1.5)]),
        ([course(1.5)], ENGAGED, True, [("turn", 1.5)]),
        ([course(6.0)], ENGAGED, False, [("turn", 6.0 - math.tau)]),
        ([steering("heading")], ENGAGED, False, []),
        ([steering("heading")], ENGAGED, True, [("engage", None)]),
        ([steering("track")], Mode.STANDBY, False, [("follow", None)]),
    ],
)
def test_where_it_is_wanted_a_plotter_engages_and_turns(
    pairs: list[tuple[int, bytes]], mode: Mode, is_led: bool, orders: list[tuple[str, float | None]]
) -> None:
    code, _, said = ordered(*pairs, mode=mode, is_led=is_led)
    assert code == DONE
    assert said == [
        (name, heading if heading is None else pytest.approx(heading, abs=1e-4)) for name, heading in orders
    ]


@pytest.mark.parametrize(
    ("pairs", "changes", "expected"),
    [
        ([course(1.0)], {}, (NOT_NOW, b"\xf2")),
        ([steering("heading")], {"is_valid": False}, (NOT_NOW, b"\xf2")),
        ([steering("heading"), MAGNETIC, course(1.0)], {}, (NOT_NOW, b"\x22\xf2")),
        ([steering("follow-up")], {"mode": ENGAGED}, (UNSUPPORTED, b"\xf3")),
        ([steering("unknown")], {"mode": ENGAGED}, (UNSUPPORTED, b"\xf3")),
        ([course(6.5536 - 1e-4)], {"mode": ENGAGED}, (UNSUPPORTED, b"\xf3")),
        ([steering("heading"), (10, b"\0\0")], {}, (UNSUPPORTED, b"\x50")),
        ([(12, b"\0\0")], {"mode": ENGAGED}, (UNSUPPORTED, b"\xf5")),
        ([], {"mode": ENGAGED}, (UNSUPPORTED, b"")),
    ],
)
def test_what_cannot_be_done_is_not_done_in_part(
    pairs: list[tuple[int, bytes]], changes: dict[str, object], expected: tuple[int, bytes]
) -> None:
    assert ordered(*pairs, **changes) == (*expected, [])  # type: ignore[arg-type]


def test_what_was_ordered_while_the_computer_stood_still_is_not_carried_out_but_to_stand_by() -> None:
    skipper = Skipper()
    session = ready(N2kSession("bus", N2kSettings(takes_orders=True), helm=skipper))
    state = NavState(1.0, 0.25, 0.0, 4.0, 0.0, 0.0, 0.1, True)
    tick = Tick(0, 1.0, (), Order(), state, Reference(0.0), 0.0, RudderCommand(1.0, 0.0, False), Mode.STANDBY, ())
    session.on_tick(tick)

    def answered(now: float, *pairs: tuple[int, bytes]) -> int:
        session.due(now)
        session.receive(now, [Message(126208, command(127237, *pairs), 35, 204)])
        (answer,) = session.due(now)
        return answer.data[4] & 15

    session.receive(1.0, [])
    assert answered(61.0, steering("heading")) == answered(61.4, steering("track")) == NOT_NOW
    assert skipper.orders == []
    assert answered(61.4, steering("main")) == DONE
    assert answered(61.6, steering("heading")) == DONE
    assert skipper.orders == [("stand by", None), ("engage", None)]


def test_a_commanded_course_is_taken_from_the_north_that_it_names() -> None:
    turned = ordered(MAGNETIC, course(1.0), mode=ENGAGED, variation=0.1)
    assert turned == (DONE, b"\x00", [("turn", pytest.approx(1.1))])
    turned = ordered(TRUE, course(1.0), mode=ENGAGED, variation=0.1, magnetic=True)
    assert turned == (DONE, b"\x00", [("turn", pytest.approx(0.9))])
    assert ordered(course(1.0), mode=ENGAGED, magnetic=True)[2] == [("turn", pytest.approx(1.0))]


def test_every_group_of_the_lists_is_answered_or_heard() -> None:
    session = ready(N2kSession("bus", N2kSettings()))
    session.send(1.0, RudderCommand(1.0, 0.1, True))
    session.due(1.0)
    session.receive(1.0, [Message(59904, (126464).to_bytes(3, "little"), 35, 204)])
    sent, read = [
        [int.from_bytes(each.data[at : at + 3], "little") for at in range(1, len(each.data), 3)]
        for each in session.due(1.0)
    ]
    assert set(sent) == {*nodes.SENT, 126983, 126985, 127233, 127237, 127245}
    for group in set(sent) - {59392, 59904, 126208, 126983, 126985, 127233, 127237}:
        session.receive(1.0, [Message(59904, group.to_bytes(3, "little"), 35, 204)])
        assert {each.group for each in session.due(1.0)} == {group}
    assert {127250, 129284, 127237, 60928} <= set(read)


def test_rudder_orders_under_our_own_address_that_are_not_ours_bar_the_helm() -> None:
    """As from a second pilot with the same NAME, or a forger; what a gateway sends back of ours is neither."""
    session = ready(N2kSession("bus", N2kSettings()))
    assert session.node is not None and session.node.address == 204
    helm: list[HelmSample] = []
    for step in range(60):
        now = 1.0 + 0.05 * step
        session.send(now, RudderCommand(now, 0.01 * step, True))
        echo = [each for each in session.due(now) if each.group == 127245]
        helm += [each for each in session.receive(now + 0.3, echo) if isinstance(each, HelmSample)]
    assert all(each.available for each in helm)
    rudder = struct.pack("<BBhhH", 0, 0xF9, 1000, 0, 0xFFFF)
    forged = session.receive(5.0, [Message(127245, rudder, 204)])
    assert [each.reason[:63] for each in forged if isinstance(each, HelmSample)] == [
        "another autopilot of the NMEA 2000 network, address 204, orders"
    ]
    assert [each.available for each in session.receive(7.1, []) if isinstance(each, HelmSample)] == [True]


def test_two_autopilots_do_not_order_one_rudder() -> None:
    """A node that says it is an autopilot orders the rudder; a drive that shows the order it obeys is no pilot."""
    rudder = struct.pack("<BBhhH", 0, 0xF9, 1000, 0, 0xFFFF)
    pilot, drive = (1 << 63 | 4 << 60 | 40 << 49 | function << 40 | 7 for function in (150, 155))
    for name, is_wanted, barred in ((pilot, False, True), (drive, False, False), (pilot, True, False)):
        session = ready(N2kSession("bus", N2kSettings(with_other_pilot=is_wanted)))
        session.receive(0.1, [claim(name, 5)])
        said = [each for each in session.receive(1.0, [Message(127245, rudder, 5)]) if isinstance(each, HelmSample)]
        said += [each for each in session.receive(3.1, []) if isinstance(each, HelmSample)]
        assert [each.available for each in said] == ([False, True] if barred else [])
        assert not barred or said[0].reason.startswith("another autopilot of the NMEA 2000 network, address 5, orders")
        released = Message(127245, struct.pack("<BBhhH", 0, 0xF8, 0x7FFF, 0, 0xFFFF), 5)
        assert [each for each in session.receive(4.0, [released]) if isinstance(each, HelmSample)] == []


def test_a_display_that_could_not_see_that_another_stood_by_engages_nothing() -> None:
    skipper = Skipper()
    session = ready(N2kSession("bus", N2kSettings(takes_orders=True), helm=skipper))
    state = NavState(1.0, 0.25, 0.0, 4.0, 0.0, 0.0, 0.1, True)

    def answered(now: float, source: int, mode: Mode, *pairs: tuple[int, bytes]) -> int:
        session.on_tick(Tick(0, now, (), Order(), state, Reference(0.0), 0.0, RudderCommand(now, 0.0, True), mode, ()))
        session.due(now)
        session.receive(now, [Message(126208, command(127237, *pairs), source, 204)])
        answer = next(each for each in session.due(now) if each.group == 126208)
        return answer.data[4] & 15

    session.receive(1.0, [])
    assert answered(1.0, 35, ENGAGED, steering("main")) == DONE
    assert answered(1.1, 36, Mode.STANDBY, steering("track")) == NOT_NOW
    assert answered(1.2, 36, Mode.STANDBY, steering("main")) == DONE
    assert answered(1.3, 36, Mode.STANDBY, steering("heading")) == DONE, "who stood by may engage at once"
    session.on_tick(Tick(0, 1.4, (), Order(), state, Reference(0.0), 0.0, RudderCommand(1.4, 0.0, True), ENGAGED, ()))
    skipper.last_stop.ordered(1.5, "somebody at the page")
    assert answered(1.6, 36, Mode.STANDBY, steering("heading")) == NOT_NOW
    assert answered(2.4, 36, Mode.STANDBY, steering("heading")) == DONE
    assert [name for name, _ in skipper.orders] == ["stand by", "stand by", "engage", "engage"]
