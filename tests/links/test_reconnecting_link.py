"""Lines that go and come back: hands off while they are gone, steering again when that is ordered."""

from __future__ import annotations

import os
import pty
import tty
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from alarm_texts import other, words, words_of
from lockstep import Lockstep
from manual_clock import ManualClock
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.estimation.sensor_selection import SensorSelection
from autopilot.guidance.track import TrackGuide
from autopilot.links.base import Link, LinkError, close_all
from autopilot.links.drives import DriveLink, DriveSettings
from autopilot.links.drives.maestro import Maestro
from autopilot.links.ground_station.boat_link import BoatLink
from autopilot.links.ground_station.commands import Commands
from autopilot.links.ground_station.mission import Mission
from autopilot.links.ground_station.station_service import ParameterServer
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.companion import CompanionLink
from autopilot.links.reconnect import ReconnectingLink, SelectingLink
from autopilot.links.rudder_order import Release, ReleaseState
from autopilot.links.transports import SerialTransport, loopback_pair
from autopilot.links.transports.serial_line import device_of
from autopilot.runtime.build import build_pilot
from autopilot.runtime.build_links import LinkOptions, build_links
from autopilot.runtime.session import Session
from autopilot.signals import AlarmEvent, AlarmSample, HeadingSample, HelmSample, Mode, Order, OrderKind, Sample
from autopilot.vessel.file import load_vessel

RETRY_S = 1.0

VESSEL = load_vessel("lanxin")


def at_once(work: Callable[[], None]) -> None:
    work()


class Plugged:
    """An adapter in lockstep with its vehicle; pulled, every use of its line fails."""

    def __init__(self) -> None:
        self.run = Lockstep(VESSEL)
        self.settings = self.run.link.session._settings
        self.is_in = True
        self.opened = 0
        self.run.near.close()
        self.kept = ReconnectingLink("line", True, self.open, at_once)
        self.run.session._use((self.kept,))
        self.run.session._showing = [self.kept]

    def open(self) -> Link:
        if not self.is_in:
            raise LinkError("line: there is no device; plug it in")
        self.opened += 1
        near, self.run.far = loopback_pair("line")
        return CompanionLink(near, self.settings)

    def pull(self) -> None:
        self.is_in = False
        self.run.far.close()
        # the vehicle goes on by itself, with nobody to hear it
        self.run.carry = self.run.vehicle.advance  # type: ignore[method-assign]

    def plug_in(self) -> None:
        self.is_in = True
        self.run.carry = self.carry  # type: ignore[method-assign]

    def carry(self, now: float) -> None:
        """Both ways, as soon as the line is open again."""
        if self.opened > 1:
            Lockstep.carry(self.run, now)
        else:
            self.run.vehicle.advance(now)

    def sail(self, seconds: float, mode: Mode | None = None) -> bool:
        return self.run.run(seconds, until=None if mode is None else lambda tick: tick.mode is mode)


@pytest.fixture
def plugged() -> Plugged:
    return Plugged()


def test_a_pulled_adapter_is_hands_off_with_the_reason(plugged: Plugged) -> None:
    plugged.run.engage(90.0)
    assert plugged.sail(20.0, Mode.ENGAGED)
    plugged.sail(3.0)
    plugged.pull()
    assert plugged.sail(1.0, Mode.OVERRIDE)
    alarms = " ".join(words_of(plugged.run.tick))
    assert "line" in alarms
    assert "opened again as soon as it is there" in alarms
    assert not plugged.run.tick.command.engaged
    plugged.sail(4.0)
    assert not plugged.run.firmware.overrides.active(plugged.run.now, 3.0)


