"""From a vessel file and URLs to the links of a run, set up for the boat and opened."""

from __future__ import annotations

import math
import sys
import zlib
from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TextIO

from autopilot import __version__
from autopilot.errors import InputError, RefusedError
from autopilot.estimation.sensor_selection import SelectionSettings, SensorSelection, SourceRule
from autopilot.guidance.plotter import PlotterGuide
from autopilot.links.alarm_outputs import RELAY_MOST, Bell, SwitchFile, VehicleSounder
from autopilot.links.base import Link, Transport, close_all
from autopilot.links.drives import DRIVES, DriveLink, DriveLinkSettings, DriveSettings, drive_of
from autopilot.links.ground_station.access import LOOKING_ONLY, AccessPolicy, AccessRules
from autopilot.links.mavlink.requests import MODES
from autopilot.links.mavlink.signing import Signing
from autopilot.links.reconnect import ReconnectingLink, SelectingLink
from autopilot.links.rudder_order import FollowSettings
from autopilot.links.transports.medium import Network, network_of
from autopilot.links.url import FORWARD_OPTIONS, NETWORKS, LinkUrl, RecordingTransport, open_transport, parse_url
from autopilot.models.steering_gear import Valve
from autopilot.runtime.build import follow_of, radians_or_unlimited
from autopilot.supervision.supervisor import STEERING_ACTIONS
from autopilot.vessel.schema import Valves, Vessel

if TYPE_CHECKING:
    # what speaks one protocol is loaded where a link speaks it: a pilot that has died must steer again soon
    from autopilot.links.ground_station.commands import Commands
    from autopilot.links.ground_station.station_service import ParameterStore
    from autopilot.links.mavlink.router import Router
    from autopilot.links.mavlink.vehicle import CompanionSettings
    from autopilot.links.n2k.session import Helm, N2kSettings
    from autopilot.links.nmea.link import NmeaSettings
    from autopilot.links.north import Variation

HEADING_STALE_SHARE = 0.6
"""Of the fail-safe's patience with a silent compass: by then another compass has taken over."""


def selection_of(vessel: Vessel) -> SelectionSettings:
    """Return which of the vessel's instruments are selected."""
    sensors = vessel.sensors
    limit = sensors.heading_monitor_deg
    return SelectionSettings(
        rules=tuple(SourceRule(*rule) for rule in sensors.priority),
        stale=sensors.source_timeout_s,
        heading_stale=HEADING_STALE_SHARE * vessel.failsafe.heading_timeout_s,
        disagree=math.inf if limit is None else math.radians(limit),
        jump=radians_or_unlimited(vessel.alarms.heading_jump_deg),
        frozen=vessel.alarms.frozen_heading,
        compass=sensors.compass,
    )


def _follow_on(vessel: Vessel, url: LinkUrl) -> FollowSettings:
    """Return what is asked of the rudder on a link: one that carries no orders may be left without for any time."""
    follow = follow_of(vessel)
    return follow if url.options.steers else follow._replace(patience=math.inf)


def nmea_settings_of(vessel: Vessel, url: LinkUrl) -> NmeaSettings:
    """Return how to read and steer the vessel on an NMEA link."""
    from autopilot.links.nmea.link import NmeaSettings

    sensors = vessel.sensors
    return NmeaSettings(
        baud=url.baud,
        heading_latency=sensors.heading_latency_s,
        variation=None if sensors.variation_deg is None else math.radians(sensors.variation_deg),
        deviation=tuple((math.radians(at), math.radians(deviation)) for at, deviation in sensors.deviation_deg),
        steers=url.options.steers,
        follow=_follow_on(vessel, url),
        sends=url.options.sends,
        talker=url.options.talker,
        magnetic=sensors.magnetic,
    )


def variation_of(vessel: Vessel, *, by_model: bool = True) -> Variation:
    """Return what the vessel file says of the magnetic variation. InputError where its model cannot be had.

    by_model: False where no compass takes a variation, and the file's own is shown alone."""
    from autopilot.links.north import Variation

    degrees = vessel.sensors.variation_deg
    if degrees is not None or not (by_model and vessel.sensors.earth_field):
        return Variation(None if degrees is None else math.radians(degrees))
    from autopilot.links.north import earth_field

    return Variation(None, earth_field(datetime.now(UTC).date()))


