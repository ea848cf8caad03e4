"""From a vessel file and URLs to the links of a run, set up for the boat and opened."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple, TextIO

from autopilot.errors import InputError, RefusedError
from autopilot.estimation.sensor_selection import SelectionSettings, SensorSelection, SourceRule
from autopilot.guidance.plotter import PlotterGuide
from autopilot.links.alarm_outputs import RELAY_MOST, Bell, SwitchFile, VehicleSounder
from autopilot.links.arrivals import HeardTransport
from autopilot.links.base import Link
from autopilot.links.drives.base import Drive, DriveSettings
from autopilot.links.drives.drive_link import DriveLink, DriveLinkSettings
from autopilot.links.drives.jrk import JrkG2
from autopilot.links.drives.maestro import Maestro
from autopilot.links.drives.pypilot_motor import PypilotMotor
from autopilot.links.ground_station.access import LOOKING_ONLY, AccessPolicy, AccessRules, Budget, LinkAccess
from autopilot.links.mavlink.companion import CompanionLink
from autopilot.links.mavlink.requests import MODES
from autopilot.links.mavlink.router import ForwardLink, RoutedTransport, Router, budget_for
from autopilot.links.mavlink.signing import LinkSigning, Signing
from autopilot.links.mavlink.vehicle import CompanionSettings
from autopilot.links.n2k import N2kLink, N2kSettings, open_bus
from autopilot.links.nmea.link import NmeaLink, NmeaSettings
from autopilot.links.reconnect import ReconnectingLink, SelectingLink
from autopilot.links.rudder_follow import FollowSettings
from autopilot.links.transports.sockets import Network, network_of
from autopilot.links.url import LinkUrl, open_transport, parse_url
from autopilot.runtime.build import follow_of, radians_or_unlimited
from autopilot.supervision.supervisor import STEERING_ACTIONS
from autopilot.vessel.schema import Vessel

HEADING_STALE_SHARE = 0.6
"""Of the fail-safe's patience with a silent compass: by then another compass has taken over."""


def selection_of(vessel: Vessel) -> SelectionSettings:
    """Return which of the vessel's instruments are believed."""
    sensors = vessel.sensors
    limit = sensors.heading_monitor_deg
    return SelectionSettings(
        rules=tuple(SourceRule(*rule) for rule in sensors.priority),
        stale=sensors.source_timeout_s,
        heading_stale=HEADING_STALE_SHARE * vessel.failsafe.heading_timeout_s,
        disagree=math.inf if limit is None else math.radians(limit),
        jump=radians_or_unlimited(vessel.alarms.heading_jump_deg),
        frozen=vessel.alarms.frozen_heading,
    )


def _follow_on(vessel: Vessel, url: LinkUrl) -> FollowSettings:
    """Return what is asked of the rudder on a link: one that carries no orders may be left without for any time."""
    follow = follow_of(vessel)
    return follow if url.options.steers else follow._replace(patience=math.inf)


def nmea_settings_of(vessel: Vessel, url: LinkUrl) -> NmeaSettings:
    """Return how to read and steer the vessel on an NMEA link."""
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


def n2k_settings_of(vessel: Vessel, url: LinkUrl) -> N2kSettings:
    """Return how to read and steer the vessel on NMEA 2000."""
    variation = vessel.sensors.variation_deg
    return N2kSettings(
        heading_latency=vessel.sensors.heading_latency_s,
        variation=None if variation is None else math.radians(variation),
        steers=url.options.steers,
        follow=_follow_on(vessel, url),
        magnetic=vessel.sensors.magnetic,
    )


DRIVES: dict[str, Callable[[DriveSettings], Drive]] = {"pypilot": PypilotMotor, "jrk": JrkG2, "maestro": Maestro}