@pytest.mark.parametrize("away", [0.0, 60.0])
def test_it_comes_back_and_steers_when_that_is_ordered(plugged: Plugged, away: float) -> None:
    run = plugged.run
    run.engage(90.0)
    assert plugged.sail(20.0, Mode.ENGAGED)
    plugged.pull()
    plugged.sail(2.0)
    run.clock.time += away  # nobody looks meanwhile; the vehicle's clock goes on with it
    plugged.sail(2.0)
    assert plugged.opened == 1
    plugged.plug_in()
    plugged.sail(15.0)
    assert plugged.opened == 2
    assert run.tick.mode in (Mode.OVERRIDE, Mode.FAILSAFE)  # nothing is engaged by itself
    assert not any("opened again" in alarm for alarm in words_of(run.tick))
    run.engage(45.0)
    assert plugged.sail(20.0, Mode.ENGAGED)
    plugged.sail(20.0)
    assert abs(run.world.boat.state.heading - 0.785) < 0.1


def test_opening_is_tried_once_a_second_and_one_at_a_time() -> None:
    tried: list[float] = []
    waiting: list[Callable[[], None]] = []
    now = 0.0

    def opener() -> Link:
        tried.append(now)
        raise LinkError("line: nobody there; look")

    kept = ReconnectingLink("line", False, opener, waiting.append)
    assert len(tried) == 1
    for step in range(100):
        now = 0.1 * step
        kept.receive(now)
        assert len(waiting) <= 1
        if waiting and step % 3 == 0:
            waiting.pop()()
    assert 8 <= len(tried) <= 1 + 10.0 / RETRY_S
    assert kept.fileno() == -1


def test_a_link_that_is_opened_after_the_end_is_closed() -> None:
    waiting: list[Callable[[], None]] = []
    opened: list[Any] = []

    def opener() -> Link:
        if not waiting:
            raise LinkError("not yet; wait")
        near, _ = loopback_pair("line")
        opened.append(near)
        return CompanionLink(near, Lockstep(VESSEL).link.session._settings)

    kept = ReconnectingLink("line", True, opener, waiting.append)
    kept.receive(1.0)
    kept.close()
    waiting[0]()
    assert opened[0].closed


def test_without_its_rudder_drive_nothing_is_engaged() -> None:
    """A compass that is well, and a drive whose adapter has not come yet."""

    class Compass:
        name = "compass"

        def receive(self, now: float) -> list[Sample]:
            return [HeadingSample(now, 0.1, 0.0, "compass")]

        def __getattr__(self, _: str) -> Any:
            return lambda *_: []

        def fileno(self) -> int:
            return -1

    drive = DriveLink(loopback_pair("drive")[0], Maestro(DriveSettings(0.5)))
    there = SimpleNamespace(yes=False)

    def opener() -> Link:
        if not there.yes:
            raise LinkError("drive: there is no device; plug it in")
        return drive

    kept = ReconnectingLink(drive.name, True, opener, at_once)
    order = Order(OrderKind.HEADING, 0.1, serial=1)
    session = Session(build_pilot(VESSEL), [Compass(), kept], ManualClock(), 20.0, lambda *_: order)
    session.run(5.0)
    assert session.tick is not None
    assert session.tick.mode is Mode.STANDBY
    assert "there is no device" in " ".join(words_of(session.tick))
    there.yes = True
    session.run(10.0)
    assert "check its power, line, baud rate" in " ".join(words_of(session.tick))  # there, and silent
    assert "there is no device" not in " ".join(words_of(session.tick))


def test_a_line_away_for_an_hour_is_asked_for_every_second_and_is_there_at_once() -> None:
    """Beside it the compass and the loop go on."""
    there, tried = SimpleNamespace(yes=False), []

    def opener() -> Link:
        tried.append(1)
        if not there.yes:
            raise LinkError("line: there is no device; plug it in")
        return CompanionLink(loopback_pair("line")[0], Lockstep(VESSEL).link.session._settings)

    kept = ReconnectingLink("line", True, opener, at_once)
    for second in range(3600):
        kept.receive(float(second))
        kept.poll(float(second))
    assert len(tried) == 3600 + 1
    there.yes = True
    kept.receive(3600.0)
    kept.receive(3600.1)
    assert kept.trouble == ""