def n2k_settings_of(vessel: Vessel, url: LinkUrl) -> N2kSettings:
    """Return how to read and steer the vessel on NMEA 2000."""
    from autopilot.links.n2k.node import Device
    from autopilot.links.n2k.session import N2kSettings

    variation = vessel.sensors.variation_deg
    return N2kSettings(
        heading_latency=vessel.sensors.heading_latency_s,
        variation=None if variation is None else math.radians(variation),
        steers=url.options.steers,
        follow=_follow_on(vessel, url),
        magnetic=vessel.sensors.magnetic,
        rudder_limit=math.radians(vessel.rudder.angle_max_deg),
        device=Device(machine_number(), __version__),
        takes_orders=url.options.orders,
    )


def machine_number() -> int:
    """Return a number of 21 bits that tells this machine from others, from its id; 1 where it has none."""
    try:
        return zlib.crc32(Path("/etc/machine-id").read_bytes()) & 0x1FFFFF
    except OSError:
        return 1


def drive_settings_of(vessel: Vessel) -> DriveSettings:
    """Return what the scale of the vessel's rudder drive means."""
    drive, rudder = vessel.drive, vessel.rudder
    return DriveSettings(
        angle_at_full=math.radians(drive.angle_at_full_deg or rudder.angle_max_deg),
        amidships=drive.amidships,
        reversed=drive.reversed,
        rate=math.radians(max(rudder.rates_deg_s)),
        stop=math.radians(rudder.angle_max_deg),
        current_max=drive.current_max_a,
        channel=drive.channel,
        device=drive.device,
        dead_band=math.radians(rudder.dead_band_deg),
        order_rate_hz=drive.rate_hz,
        valve=valve_of(vessel),
        sensor_channel=None if drive.valve is None else drive.valve.sensor_channel,
    )


def valve_of(vessel: Vessel) -> Valve | None:
    """Return the on/off valves of the vessel's steering gear; None where its rate is unlimited, which no pump's is."""
    valves, (port, starboard) = vessel.drive.valve or Valves(), vessel.rudder.rates_deg_s
    if math.isinf(max(port, starboard)):
        return None
    return Valve(math.radians(port), math.radians(starboard), valves.opening_s, valves.coasting_s, valves.least_pulse_s)


def access_rules_of(vessel: Vessel) -> AccessRules:
    """Return which ground stations are heard, and how much of them."""
    security = vessel.security
    return AccessRules(
        frozenset(security.allow_systems),
        security.commands_per_s,
        security.writes_per_s,
        security.orders_without_key,
    )


def networks_of(vessel: Vessel) -> tuple[Network, ...]:
    """Return the networks that may come to listening links; none: all."""
    return tuple(network_of(text) for text in vessel.security.allow_addresses)


def to_stderr(sentence: str) -> None:
    """Tell whoever started the program."""
    print(sentence, file=sys.stderr)


class LinkOptions(NamedTuple):
    """Choices of one run: steer with the ground station's id, and which vehicle to latch on to (None: the first).

    `guide` takes what a chart plotter says on NMEA links, and `helm` carries out what is ordered there; `variation` is
    what they know of it together, None: each for itself.  `selection` chooses among their instruments, None: one that
    is made.  `signing` signs MAVLink links.
    `forward`: URLs of ground stations that see the flight controller through us; `policy`: which of all ground stations
    are heard, None: those of AccessRules().
    `with_other_pilot`: engage though another pilot steers the boat.
    `reconnect`: lines that are lost, or not there yet, are opened again.
    `opened`: returns what an opener opens, in its own time.  `arrivals`: takes the lines, to say what came over them.
    `warn`: is called with what somebody should know who expects orders to be taken.
    `has_compass`: headings may come over other links than the flight controller's, so slow ones there are no bar.
    """

    as_gcs: bool = False
    vehicle_system: int | None = None
    guide: PlotterGuide | None = None
    helm: Helm | None = None
    variation: Variation | None = None
    selection: SensorSelection | None = None
    signing: Signing | None = None
    forward: tuple[str, ...] = ()
    policy: AccessPolicy | None = None
    reconnect: bool = False
    with_other_pilot: bool = False
    opened: Callable[[Callable[[], Link]], Link] = lambda opener: opener()
    arrivals: dict[str, RecordingTransport] | None = None
    warn: Callable[[str], None] = to_stderr
    has_compass: bool = False


class _Opening(NamedTuple):
    """A link to be opened: its URL, whether rudder orders leave there, and what opens it."""

    url: str
    steers: bool
    opener: Callable[[], Link]