def drive_settings_of(vessel: Vessel) -> DriveSettings:
    """Return what the scale of the vessel's rudder drive means."""
    drive, rudder = vessel.drive, vessel.rudder
    return DriveSettings(
        angle_at_full=math.radians(drive.angle_at_full_deg or rudder.angle_max_deg),
        amidships=drive.amidships,
        reversed=drive.reversed,
        rate=radians_or_unlimited(rudder.rate_max_deg_s),
        stop=math.radians(rudder.angle_max_deg),
        current_max=drive.current_max_a,
        channel=drive.channel,
        device=drive.device,
    )


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


def opened_now(opener: Callable[[], Link]) -> Link:
    """Return what `opener` opens, at the first try."""
    return opener()


class LinkOptions(NamedTuple):
    """Choices of one run: steer with the ground station's id, and which vehicle to latch on to (None: the first).

    `guide` takes what a chart plotter says on NMEA links; `signing` signs MAVLink links.
    `forward`: URLs of ground stations that see the flight controller through us; `policy`: which of them are heard.
    `with_other_pilot`: engage though another pilot steers the boat.
    `reconnect`: lines that are lost, or not there yet, are opened again.
    `opened`: returns what an opener opens, in its own time.  `heard`: takes the lines, to say what came over them.
    `has_compass`: headings may come over other links than the flight controller's, so slow ones there are no bar.
    """

    as_gcs: bool = False
    vehicle_system: int | None = None
    guide: PlotterGuide | None = None
    signing: Signing | None = None
    forward: tuple[str, ...] = ()
    policy: AccessPolicy | None = None
    reconnect: bool = False
    with_other_pilot: bool = False
    opened: Callable[[Callable[[], Link]], Link] = opened_now
    heard: dict[str, HeardTransport] | None = None
    has_compass: bool = False


def build_link(vessel: Vessel, url: str, options: LinkOptions, router: Router | None = None) -> Link:
    """Return the opened link of a URL, set up for the vessel and tapped for `router`. Raises LinkError."""
    parsed = parse_url(url)
    if parsed.protocol == "n2k":
        return N2kLink(parsed.text, open_bus(parsed.text, parsed.host, parsed.path), n2k_settings_of(vessel, parsed))
    transport = open_transport(parsed, networks_of(vessel))
    if options.heard is not None:
        transport = HeardTransport(transport, parsed.protocol)
        options.heard[url] = transport
    if parsed.protocol == "nmea":
        return NmeaLink(transport, nmea_settings_of(vessel, parsed), options.guide)
    if parsed.protocol in DRIVES:
        settings_line = DriveLinkSettings(parsed.baud, vessel.drive.rate_hz, follow_of(vessel))
        return DriveLink(transport, DRIVES[parsed.protocol](drive_settings_of(vessel)), settings_line)
    helm = vessel.helm
    full_deg = helm.rudder_at_full_pwm_deg or vessel.rudder.angle_max_deg
    settings = CompanionSettings(
        rudder_at_full=math.radians(full_deg),
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
        handover_mode=MODES[vessel.failsafe.firmware_mode] if vessel.failsafe.action == "firmware" else None,
        servo_us=helm.servo_us,
        angle_max=math.radians(vessel.rudder.angle_max_deg),
        battery_percent=-math.inf if vessel.alarms.battery_percent is None else vessel.alarms.battery_percent,
    )
    signing = options.signing.link() if options.signing else None
    if router is not None:
        transport = RoutedTransport(transport, router, signing)
    return CompanionLink(transport, settings, signing, alarm_outputs_of(vessel)[1])