def test_what_the_lost_link_had_said_is_taken_back() -> None:
    class Talking:
        def __init__(self) -> None:
            self.is_lost = False

        def receive(self, now: float) -> list[Sample]:
            if self.is_lost:
                raise LinkError("line: gone; look")
            return [AlarmSample(now, other("low battery"), "drive"), HelmSample(now, True, "", "drive")]

        def take_packets(self) -> list[tuple[float, bytes]]:
            return [(1.0, b"last words")]

        def close(self) -> None:
            raise LinkError("line: gone, really")

    talking = Talking()
    kept = ReconnectingLink("line", True, lambda: talking, at_once)  # type: ignore[arg-type, return-value]
    kept.receive(1.0)
    talking.is_lost = True
    said = kept.receive(2.0)
    assert [(type(each).__name__, getattr(each, "source", "")) for each in said] == [
        ("HelmSample", "drive"), ("HelmSample", "line"), ("AlarmSample", "drive"), ("AlarmSample", "line line"),
    ]  # fmt: skip
    assert all(not each.available for each in said if isinstance(each, HelmSample))
    assert said[2].event is None  # type: ignore[union-attr]
    assert kept.take_packets() == [(1.0, b"last words")]
    assert kept.take_packets() == []


def test_an_adapter_that_comes_back_under_another_name(tmp_path: Path) -> None:
    """Real terminals behind a name that udev would keep."""
    name, seen = tmp_path / "by-id-GPS", []
    for _ in range(2):
        ours, theirs = pty.openpty()
        tty.setraw(theirs)
        name.unlink(missing_ok=True)
        name.symlink_to(os.ttyname(theirs))
        transport = SerialTransport("serial", f"{tmp_path}/by-id-*", 4800)
        os.write(ours, b"$HCHDT,1,T\r\n")
        seen.append(b"".join(transport.receive()))
        transport.close()
        os.close(theirs)
        os.close(ours)
    assert seen == [b"$HCHDT,1,T\r\n"] * 2


def test_devices_by_serial_number_and_by_pattern(tmp_path: Path) -> None:
    ports = [
        SimpleNamespace(device="/dev/ttyACM1", serial_number="A1"),
        SimpleNamespace(device="/dev/ttyACM0", serial_number="A1"),
        SimpleNamespace(device="/dev/ttyUSB0", serial_number="B2"),
        SimpleNamespace(device="/dev/ttyS0", serial_number=None),
    ]
    assert device_of("l", "usb=B2", lambda: ports) == "/dev/ttyUSB0"
    assert device_of("l", "usb=A1", lambda: ports) == "/dev/ttyACM0"
    with pytest.raises(LinkError, match=r"no adapter with USB serial number C3; plug it in \(present are: A1, B2\)"):
        device_of("l", "usb=C3", lambda: ports)
    with pytest.raises(LinkError, match="present are: none"):
        device_of("l", "usb=C3", list)
    assert device_of("l", "/dev/ttyUSB0") == "/dev/ttyUSB0"
    for each in ("a-1", "a-2", "b-1"):
        (tmp_path / each).touch()
    assert device_of("l", f"{tmp_path}/b*") == f"{tmp_path}/b-1"
    with pytest.raises(LinkError, match="is 2 devices"):
        device_of("l", f"{tmp_path}/a*")
    with pytest.raises(LinkError, match="there is no device"):
        device_of("l", f"{tmp_path}/c*")


def test_a_run_waits_for_what_is_not_plugged_in() -> None:
    url = "serial:usb=NOWHERE:115200"
    with pytest.raises(LinkError, match="no adapter with USB serial number NOWHERE"):
        build_links(VESSEL, [url])
    (link,) = build_links(VESSEL, [url], LinkOptions(reconnect=True))
    said = link.receive(0.0)
    assert any(isinstance(each, HelmSample) and not each.available for each in said)
    link.close()