def _opened(openings: Iterable[_Opening], options: LinkOptions) -> list[Link]:
    """Return the opened links; where one fails the others are closed again. Raises LinkError."""
    links: list[Link] = []
    try:
        for each in openings:
            link = ReconnectingLink(*each) if options.reconnect else options.opened(each.opener)
            links.append(link)
    except BaseException:
        close_all(links)
        raise
    return links


def shared_by_links(vessel: Vessel, urls: Sequence[str], options: LinkOptions) -> LinkOptions:
    """Return the options with what the links of a run share: the variation, and which instrument is selected."""
    has_compass = any(KINDS[parse_url(url).protocol].has_compass for url in urls)
    known = options.variation or (variation_of(vessel) if has_compass else None)
    chosen = options.selection or SensorSelection(selection_of(vessel))
    return options._replace(has_compass=has_compass, variation=known, selection=chosen)


def build_links(vessel: Vessel, urls: Sequence[str], options: LinkOptions = LinkOptions()) -> list[Link]:  # noqa: B008
    """Return the links of all `urls`, opened, and behind them those of `options.forward`.

    Raises RefusedError where they cannot do what the vessel's fail-safe asks for, InputError where there is nothing to
    forward, LinkError where one cannot be opened; then the others are closed again.
    """
    refuse_failsafe(vessel, urls)
    parsed = [parse_url(url) for url in urls]
    if options.selection is None:
        options = shared_by_links(vessel, urls, options)
    router, behind = _forwarding(vessel, parsed, options) if options.forward else (None, [])
    links = _opened([*(_to_boat(vessel, url, options, router) for url in parsed), *behind], options)
    if len(urls) == 1 and parsed[0].protocol == "mavlink" and not vessel.sensors.priority:
        return links  # one vehicle with one compass: nothing to choose
    count, selection = len(urls), options.selection
    assert selection is not None
    return [*(SelectingLink(link, selection) for link in links[:count]), *links[count:]]


def open_links(vessel: Vessel, urls: Sequence[str], options: LinkOptions) -> list[Link]:
    """Return the opened links of all `urls`, each for itself: nothing chooses among them. Raises LinkError."""
    return _opened([_to_boat(vessel, parse_url(url), options) for url in urls], options)


def _to_boat(vessel: Vessel, url: LinkUrl, options: LinkOptions, router: Router | None = None) -> _Opening:
    return _Opening(url.text, url.options.steers, partial(build_link, vessel, url.text, options, router))


def build_link(vessel: Vessel, url: str, options: LinkOptions, router: Router | None = None) -> Link:
    """Return the opened link of a URL, set up for the vessel and tapped for `router`. Raises LinkError."""
    parsed = parse_url(url)
    return KINDS[parsed.protocol].build(vessel, parsed, options, router)


def _transport(vessel: Vessel, url: LinkUrl, options: LinkOptions) -> Transport:
    transport = open_transport(url, networks_of(vessel))
    if options.arrivals is not None:
        transport = options.arrivals[url.text] = RecordingTransport(transport, url.protocol)
    return transport


def _nmea_2000(vessel: Vessel, url: LinkUrl, options: LinkOptions, router: Router | None) -> Link:
    """Return the link to an NMEA 2000 network: a CAN bus, which is no stream of bytes, or a gateway."""
    from autopilot.links.n2k.link import FORMS, BusLine, GatewayLine, N2kLink, open_bus

    line: BusLine | GatewayLine
    if url.protocol in FORMS:
        line = GatewayLine(_transport(vessel, url, options), FORMS[url.protocol]())
    else:
        line = BusLine(url.text, open_bus(url.text, url.host, url.path))
    settings = n2k_settings_of(vessel, url)._replace(with_other_pilot=options.with_other_pilot)
    known = options.variation or variation_of(vessel)
    return N2kLink(line, settings, options.guide, options.helm, known)


def _instruments(vessel: Vessel, url: LinkUrl, options: LinkOptions, router: Router | None) -> Link:
    from autopilot.links.nmea.link import NmeaLink

    known = options.variation or variation_of(vessel)
    settings = nmea_settings_of(vessel, url)._replace(with_other_pilot=options.with_other_pilot)
    return NmeaLink(_transport(vessel, url, options), settings, options.guide, known)


def _rudder_drive(vessel: Vessel, url: LinkUrl, options: LinkOptions, router: Router | None) -> Link:
    settings = DriveLinkSettings(url.baud, vessel.drive.rate_hz, follow_of(vessel))
    drive = drive_of(url.protocol, drive_settings_of(vessel))
    return DriveLink(_transport(vessel, url, options), drive, settings)


