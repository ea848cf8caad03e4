"""The loop when links break in the middle of a tick, when bursts arrive, and when a tick cannot be written."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from manual_clock import ManualClock

from autopilot.links.base import LinkError
from autopilot.runtime.build import build_pilot
from autopilot.runtime.record import Recorder, read_log
from autopilot.runtime.session import Session, newest
from autopilot.signals import (
    MOST_SAMPLES,
    HeadingSample,
    HelmSample,
    Order,
    OrderKind,
    RudderCommand,
    Sample,
    Tick,
)
from autopilot.vessel.file import load_vessel

VESSEL = load_vessel("lanxin")
NORTH = Order(OrderKind.HEADING, 0.0, serial=1)


class FakeLink:
    """Gives `per_tick` headings at every call; breaks where it is ordered to."""

    def __init__(self, per_tick: int = 1, fail_send_at: float = math.inf, fail_release: bool = False) -> None:
        self.name = "fake"
        self.per_tick = per_tick
        self.fail_send_at = fail_send_at
        self.fail_release = fail_release
        self.released = 0
        self.closed = 0
        self.sent: list[RudderCommand] = []

    def fileno(self) -> int:
        return -1

    def receive(self, now: float) -> list[Sample]:
        return [HeadingSample(now - 1.0e-5 * index, 0.1, 0.0, "fake") for index in range(self.per_tick)]

    def send(self, now: float, command: RudderCommand) -> None:
        if now >= self.fail_send_at:
            raise LinkError("fake: unplugged; plug it in")
        self.sent.append(command)

    def publish_tick(self, tick: Tick) -> None:
        pass

    def poll(self, now: float) -> None:
        pass

    def release(self, now: float) -> None:
        self.released += 1
        if self.fail_release:
            raise RuntimeError("a bug in a link")

    def take_packets(self) -> list[tuple[float, bytes]]:
        return []

    def close(self) -> None:
        self.closed += 1


def session(links: list[FakeLink], recorder: Recorder | None = None, start: float = 0.0) -> Session:
    return Session(build_pilot(VESSEL), links, ManualClock(start), 20.0, lambda _now, _tick: NORTH, recorder)


def test_the_tick_whose_command_met_a_broken_link_is_in_the_log(tmp_path: Path) -> None:
    path = tmp_path / "a.tlog"
    link = FakeLink(fail_send_at=1.0)
    with pytest.raises(LinkError, match="unplugged"), session([link], Recorder(path, {}, 0.0)) as running:
        running.run(5.0)
    ticks = read_log(path).ticks
    assert len(ticks) == len(link.sent) + 1
    assert ticks[-1] == running.tick
    assert link.released == link.closed == 1


def test_a_bug_in_one_link_does_not_keep_the_rudder_of_the_other(tmp_path: Path) -> None:
    first, second = FakeLink(fail_release=True), FakeLink()
    recorder = Recorder(tmp_path / "a.tlog", {}, 0.0)
    with pytest.raises(RuntimeError, match="a bug in a link"), session([first, second], recorder) as running:
        running.run(1.0)
    for link in (first, second):
        assert link.released == 1
        assert link.closed == 1
    assert len(read_log(tmp_path / "a.tlog").ticks) == len(second.sent)


def test_links_are_released_before_any_is_closed() -> None:
    events: list[str] = []

    class Telling(FakeLink):
        def release(self, now: float) -> None:
            events.append("release")

        def close(self) -> None:
            events.append("close")

    session([Telling(), Telling()]).close()
    assert events == ["release", "release", "close", "close"]


def test_a_burst_is_cut_to_what_a_tick_holds_and_the_log_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "a.tlog"
    recorder = Recorder(path, {}, 0.0)
    with session([FakeLink(per_tick=3000)], recorder) as running:
        running.run(0.2)
    assert recorder.failed == ""
    assert all(len(tick.samples) == MOST_SAMPLES for tick in read_log(path).ticks)


def test_a_burst_never_drops_who_has_the_helm() -> None:
    taken = HelmSample(0.0, False, "mode HOLD")
    headings = [HeadingSample(float(index), 0.0) for index in range(1000)]
    kept = newest([taken, *headings])
    assert kept[0] is taken
    assert len(kept) == MOST_SAMPLES
    assert kept[-1] is headings[-1]
    assert newest(headings[:3]) == tuple(headings[:3])


def test_a_tick_that_cannot_be_written_stops_the_log_and_not_the_boat(tmp_path: Path) -> None:
    recorder, link = Recorder(tmp_path / "a.tlog", {}, 0.0), FakeLink()
    orders = lambda now, _tick: NORTH if now < 0.5 else NORTH._replace(serial=-1)  # noqa: E731 - a skipper with a bug
    with Session(build_pilot(VESSEL), [link], ManualClock(), 20.0, orders, recorder) as running:
        running.run(1.0)
    assert "log stopped: tick" in recorder.failed
    ticks = read_log(tmp_path / "a.tlog").ticks
    assert 0 < len(ticks) < len(link.sent)


@pytest.mark.parametrize("start", [0.0, 0.1 + 0.2, 1.0e5 / 3.0, 86400.0 * 30 + 0.7])
def test_rounding_of_the_clock_never_stops_a_lockstep_run(start: float) -> None:
    silent = FakeLink(per_tick=0)
    with session([silent], start=start) as running:
        running.run(start + 2.0)
    assert 38 <= len(silent.sent) <= 42
