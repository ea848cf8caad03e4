"""A log played onto links at its own pace or another, as if the boat sailed again: to look at, never to steer by.

A log of ours is shown as `run --serve` and `send=` on an NMEA link would have shown it. Of any other .tlog the messages
that were for everybody are sent as they were recorded; what was addressed to somebody, orders among it, is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.guidance.track import TrackGuide
from autopilot.links.base import Link, Transport
from autopilot.links.ground_station.boat_link import BoatLink
from autopilot.links.ground_station.commands import DENIED, Commands
from autopilot.links.ground_station.mission import Mission
from autopilot.links.ground_station.station_service import ParameterServer
from autopilot.links.mavlink.frames import EVERYBODY, TlogPackets, identity_of, target_of
from autopilot.links.mavlink.signing import Signing
from autopilot.links.nmea.link import NmeaLink
from autopilot.links.url import LinkUrl, open_transport, parse_url
from autopilot.logs.own_log import is_own
from autopilot.logs.reading import bytes_of
from autopilot.logs.tlog import is_tlog
from autopilot.runtime.build_links import nmea_settings_of
from autopilot.runtime.log_files import following_parts
from autopilot.runtime.machine import Clock
from autopilot.runtime.record import Log, read_logs
from autopilot.signals import Tick
from autopilot.vessel.file import parse_vessel
from autopilot.vessel.parameters import parameters_of, value_of
from autopilot.vessel.schema import Vessel

ORDERS = frozenset(
    {int(dialect.MAVLINK_MSG_ID_MANUAL_CONTROL), int(dialect.MAVLINK_MSG_ID_TUNNEL)}
    | {int(dialect.MAVLINK_MSG_ID_SETUP_SIGNING)}
)
"""Never sent, whomever they name: what moves a rudder, our own records, keys."""
LONGEST_WAIT_S = 0.1
REFUSAL = "this is a recording: nothing can be ordered"


class RecordedCommands(Commands):
    """Refuses every order, with the reason."""

    def __init__(self) -> None:
        super().__init__(None, armed=False, mission=Mission(TrackGuide()))  # type: ignore[arg-type]

    def execute(self, command: int, parameters: tuple[float, ...], tick: Tick | None) -> int:
        """Refuse."""
        self.refusal = REFUSAL
        return DENIED

    def set_mode(self, mode: int, tick: Tick | None) -> int:
        """Refuse."""
        self.refusal = REFUSAL
        return DENIED


class RecordedNumbers:
    """The parameters of the vessel in a log: read, never set."""

    revision = 0

    def __init__(self, vessel: Vessel) -> None:
        self._values = {each.name: value_of(vessel, each) for each in parameters_of(vessel)}

    @property
    def names(self) -> tuple[str, ...]:
        """All names."""
        return tuple(self._values)

    def get(self, name: str) -> float:
        """Return the value as it was at the beginning."""
        return self._values[name]

    def set(self, name: str, value: float) -> str:
        """Refuse."""
        return REFUSAL


def replay_onto(
    path: Path, urls: Sequence[str], clock: Clock, stop: Callable[[], bool], signing: Signing | None = None
) -> str:
    """Play the log at `path` onto links, in the time of `clock`, until its end or `stop`; return what to say.

    Raises InputError where the log or a link cannot be used for it, LinkError where one cannot be opened.
    """
    data = bytes_of(str(path))
    if not is_tlog(data):
        raise InputError(f"{path}: is no .tlog; others are looked at with autopilot log info and export.")
    links = [parse_url(url) for url in urls]
    if not is_own(data):
        return _play_messages(path, data, links, clock, stop)
    count = 0
    for log in read_logs(*following_parts(path)):
        count += _play_ticks(path, log, links, clock, stop, signing)
    return f"{count} ticks shown"


def _play_ticks(
    path: Path, log: Log, urls: Sequence[LinkUrl], clock: Clock, stop: Callable[[], bool], signing: Signing | None
) -> int:
    text = log.header.get("vessel")
    if not isinstance(text, str):
        raise InputError(f"{path}: its header names no vessel; it was written by another version")
    vessel = parse_vessel(text, f"{path} (header)")
    links: list[Link] = []
    count = 0
    try:
        for url in urls:
            links.append(_shown_on(vessel, url, signing))  # noqa: PERF401 - what is open must be closed on error
        ahead = log.ticks[0].now - clock.now() if log.ticks else 0.0
        for tick in log.ticks:
            while (left := tick.now - ahead - clock.now()) > 0.0 and not stop():
                clock.wait(
                    [link.fileno() for link in links if link.fileno() >= 0], clock.now() + min(left, LONGEST_WAIT_S)
                )
                _turn(links, clock.now() + ahead)
            if stop():
                break
            for link in links:
                link.publish_tick(tick)
            _turn(links, tick.now)
            count += 1
    finally:
        for link in links:
            link.release(log.ticks[-1].now if log.ticks else 0.0)
            link.close()
    return count


def _turn(links: Sequence[Link], now: float) -> None:
    for link in links:
        link.receive(now)
        link.poll(now)
        link.take_packets()


def _shown_on(vessel: Vessel, url: LinkUrl, signing: Signing | None) -> Link:
    if url.protocol == "mavlink":
        ours = signing.link() if signing is not None else None
        return BoatLink(open_transport(url), RecordedCommands(), ParameterServer(RecordedNumbers(vessel)), signing=ours)
    if url.protocol == "nmea":
        if not url.options.sends:
            raise InputError(f"--link {url.text}: say what to send, such as ?send=HDT:5,ROT:5,RSA:5,HTD:1")
        return NmeaLink(open_transport(url), nmea_settings_of(vessel, url)._replace(steers=False))
    raise InputError(f"--link {url.text}: a recording is played onto MAVLink and NMEA 0183 links only")


def _play_messages(path: Path, data: bytes, urls: Sequence[LinkUrl], clock: Clock, stop: Callable[[], bool]) -> str:
    for url in urls:
        if url.protocol != "mavlink":
            raise InputError(f"--link {url.text}: {path} holds MAVLink messages; only our own logs are played as NMEA")
    transports: list[Transport] = []
    sent = left_out = 0
    try:
        for url in urls:
            transports.append(open_transport(url))  # noqa: PERF401 - what is open must be closed on error
        begin: float | None = None
        for stamp, packet in _packets(data):
            if stop():
                break
            if begin is None:
                begin = stamp - clock.now()
            if target_of(packet) != EVERYBODY or identity_of(packet) in ORDERS:
                left_out += 1
                continue
            while (left := stamp - begin - clock.now()) > 0.0 and not stop():
                clock.wait([], clock.now() + min(left, LONGEST_WAIT_S))
            for transport in transports:
                transport.receive()
                transport.send(packet)
            sent += 1
    finally:
        for transport in transports:
            transport.close()
    return f"{sent} messages sent; {left_out} that were addressed to somebody were left out"


def _packets(data: bytes) -> Iterator[tuple[float, bytes]]:
    return ((stamp, packet) for stamp, _, packet in TlogPackets(data))
