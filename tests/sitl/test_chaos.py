"""The line that damages what it carries: each kind of damage as often as set, by the seed, and nothing else."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from autopilot.errors import InputError
from autopilot.vessel.file import load_vessel
from sitl.fault_table import Damage
from sitl.faults import Fault
from sitl.scenario import load_scenario
from sitl.serve import ChaosLine, ChaosPort, chaos_faults
from sitl.world import World

SENT = [number.to_bytes(4, "big") * 5 for number in range(2000)]


def carry(damage: Damage, seed: int = 1, is_stream: bool = False) -> list[tuple[float, bytes]]:
    """Send a packet every hundredth of a second; what arrives, and when."""
    line = ChaosLine(seed, is_stream)
    arrived = []
    for number, packet in enumerate(SENT):
        line.put(0.01 * number, packet, damage)
        arrived += [(0.01 * number, data) for data in line.take(0.01 * number)]
    return arrived + [(99.0, data) for data in line.take(99.0)]


def share_unlike_what_was_sent(damage: Damage) -> float:
    arrived = [data for _, data in carry(damage)]
    return sum(data != sent for data, sent in zip(arrived, SENT, strict=True)) / len(SENT)


def test_a_clear_line_carries_all_at_once_and_in_order() -> None:
    assert carry(Damage()) == [(0.01 * number, packet) for number, packet in enumerate(SENT)]


def test_the_same_seed_is_the_same_line() -> None:
    bad = Damage(0.1, 0.05, 0.05, 0.1, 0.1, 0.1, 0.1)
    assert carry(bad) == carry(bad)
    assert carry(bad) != carry(bad, seed=2)


def test_each_damage_comes_as_often_as_set() -> None:
    assert len(carry(Damage(loss=0.3))) == pytest.approx(1400, abs=80)
    assert len(carry(Damage(duplicate=0.3))) == pytest.approx(2600, abs=80)
    assert share_unlike_what_was_sent(Damage(corrupt=0.3)) == pytest.approx(0.3, abs=0.05)
    assert share_unlike_what_was_sent(Damage(truncate=0.3)) == pytest.approx(0.3, abs=0.05)
    assert all(len(data) == 20 for _, data in carry(Damage(corrupt=1.0)))
    assert not carry(Damage(still=True))


def test_delay_is_constant_and_jitter_is_not() -> None:
    late = [when - 0.01 * number for number, (when, _) in enumerate(carry(Damage(delay=0.1))[:1900])]
    assert min(late) == pytest.approx(0.1, abs=0.011)
    assert max(late) == pytest.approx(0.1, abs=0.011)
    order = [data for _, data in carry(Damage(jitter=0.1))]
    assert order != SENT
    assert sorted(order) == sorted(SENT)
    assert [data for _, data in carry(Damage(reorder=0.2))] != SENT


def test_a_stream_is_never_overtaken() -> None:
    assert [data for _, data in carry(Damage(jitter=0.2, reorder=0.3, delay=0.1), is_stream=True)] == SENT


def test_a_flood_is_as_thick_as_set() -> None:
    line = ChaosLine(3)
    for step in range(1, 101):
        line.make_noise(0.1 * step, Damage(flood=50.0))
    assert len(line.take(99.0)) == pytest.approx(500, abs=8)


class Echo:
    """An endpoint that sends back what it gets."""

    def __init__(self) -> None:
        self.got: list[bytes] = []
        self._waiting: list[bytes] = []

    def receive(self, now: float, data: bytes) -> None:
        self.got.append(data)
        self._waiting.append(data)

    def transmit(self, now: float) -> list[bytes]:
        waiting, self._waiting = self._waiting, []
        return waiting


def port_with(*faults: Fault) -> tuple[ChaosPort, Echo]:
    world = World(load_vessel("lanxin"), dataclasses.replace(load_scenario("calm"), faults=()))
    for fault in faults:
        world.faults.add(fault)
    echo = Echo()
    return ChaosPort(echo, world, False, np.random.SeedSequence(5)), echo


def test_a_port_is_clear_until_a_fault_begins_and_after_it() -> None:
    port, echo = port_with(Fault("link_half_open", 1.0, 2.0, 1.0), Fault("link_deaf", 3.0, 4.0, 1.0))
    heard = {}
    for step in range(50):
        now = 0.1 * step
        port.receive(now, bytes((step,)))
        heard[step] = port.transmit(now)
    got = {data[0] for data in echo.got}
    assert got == set(range(50)) - set(range(10, 20)) - set(range(30, 40))
    assert all(bool(heard[step]) == (step in got) for step in range(50))


def test_link_delay_applies_to_both_directions() -> None:
    port, echo = port_with(Fault("link_delay", 0.0, 100.0, 0.25))
    port.receive(0.0, b"x")
    returned = [step for step in range(100) if port.transmit(0.01 * step)]
    assert echo.got == [b"x"]
    assert returned == [50]


def test_options_are_read_strictly() -> None:
    (loss, half) = chaos_faults("loss=0.05, half_open=30")
    assert (loss.kind, loss.size, loss.begin) == ("link_loss", 0.05, 0.0)
    assert (half.kind, half.begin) == ("link_half_open", 30.0)
    for text, words in [
        ("los=0.1", "allowed are loss"),
        ("loss=0.1,loss=0.2", "twice"),
        ("loss=2", "0 to 1"),
        ("loss", "must be a number"),
        ("delay=nan", "must be a number"),
        ("", "unknown"),
    ]:
        with pytest.raises(InputError, match=words):
            chaos_faults(text)