def test_a_ground_station_s_line_that_is_lost_is_opened_again_and_steering_goes_on() -> None:
    ends: list[Any] = []

    class Silent:
        """Takes no orders: none are given here."""

        names = ()
        revision = 0

    def open_it() -> Link:
        near, far = loopback_pair("radio")
        ends.append(far)
        mission = Mission(TrackGuide())
        return BoatLink(near, Commands(Silent(), False, mission), ParameterServer(Silent()))  # type: ignore[arg-type]

    kept, station, samples = ReconnectingLink("radio", False, open_it, at_once), MavlinkCodec(255, 190), []
    beat = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    for step in range(400):
        now = 0.05 * step
        if step == 100:
            ends[0].close()
        if step % 10 == 0 and not 100 <= step < 300:
            ends[-1].send(station.encode(beat))
        samples += kept.receive(now)
        kept.poll(now)
    assert not [sample for sample in samples if isinstance(sample, HelmSample)], "it never had the helm"
    alarms = [(words(sample.event), sample.source) for sample in samples if isinstance(sample, AlarmSample)]
    assert [text for text, source in alarms if source == "radio line"][-1] == "" and len(ends) == 2
    assert "opened again" in next(text for text, source in alarms if source == "radio line")
    heard = [message.get_type() for data in ends[1].receive() for message in MavlinkCodec().decode(data)]
    assert heard.count("HEARTBEAT") >= 10


@pytest.mark.parametrize("wrong", [ValueError("odd"), MemoryError(), RuntimeError("driver")])
def test_whatever_goes_wrong_while_opening_the_line_is_opened_again(wrong: Exception) -> None:
    tries: list[Exception | None] = [LinkError("line: gone; look"), wrong, wrong, None]

    def opener() -> Link:
        error = tries.pop(0)
        if error is not None:
            raise error
        return loopback_link()

    kept = ReconnectingLink("line", True, opener, at_once)
    for turn in range(1, 6):
        kept.receive(turn * (RETRY_S + 0.1))
    assert not tries
    assert kept.trouble == ""


def test_a_machine_without_a_thread_to_spare_is_asked_again() -> None:
    starts = 0

    def start(work: Callable[[], None]) -> None:
        nonlocal starts
        starts += 1
        if starts < 3:
            raise RuntimeError("can't start new thread")
        work()

    tries: list[LinkError] = [LinkError("line: gone; look")]

    def opener() -> Link:
        if tries:
            raise tries.pop()
        return loopback_link()

    kept = ReconnectingLink("line", True, opener, start)
    for turn in range(1, 6):
        kept.receive(turn * (RETRY_S + 0.1))
    assert starts == 3
    assert kept.trouble == ""


def loopback_link() -> Link:
    near, _ = loopback_pair("line")
    return DriveLink(near, Maestro(DriveSettings(1.0)))


def test_a_link_missing_at_the_start_is_reported_at_once() -> None:
    def opener() -> Link:
        raise LinkError("line: not there; plug it in and start again")

    kept = ReconnectingLink("line", True, opener, lambda work: None)
    said = "line: not there; it is opened again as soon as it is there"
    assert kept.receive(7.5) == [
        HelmSample(7.5, False, "line lost: line: not there", "line"),
        AlarmSample(7.5, AlarmEvent("line_lost", said), "line line"),
    ]
    assert kept.receive(8.0) == [] and (kept.fileno(), kept.take_packets()) == (-1, [])
    found = kept.release_result(8.0)
    assert found is not None and found.sentence == "rudder not held"
    listening = ReconnectingLink("line", False, opener, lambda work: None)
    assert [type(sample) for sample in listening.receive(1.0)] == [AlarmSample]