def companion_settings_of(vessel: Vessel, options: LinkOptions) -> CompanionSettings:
    """Return what the link to a flight controller goes by."""
    from autopilot.links.mavlink.vehicle import CompanionSettings

    helm = vessel.helm
    return CompanionSettings(
        rudder_at_full=math.radians(helm.rudder_at_full_pwm_deg or vessel.rudder.angle_max_deg),
        reversed=helm.reversed,
        method=helm.method,
        command_rate_hz=helm.rate_hz,
        attitude_rate_hz=vessel.control.rate_hz,
        heading_latency=vessel.sensors.heading_latency_s,
        heading_timeout=math.inf if options.has_compass else vessel.failsafe.heading_timeout_s,
        vehicle_system=options.vehicle_system,
        as_gcs=options.as_gcs,
        with_other_pilot=options.with_other_pilot,
        guided_speed_share=helm.guided_speed_share,
        offboard_speed=_or_nan(helm.offboard_speed_m_s),
        handover_mode=MODES[vessel.failsafe.firmware_mode] if vessel.failsafe.action == "firmware" else None,
        servo_us=helm.servo_us,
        angle_max=math.radians(vessel.rudder.angle_max_deg),
        drive=vessel.drive.kind,
        thrust_exponent=_or_nan(vessel.drive.thrust_exponent),
        astern_share=_or_nan(vessel.drive.astern_share),
        bow_channel=None if vessel.drive.bow_thruster is None else vessel.drive.bow_thruster.channel,
        bow_reversed=vessel.drive.bow_thruster is not None and vessel.drive.bow_thruster.reversed,
        battery_percent=-math.inf if vessel.alarms.battery_percent is None else vessel.alarms.battery_percent,
    )


def _companion(vessel: Vessel, url: LinkUrl, options: LinkOptions, router: Router | None) -> Link:
    from autopilot.links.mavlink.companion import CompanionLink

    transport, settings = _transport(vessel, url, options), companion_settings_of(vessel, options)
    signing = options.signing.link() if options.signing else None
    if router is not None:
        from autopilot.links.mavlink.router import RoutedTransport

        transport = RoutedTransport(transport, router, signing)
    return CompanionLink(transport, settings, signing, alarm_outputs_of(vessel)[1])


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value


WITH_VANE = frozenset(("nmea", *NETWORKS))
WIND_VANE = "a wind vane on an nmea: link (MWV) or an n2k: link (130306)"
WITH_WIND = WITH_VANE | {"mavlink"}
"""A flight controller's vane may be held to; it is none for a fail-safe, as its wind is lost with its headings."""


class LinkKind(NamedTuple):
    """A kind of link, by what is spoken: what builds an opened one of a parsed URL, and whether its headings come from
    a compass of the boat's own, magnetic ones among them."""

    build: Callable[[Vessel, LinkUrl, LinkOptions, Router | None], Link]
    has_compass: bool = False


KINDS = {
    "mavlink": LinkKind(_companion),
    "nmea": LinkKind(_instruments, has_compass=True),
    **dict.fromkeys(NETWORKS, LinkKind(_nmea_2000, has_compass=True)),
    **dict.fromkeys(DRIVES, LinkKind(_rudder_drive)),
}


def _forwarding(vessel: Vessel, urls: Sequence[LinkUrl], options: LinkOptions) -> tuple[Router, list[_Opening]]:
    """Return what passes MAVLink on, and the links of `options.forward` to ground stations behind us; `urls` are those
    to the boat. Raises InputError where there is nothing to forward."""
    from autopilot.links.mavlink.router import ForwardLink, Router, budget_for, filter_of

    bauds = [url.baud for url in urls if url.protocol == "mavlink"]
    if not bauds:
        raise InputError("--forward passes MAVLink on, and no --link brings any; add the flight controller's link")
    router, budget, networks = Router(), budget_for(min(filter(None, bauds), default=0)), networks_of(vessel)

    def opening(url: str) -> _Opening:
        parsed = parse_url(url, FORWARD_OPTIONS)
        if parsed.protocol != "mavlink":
            raise InputError(f"--forward {url}: ground stations speak MAVLink; write it like udpout:127.0.0.1:14550")
        signing = options.signing.link() if options.signing else None
        access = options.policy.link() if options.policy else None
        filter_of(parsed)  # a message that is not there is said now, not when the line is

        def opened() -> Link:
            transport = open_transport(parsed, networks)
            link = ForwardLink(transport, router, budget, signing, access, filter_of(parsed))
            if not link.takes_orders:
                options.warn(f"--forward {url}: {LOOKING_ONLY}")
            return link

        return _Opening(url, False, opened)

    return router, [opening(url) for url in options.forward]