def build_forward_links(
    urls: Sequence[str], options: LinkOptions, router: Router, allow: Sequence[Network] = ()
) -> list[Link]:
    """Return the opened links of `options.forward` to ground stations behind us; `urls` are those to the boat.

    allow: networks from which they may come to listening links; none: all.

    Raises InputError where there is nothing to forward, LinkError where one cannot be opened.
    """
    bauds = [url.baud for url in map(parse_url, urls) if url.protocol == "mavlink"]
    if not bauds:
        raise InputError("--forward passes MAVLink on, and no --link brings any; add the flight controller's link")
    budget = budget_for(min((baud for baud in bauds if baud), default=0))
    links: list[Link] = []
    try:
        for url in options.forward:
            if parse_url(url).protocol != "mavlink":
                raise InputError(
                    f"--forward {url}: ground stations speak MAVLink; write it like udpout:127.0.0.1:14550"
                )
            signing = options.signing.link() if options.signing else None
            access = options.policy.link() if options.policy else None
            opener = partial(_forward_link, url, allow, router, budget, signing, access)
            links.append(ReconnectingLink(url, False, opener) if options.reconnect else options.opened(opener))
    except BaseException:
        for link in links:
            link.close()
        raise
    return links


def _forward_link(
    url: str,
    allow: Sequence[Network],
    router: Router,
    budget: Budget,
    signing: LinkSigning | None,
    access: LinkAccess | None,
) -> Link:
    link = ForwardLink(open_transport(url, allow), router, budget, signing, access)
    if not link.takes_orders:
        print(f"--forward {url}: {LOOKING_ONLY}", file=sys.stderr)
    return link


def refuse_failsafe(vessel: Vessel, urls: Sequence[str]) -> None:
    """Raise RefusedError where the vessel's fail-safe asks for what no link of `urls` can do."""
    action, protocols = vessel.failsafe.action, {parse_url(url).protocol for url in urls}
    steers_itself = vessel.helm.method == "guided"
    if vessel.sensors.magnetic and "mavlink" in protocols:
        raise RefusedError(
            f"vessel {vessel.name!r}: sensors.magnetic is for compasses, and a flight controller's headings are true; "
            "leave it out, or that --link"
        )
    if action == "firmware" and "mavlink" not in protocols:
        needed = "a flight controller that takes modes; add its --link, or choose amidships, hold or release"
    elif action == "windward" and "nmea" not in protocols:
        needed = "a wind vane on an nmea: link (MWV); add that --link, or choose amidships, hold or release"
    elif action in STEERING_ACTIONS and steers_itself:
        needed = "a rudder that is ours, and with helm.method guided the firmware has it; choose firmware"
    else:
        return
    raise RefusedError(f"vessel {vessel.name!r}: failsafe.action {action} needs {needed}")


def refuse_wind_hold(urls: Sequence[str]) -> None:
    """Raise RefusedError where no link of `urls` could bring a wind to hold the angle of."""
    if "nmea" not in {parse_url(url).protocol for url in urls}:
        raise RefusedError("--engage wind needs a wind vane on an nmea: link (MWV); add that --link")


def _kept(url: LinkUrl, opener: Callable[[], Link]) -> ReconnectingLink:
    steers = url.options.steers or url.protocol not in ("nmea", "n2k")
    return ReconnectingLink(url.text, steers, opener)


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


def build_links(vessel: Vessel, urls: Sequence[str], options: LinkOptions = LinkOptions()) -> list[Link]:  # noqa: B008
    """Return the links of all `urls`, opened; where one fails the others are closed again. Raises LinkError."""
    refuse_failsafe(vessel, urls)
    links: list[Link] = []
    router = Router() if options.forward else None
    options = options._replace(has_compass=any(parse_url(url).protocol in ("nmea", "n2k") for url in urls))
    try:
        for url in urls:
            opener = partial(build_link, vessel, url, options, router)
            links.append(_kept(parse_url(url), opener) if options.reconnect else options.opened(opener))
        behind = build_forward_links(urls, options, router, networks_of(vessel)) if router is not None else []
    except BaseException:
        for link in links:
            link.close()
        raise
    if len(urls) == 1 and parse_url(urls[0]).protocol == "mavlink" and not vessel.sensors.priority:
        return [*links, *behind]  # one vehicle with one compass: nothing to choose
    priority = SensorSelection(selection_of(vessel))
    return [*(SelectingLink(link, priority) for link in links), *behind]