def test_every_link_is_closed_even_where_another_fails() -> None:
    closed: list[int] = []

    class Closing:
        def __init__(self, number: int) -> None:
            self.number = number

        def close(self) -> None:
            closed.append(self.number)
            if self.number == 1:
                raise LinkError("stuck")

    with pytest.raises(LinkError, match="stuck"):
        close_all([Closing(number) for number in range(3)])  # type: ignore[misc]
    assert sorted(closed) == [0, 1, 2]


class Recorded:
    """A link that writes down what it is asked."""

    name = "line"

    def __init__(self) -> None:
        self.asked: list[Any] = []
        self.fails: LinkError | None = None
        self.brings: list[Sample] = []
        self.packets: list[tuple[float, bytes]] = []

    def _note(self, *asked: Any) -> None:
        self.asked.append(asked)
        if self.fails is not None:
            raise self.fails

    def fileno(self) -> int:
        return 17

    def receive(self, now: float) -> list[Sample]:
        self._note("receive", now)
        return self.brings

    def send(self, now: float, command: Any) -> None:
        self._note("send", now, command)

    def poll(self, now: float) -> None:
        self._note("poll", now)

    def publish_tick(self, tick: Any) -> None:
        self._note("publish_tick", tick)

    def release(self, now: float) -> None:
        self.asked.append(("release", now))

    def take_packets(self) -> list[tuple[float, bytes]]:
        packets, self.packets = self.packets, []
        return packets

    def close(self) -> None:
        self.asked.append(("close",))


class Mover(Recorded):
    """One that moves a rudder."""

    result: Release | None = None

    def release_result(self, now: float) -> Release | None:
        self.asked.append(("release_result", now))
        return self.result


WRAPPERS: dict[str, Callable[[Any], Any]] = {
    "reconnecting": lambda link: ReconnectingLink("line", True, lambda: link, at_once),
    "selecting": lambda link: SelectingLink(link, SensorSelection()),
}


@pytest.mark.parametrize("wrapper", WRAPPERS)
@pytest.mark.parametrize("kind", [Recorded, Mover])
def test_a_link_round_another_passes_on_every_word(wrapper: str, kind: type[Recorded]) -> None:
    inside = kind()
    link = WRAPPERS[wrapper](inside)
    tick = SimpleNamespace(now=7.0)
    command = object()
    inside.brings = [HeadingSample(1.0, 0.5, None, "HEHDT")]
    inside.packets = [(1.0, b"a")]
    assert (link.name, link.fileno(), link.receive(1.0)) == ("line", 17, inside.brings)
    link.send(2.0, command)
    link.poll(4.0)
    link.publish_tick(tick)
    link.release(5.0)
    found = link.release_result(6.0)
    assert (link.take_packets(), link.take_packets()) == ([(1.0, b"a")], [])
    link.close()
    asked = [("release_result", 6.0)] if kind is Mover else []
    assert inside.asked == [
        *(
            ("receive", 1.0),
            ("send", 2.0, command),
            ("poll", 4.0),
        ),
        *(("publish_tick", tick), ("release", 5.0), *asked, ("close",)),
    ]
    assert found == (None if kind is Mover else Release("line", ReleaseState.NOT_HELD))
    if kind is Mover:
        inside.result = Release("line", ReleaseState.CONFIRMED, "a report")  # type: ignore[attr-defined]
        link = WRAPPERS[wrapper](inside)
        assert link.release_result(8.0) == inside.result  # type: ignore[attr-defined]


def test_of_two_links_only_the_selected_instrument_passes() -> None:
    priority = SensorSelection()
    first, second = Recorded(), Recorded()
    second.name = "other"
    first.brings = [HeadingSample(1.0, 0.5, None, "HEHDT")]
    second.brings = [HeadingSample(1.0, 0.6, None, "HEHDT"), HelmSample(1.0, True, "", "other")]
    links = [SelectingLink(link, priority) for link in (first, second)]  # type: ignore[arg-type]
    assert links[0].receive(1.0) == first.brings
    assert links[1].receive(1.0) == second.brings[1:]