class Stations(NamedTuple):
    """Ground stations that see the pilot as a boat: where, and our system id there."""

    urls: tuple[str, ...]
    system: int = 1


def build_station_links(
    vessel: Vessel, stations: Stations, commands: Commands, store: ParameterStore, options: LinkOptions
) -> list[Link]:
    """Return the opened links to ground stations, over which `commands` are carried out and the numbers of `store` set.

    vessel: as it is stored. Raises LinkError.
    """
    from autopilot.links.ground_station.boat_link import BoatLink
    from autopilot.links.ground_station.file_server import metadata_files
    from autopilot.links.ground_station.station_service import ParameterServer
    from autopilot.vessel.parameters import parameters_of

    networks, policy = networks_of(vessel), options.policy or AccessPolicy()
    files = metadata_files(parameters_of(vessel), __version__)

    def opened(url: str) -> Link:
        signing = options.signing.link() if options.signing is not None else None
        server = ParameterServer(store, files)
        link = BoatLink(open_transport(url, networks), commands, server, stations.system, signing, policy.link())
        if not link.takes_orders:
            options.warn(f"--serve {url}: {LOOKING_ONLY}")
        return link

    return _opened((_Opening(url, False, partial(opened, url)) for url in stations.urls), options)


def refuse_failsafe(vessel: Vessel, urls: Sequence[str]) -> None:
    """Raise RefusedError where the vessel's fail-safe asks for what no link of `urls` can do."""
    action, protocols = vessel.failsafe.action, {parse_url(url).protocol for url in urls}
    steers_itself, is_px4 = vessel.helm.firmware_steers, vessel.helm.method == "offboard"
    if vessel.sensors.magnetic and "mavlink" in protocols:
        raise RefusedError(
            f"vessel {vessel.name!r}: sensors.magnetic is for compasses, and a flight controller's headings are true; "
            "leave it out, or that --link"
        )
    if action == "firmware" and "mavlink" not in protocols:
        needed = "a flight controller that takes modes; add its --link, or choose amidships, hold or release"
    elif action == "windward" and protocols.isdisjoint(WITH_VANE):
        needed = f"{WIND_VANE}; add that --link, or choose amidships, hold or release"
    elif action in STEERING_ACTIONS and steers_itself:
        instead = "release or hold" if is_px4 else "firmware"
        needed = f"a rudder that is ours, and with --steer {vessel.helm.method} the firmware has it; choose {instead}"
    elif action == "firmware" and is_px4:
        needed = "ArduRover, for PX4's mode is a human's to change; choose release, and set COM_OBL_RC_ACT"
    else:
        return
    raise RefusedError(f"vessel {vessel.name!r}: failsafe.action {action} needs {needed}")


def refuse_wind_hold(urls: Sequence[str]) -> None:
    """Raise RefusedError where no link of `urls` could bring a wind to hold the angle of."""
    if WITH_WIND.isdisjoint(parse_url(url).protocol for url in urls):
        raise RefusedError(f"--engage wind needs {WIND_VANE}, or ArduRover's own (WNDVN_TYPE); add that --link")


def alarm_outputs_of(vessel: Vessel, terminal: TextIO | None = None) -> tuple[list[Link], VehicleSounder]:
    """Return what makes the vessel's alarms heard here, and what asks the vehicle to. Raises InputError.

    `terminal`: whose bell rings; None: there is none.
    """
    links: list[Link] = []
    tune, relay = False, None
    for output in vessel.alarms.outputs:
        kind, _, where = output.partition(":")
        if output == "bell":
            links.extend([Bell(terminal)] if terminal is not None else [])
        elif output == "tune":
            tune = True
        elif kind == "relay" and where.isdecimal() and int(where) <= RELAY_MOST:
            relay = int(where)
        elif kind == "file" and where:
            links.append(SwitchFile(Path(where)))
        else:
            raise InputError(
                f"vessel {vessel.name!r}: alarms.outputs has {output!r}; allowed are bell, tune, relay:0 to "
                f"relay:{RELAY_MOST} and file:PATH"
            )
    return links, VehicleSounder(tune, relay)