@pytest.mark.parametrize("call", ["receive", "send", "poll", "publish_tick"])
def test_a_line_that_breaks_in_any_call_is_left_released_and_said_once(call: str) -> None:
    inside = Mover()
    ends = [inside]

    def opener() -> Any:
        if not ends:
            raise LinkError("line: still gone; look")
        return ends.pop()

    kept = ReconnectingLink("line", True, opener, at_once)
    inside.packets = [(0.5, b"before")]
    inside.fails = LinkError("line: pulled; plug it in and start again")
    arguments = {
        "send": (2.0, None),
        "publish_tick": (SimpleNamespace(now=2.0),),
    }
    found = getattr(kept, call)(*arguments.get(call, (2.0,)))
    said = "line: pulled; it is opened again as soon as it is there"
    news = found if call == "receive" else kept.receive(2.5)
    lost = AlarmSample(2.0, AlarmEvent("line_lost", said), "line line")
    assert news == [HelmSample(2.0, False, "line lost: line: pulled", "line"), lost]
    assert inside.asked[-3:] == [("release", 2.0), ("release_result", 2.0), ("close",)]
    assert kept.release_result(2.6) == Release("line", ReleaseState.LOST), "nothing showed what became of the rudder"
    assert kept.trouble == said and kept.take_packets() == [(0.5, b"before")] and kept.fileno() == -1
    assert kept.receive(2.9) == []
    kept.release(3.0)  # nothing is there, and nothing is raised


def test_what_became_of_the_rudder_is_remembered_where_the_link_knew_it() -> None:
    inside = Mover()
    inside.result = Release("line", ReleaseState.CONFIRMED, "a report")
    kept = ReconnectingLink("line", True, lambda: inside, lambda work: None)  # type: ignore[arg-type, return-value]
    inside.fails = LinkError("gone")
    kept.poll(1.0)
    assert kept.release_result(2.0) == inside.result


@pytest.mark.parametrize("delay", [0.0, 0.9, 5.0])
def test_a_broken_link_is_reopened_a_second_later(delay: float) -> None:
    inside, tried = Recorded(), []
    link: Any = inside
    waiting: list[Callable[[], None]] = []
    kept = ReconnectingLink("radio", True, lambda: link, lambda work: (tried.append(now), waiting.append(work))[0])
    now = 10.0
    inside.brings = [HelmSample(9.0, True, "", "line"), AlarmSample(9.0, other("low"), "battery")]
    kept.receive(now)
    inside.lost = other("gone; look")  # type: ignore[attr-defined]
    said = kept.receive(now)
    assert [each.source for each in said if isinstance(each, HelmSample) and not each.available] == ["line", "radio"]
    assert AlarmSample(10.0, None, "battery") in said
    for step in range(12):
        now = 10.0 + 0.1 * step
        assert kept.receive(now) == []
    assert tried == [pytest.approx(11.0)]
    link = Recorded()
    now = 11.0 + delay
    waiting.pop()()
    assert kept.receive(now) == [HelmSample(now, True, "", "radio"), AlarmSample(now, None, "radio line")]
    assert kept.fileno() == 17 and kept.trouble == "" and len(tried) == 1


def test_both_links_are_closed_at_the_end_that_in_use_and_the_one_just_opened() -> None:
    first, second = Recorded(), Recorded()
    ends: list[Any] = [second, first]
    kept = ReconnectingLink("line", True, lambda: ends.pop(), at_once)
    first.fails = LinkError("gone")
    kept.poll(1.0)
    assert kept.receive(2.5) == [
        HelmSample(1.0, False, "line lost: gone", "line"),
        AlarmSample(1.0, AlarmEvent("line_lost", kept.trouble), "line line"),
    ]
    assert first.asked.count(("close",)) == 1 and second.asked == []
    kept.close()
    assert second.asked == [("close",)]
    kept.close()
    assert second.asked == [("close",)] and kept.fileno() == -1
