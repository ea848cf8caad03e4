"""From a vessel file to a Pilot: the only place where degrees become radians and parts are chosen by name."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import astuple
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TextIO

from autopilot.control import backstepping, sliding_heading
from autopilot.control.backstepping import BacksteppingGains, BacksteppingLaw
from autopilot.control.design import (
    LoopGains,
    Verdict,
    judge,
    linear_gains_backstepping,
    linear_gains_pid,
    linear_gains_sliding,
)
from autopilot.control.pid import PidGains, PidLaw
from autopilot.control.roll_damping import RollDamping
from autopilot.control.sliding_heading import SlidingGains, SlidingLaw
from autopilot.errors import InputError, RefusedError
from autopilot.estimation.heading_filter import FilterNoise
from autopilot.estimation.source_priority import PrioritySettings, SourcePriority, SourceRule
from autopilot.guidance.plotter import PlotterGuide
from autopilot.guidance.track import TrackSettings
from autopilot.guidance.turn import preset_rate, turn_limits
from autopilot.limits import RudderLimits
from autopilot.links.admission import Admission, Doors
from autopilot.links.alarm_outputs import RELAY_MOST, Bell, SwitchFile, VehicleSounder
from autopilot.links.base import Link
from autopilot.links.believed_link import BelievedLink
from autopilot.links.drives.base import Drive, DriveSettings
from autopilot.links.drives.drive_link import DriveLink, DriveLinkSettings
from autopilot.links.drives.jrk import JrkG2
from autopilot.links.drives.maestro import Maestro
from autopilot.links.drives.pypilot_motor import PypilotMotor
from autopilot.links.hand_back import MODES
from autopilot.links.kept_link import KeptLink
from autopilot.links.mavlink_companion import CompanionLink, CompanionSettings
from autopilot.links.n2k_link import N2kLink, N2kSettings, open_bus
from autopilot.links.nmea_link import NmeaLink, NmeaSettings
from autopilot.links.router import Router
from autopilot.links.router_links import ForwardLink, RoutedTransport, budget_for
from autopilot.links.rudder_follow import FollowSettings
from autopilot.links.signing import Signing
from autopilot.links.transports.sockets import Network, network_of
from autopilot.links.url import LinkUrl, open_transport, parse_url
from autopilot.models.norrbin import Norrbin, at_speed_ratio
from autopilot.models.steering_gear import SteeringGear
from autopilot.monitors import AlarmLimits
from autopilot.params.vessel import Vessel
from autopilot.pilot import HeadingLaw, Pilot, PilotConfig
from autopilot.safety import STEERING_ACTIONS, FailsafeAction
from autopilot.signals import NavState, Reference

if TYPE_CHECKING:
    from autopilot.identification.learning import Learner

SEA = math.radians(2.0)
GUST = math.radians(0.2)
DISTURBANCE_TIME = 0.5
"""What moves the boat like a rudder of this size [rad], correlated over this time [s]: the whole sea, or all but it."""
MODEL_ERROR = 0.1
"""The rudder's effect is uncertain by this share of it, as white noise [s^(1/2)]."""
MODEL_ERROR_UNSTABLE = 0.6
"""The same of a course-unstable boat, whose rudder and own moment nearly cancel. With 0.1 a boat with 30 % less rudder
than the model's swings by 12 deg on a straight course in calm water, with 0.6 by 0.3 deg."""
WAVE_CORNER_SHARE = 0.55
"""Waves quicker than this share of the steering loop's natural frequency are left alone: below it the rudder still
lessens them, above it rudder and waves get out of step (docs/wave_filter.md)."""
STEERAGE_SHARE = 0.1
"""Below this share of the model's speed a boat is not steered, where the file says nothing."""
HEADING_STALE_SHARE = 0.6
"""Of the fail-safe's patience with a silent compass: by then another compass has taken over."""
TRIAL_LAW = "trial"
"""In place of a law's name: trials order rudder angles and need no gains."""
BIAS_CHANGE = math.radians(2.0)
BIAS_CHANGE_IN_WAVES = math.radians(0.3)
BIAS_CHANGE_PUSHED = math.radians(5.0)
BIAS_TIME = 10.0
"""Wind and trim change by this much rudder [rad] in this time [s], or in two time constants if that is longer. Where
waves are filtered it may be slow: what is sudden is noticed as more than a wave, and then it is quick. With 2 deg in
place of 5 a boat turning 40 % better than its model swings to and fro after a minute with the rudder at its stop."""


def model_of(vessel: Vessel) -> Norrbin:
    """Return the identified model of the vessel file."""
    model = vessel.model
    return Norrbin(
        gain=model.K_1_s,
        time_constant=model.T_s,
        n3=model.n3_s2_rad2,
        n2=model.n2_s_rad,
        n1=model.n1,
        n0=model.n0_rad_s,
        reference_speed=model.reference_speed_m_s,
    )


def gear_of(vessel: Vessel) -> SteeringGear:
    """Return the steering gear of the vessel file."""
    rudder = vessel.rudder
    return SteeringGear(
        angle_max=math.radians(rudder.angle_max_deg),
        rate_max=_radians_or_unlimited(rudder.rate_max_deg_s),
        lag=rudder.lag_s,
        dead_band=math.radians(rudder.dead_band_deg),
        delay=rudder.delay_s,
    )


def limits_of(vessel: Vessel) -> RudderLimits:
    """Return what may be commanded: the file's limits, inside what the rudder can do."""
    gear = gear_of(vessel)
    limits = vessel.limits
    angle = gear.angle_max if limits.angle_max_deg is None else math.radians(limits.angle_max_deg)
    rate = _radians_or_unlimited(limits.rate_max_deg_s)
    return RudderLimits(min(angle, gear.angle_max), min(rate, gear.rate_max))


def noise_of(vessel: Vessel) -> FilterNoise:
    """Return the filter's noise: instruments from the file, sea and wind from the constants of this module."""
    model, sensors = vessel.model, vessel.sensors
    moment = model.K_1_s / model.T_s
    filtered = vessel.estimator.wave_filter == "auto"
    bias_time = max(BIAS_TIME, 2.0 * model.T_s)
    calm, bias = (GUST, BIAS_CHANGE_IN_WAVES) if filtered else (SEA, BIAS_CHANGE)
    return FilterNoise(
        heading=math.radians(sensors.heading_noise_deg) ** 2,
        rate=math.radians(sensors.rate_noise_deg_s) ** 2,
        acceleration=(moment * calm) ** 2 * DISTURBANCE_TIME,
        bias=bias * bias / bias_time,
        model_error=(MODEL_ERROR if model.n1 > 0.0 else MODEL_ERROR_UNSTABLE) if filtered else 0.0,
        waves=filtered,
        gust=(moment * SEA) ** 2 * DISTURBANCE_TIME,
        gust_bias=BIAS_CHANGE_PUSHED * BIAS_CHANGE_PUSHED / bias_time,
    )


def wave_corner_of(vessel: Vessel, law: str | None = None) -> float:
    """Return the frequency [rad/s] of waves that are half left alone; inf for trials, which go by the whole heading."""
    if law == TRIAL_LAW:
        return math.inf
    proportional = loop_gains_of(vessel, law).proportional
    return WAVE_CORNER_SHARE * math.sqrt(proportional * vessel.model.K_1_s / vessel.model.T_s)


class HoldRudder:
    """Stands where a law would, for trials: leaves the rudder where it was told to be."""

    name = TRIAL_LAW

    def reset(self, rudder: float) -> None:
        """Nothing to forget."""

    def update(self, model: Norrbin, reference: Reference, state: NavState, last_rudder: float, dt: float) -> float:
        """Return `last_rudder` [rad]."""
        return last_rudder


def law_of(vessel: Vessel, name: str | None = None) -> HeadingLaw:
    """Return the heading law `name` (the file's own choice when None) with the file's gains.

    Raises RefusedError where the file has no gains for it.
    """
    control = vessel.control
    chosen = name or control.law
    if chosen == TRIAL_LAW:
        return HoldRudder()
    if chosen == "backstepping" and control.backstepping is not None:
        gains = BacksteppingGains(*astuple(control.backstepping))
        return BacksteppingLaw(gains, vessel.model.reference_speed_m_s)
    if chosen == "pid" and control.pid is not None:
        return PidLaw(PidGains(control.pid.kp, control.pid.ki_1_s, control.pid.kd_s))
    if chosen == "sliding" and control.sliding is not None:
        sliding = control.sliding
        reach, boundary = math.radians(sliding.reach_deg_s2), math.radians(sliding.boundary_deg_s)
        return SlidingLaw(SlidingGains(sliding.slope_1_s, reach, boundary), vessel.model.reference_speed_m_s)
    raise RefusedError(
        f"vessel {vessel.name!r} has no gains for the law {chosen!r}: add control.{chosen} to the file, "
        f"or let `autopilot gains` work them out"
    )


def gains_in_force(vessel: Vessel, name: str | None = None, ratio: float = 1.0) -> tuple[float, ...]:
    """Return the law's own gains at `ratio` times the speed of the trial; the PID's are the same at every speed."""
    law = law_of(vessel, name)
    if isinstance(law, BacksteppingLaw):
        return backstepping.gains_at(law.gains, ratio)
    if isinstance(law, SlidingLaw):
        return sliding_heading.gains_at(law.gains, ratio)
    assert isinstance(law, PidLaw)
    return law.gains


def loop_gains_of(vessel: Vessel, name: str | None = None, ratio: float = 1.0) -> LoopGains:
    """Return the law's gains on heading error, rate and integral, about straight running.

    ratio: at so many times the speed of the trial.
    """
    model, gains = at_speed_ratio(model_of(vessel), ratio), gains_in_force(vessel, name, ratio)
    if isinstance(gains, BacksteppingGains):
        return linear_gains_backstepping(model, gains)
    if isinstance(gains, SlidingGains):
        return linear_gains_sliding(model, gains)
    assert isinstance(gains, PidGains)
    return linear_gains_pid(gains)


def verdict_of(vessel: Vessel, name: str | None = None, ratio: float = 1.0) -> Verdict:
    """Return the margins of the vessel's law with its rudder, and why it must not engage where it must not.

    ratio: at so many times the speed of the trial.
    """
    return judge(
        at_speed_ratio(model_of(vessel), ratio),
        gear_of(vessel),
        limits_of(vessel).rate_max,
        vessel.control.loop_delay_s,
        loop_gains_of(vessel, name, ratio),
    )


def build_pilot(vessel: Vessel, law: str | None = None, *, learns: bool = False) -> Pilot:
    """Return the pilot of a vessel, one that learns its model where asked for.

    Raises RefusedError where its gains must not be engaged on its rudder.
    """
    if law != TRIAL_LAW and (verdict := verdict_of(vessel, law)).refusal:
        raise RefusedError(f"vessel {vessel.name!r}: {verdict.refusal}")
    config = pilot_config(vessel, law)
    return Pilot(config, law_of(vessel, law), learner_of(vessel) if learns else None)


def learner_of(vessel: Vessel) -> Learner:
    """Return what learns the vessel's model while it sails. Raises RefusedError for a model with n2."""
    from autopilot.identification.learning import Learner

    if vessel.model.n2_s_rad:
        raise RefusedError(f"vessel {vessel.name!r}: --learn knows no model.n2_s_rad; set it to 0 or leave --learn out")
    return Learner(model_of(vessel))


def pilot_config(vessel: Vessel, law: str | None = None) -> PilotConfig:
    """Return what the pilot knows of the vessel that `law` (None: the file's own) is to steer."""
    failsafe, steerage = vessel.failsafe, vessel.control.steerage_m_s
    return PilotConfig(
        model=model_of(vessel),
        gear=gear_of(vessel),
        noise=noise_of(vessel),
        limits=limits_of(vessel),
        failsafe=FailsafeAction(
            failsafe.heading_timeout_s,
            failsafe.action,
            failsafe.release_after_s,
            failsafe.resume,
            failsafe.reengage_after_reboot,
            math.radians(failsafe.windward_rudder_deg),
        ),
        alarms=alarm_limits_of(vessel),
        rudder_share=vessel.guidance.rudder_share,
        turn_rate_max=_radians_or_unlimited(vessel.guidance.turn_rate_max_deg_s),
        turn_curvature_max=curvature_max_of(vessel),
        rudder_is_ours=vessel.helm.method != "guided",
        wave_corner=wave_corner_of(vessel, law),
        steerage=STEERAGE_SHARE * vessel.model.reference_speed_m_s if steerage is None else steerage,
        steerage_over_ground=steerage is not None,
        roll=roll_damping_of(vessel),
    )


def alarm_limits_of(vessel: Vessel) -> AlarmLimits:
    """Return what the monitors of the vessel go by."""
    alarms, follow = vessel.alarms, follow_of(vessel)
    return AlarmLimits(
        _radians_or_unlimited(alarms.off_course_deg),
        alarms.off_course_s,
        _radians_or_unlimited(alarms.roll_deg),
        alarms.frozen_heading,
        _radians_or_unlimited(alarms.heading_jump_deg),
        _radians_or_unlimited(alarms.rate_disagrees_deg),
        math.inf if alarms.innovation_sigmas is None else alarms.innovation_sigmas,
        alarms.reversed_rudder,
        follow.tolerance,
        follow.rate,
        follow.delay,
        vessel.failsafe.action == "windward",
    )


def track_settings_of(vessel: Vessel) -> TrackSettings:
    """Return how the vessel follows a route.

    The turning circle is that at the model's speed: without a preset rate it hardly depends on it, K grows with it.
    """
    guidance, model = vessel.guidance, model_of(vessel)
    limits = limits_of(vessel)
    fastest = _radians_or_unlimited(guidance.turn_rate_max_deg_s)
    turn_rate = preset_rate(fastest, curvature_max_of(vessel), model.reference_speed)
    # the circle between two legs is one that leaves rudder to keep to it
    turn = turn_limits(model, limits.angle_max, limits.rate_max, guidance.rudder_share, turn_rate, begins=1.0)
    onset = model.time_constant + 0.5 * turn.rudder_max / turn.rudder_rate
    return TrackSettings(
        lookahead=guidance.lookahead_s,
        radius=guidance.waypoint_radius_m,
        turn_radius=model.reference_speed / turn.rate_max,
        turn_reach=model.reference_speed * onset,
        alarm_distance=guidance.off_track_alarm_m,
    )


def curvature_max_of(vessel: Vessel) -> float:
    """Return 1/R [1/m] of the vessel's tightest turn; inf where the file names none."""
    radius = vessel.guidance.turn_radius_m
    return math.inf if radius is None else 1.0 / radius


def _radians_or_unlimited(degrees: float | None) -> float:
    return math.inf if degrees is None else math.radians(degrees)


def priority_of(vessel: Vessel) -> PrioritySettings:
    """Return which of the vessel's instruments are believed."""
    sensors = vessel.sensors
    limit = sensors.heading_monitor_deg
    return PrioritySettings(
        rules=tuple(SourceRule(*rule) for rule in sensors.priority),
        stale=sensors.source_timeout_s,
        heading_stale=HEADING_STALE_SHARE * vessel.failsafe.heading_timeout_s,
        disagree=math.inf if limit is None else math.radians(limit),
    )


def roll_damping_of(vessel: Vessel) -> RollDamping | None:
    """Return how the vessel's rudder works against roll; None where the file has no section control.roll."""
    roll = vessel.control.roll
    return None if roll is None else RollDamping(roll.rate_gain_s, math.radians(roll.rudder_max_deg), roll.lowest_rad_s)


def follow_of(vessel: Vessel) -> FollowSettings:
    """Return how closely the vessel's rudder must follow its orders."""
    rudder = vessel.rudder
    tolerance = math.radians(rudder.follow_tolerance_deg)
    return FollowSettings(tolerance, _radians_or_unlimited(rudder.rate_max_deg_s), rudder.delay_s + rudder.lag_s)


def nmea_settings_of(vessel: Vessel, url: LinkUrl) -> NmeaSettings:
    """Return how to read and steer the vessel on an NMEA link."""
    sensors = vessel.sensors
    return NmeaSettings(
        baud=url.baud,
        heading_latency=sensors.heading_latency_s,
        variation=None if sensors.variation_deg is None else math.radians(sensors.variation_deg),
        deviation=tuple((math.radians(at), math.radians(deviation)) for at, deviation in sensors.deviation_deg),
        steers=url.options.steers,
        follow=follow_of(vessel),
        sends=url.options.sends,
        talker=url.options.talker,
    )


def n2k_settings_of(vessel: Vessel, url: LinkUrl) -> N2kSettings:
    """Return how to read and steer the vessel on NMEA 2000."""
    variation = vessel.sensors.variation_deg
    return N2kSettings(
        heading_latency=vessel.sensors.heading_latency_s,
        variation=None if variation is None else math.radians(variation),
        steers=url.options.steers,
        follow=follow_of(vessel),
    )


DRIVES: dict[str, Callable[[DriveSettings], Drive]] = {"pypilot": PypilotMotor, "jrk": JrkG2, "maestro": Maestro}


def drive_settings_of(vessel: Vessel) -> DriveSettings:
    """Return what the scale of the vessel's rudder drive means."""
    drive, rudder = vessel.drive, vessel.rudder
    return DriveSettings(
        angle_at_full=math.radians(drive.angle_at_full_deg or rudder.angle_max_deg),
        amidships=drive.amidships,
        reversed=drive.reversed,
        rate=_radians_or_unlimited(rudder.rate_max_deg_s),
        stop=math.radians(rudder.angle_max_deg),
        current_max=drive.current_max_a,
        channel=drive.channel,
        device=drive.device,
    )


def admission_of(vessel: Vessel) -> Admission:
    """Return which ground stations are heard, and how much of them."""
    security = vessel.security
    return Admission(frozenset(security.allow_systems), security.commands_per_s, security.writes_per_s)


def networks_of(vessel: Vessel) -> tuple[Network, ...]:
    """Return the networks that may come to listening links; none: all."""
    return tuple(network_of(text) for text in vessel.security.allow_addresses)


class LinkOptions(NamedTuple):
    """Choices of one run: steer with the ground station's id, and which vehicle to latch on to (None: the first).

    `guide` takes what a chart plotter says on NMEA links; `signing` signs MAVLink links.
    `forward`: URLs of ground stations that see the flight controller through us; `doors`: which of them are heard.
    `reconnect`: lines that are lost, or not there yet, are opened again.
    """

    as_gcs: bool = False
    vehicle_system: int | None = None
    guide: PlotterGuide | None = None
    signing: Signing | None = None
    forward: tuple[str, ...] = ()
    doors: Doors | None = None
    reconnect: bool = False


def build_link(vessel: Vessel, url: str, options: LinkOptions, router: Router | None = None) -> Link:
    """Return the opened link of a URL, set up for the vessel and tapped for `router`. Raises LinkError."""
    parsed = parse_url(url)
    if parsed.protocol == "n2k":
        return N2kLink(parsed.text, open_bus(parsed.text, parsed.host, parsed.path), n2k_settings_of(vessel, parsed))
    transport = open_transport(parsed, networks_of(vessel))
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
        vehicle_system=options.vehicle_system,
        as_gcs=options.as_gcs,
        guided_speed_share=helm.guided_speed_share,
        hand_back_mode=MODES[vessel.failsafe.firmware_mode] if vessel.failsafe.action == "firmware" else None,
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
            door = options.doors.link() if options.doors else None
            links.append(ForwardLink(open_transport(url, allow), router, budget, signing, door))
    except BaseException:
        for link in links:
            link.close()
        raise
    return links


def refuse_failsafe(vessel: Vessel, urls: Sequence[str]) -> None:
    """Raise RefusedError where the vessel's fail-safe asks for what no link of `urls` can do."""
    action, protocols = vessel.failsafe.action, {parse_url(url).protocol for url in urls}
    steers_itself = vessel.helm.method == "guided"
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


def _kept(url: LinkUrl, opener: Callable[[], Link]) -> KeptLink:
    steers = url.options.steers or url.protocol not in ("nmea", "n2k")
    return KeptLink(url.text, steers, opener)


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
    try:
        for url in urls:
            opener = partial(build_link, vessel, url, options, router)
            links.append(_kept(parse_url(url), opener) if options.reconnect else opener())
        behind = build_forward_links(urls, options, router, networks_of(vessel)) if router is not None else []
    except BaseException:
        for link in links:
            link.close()
        raise
    if len(urls) == 1 and parse_url(urls[0]).protocol == "mavlink" and not vessel.sensors.priority:
        return [*links, *behind]  # one vehicle with one compass: nothing to choose
    priority = SourcePriority(priority_of(vessel))
    return [*(BelievedLink(link, priority) for link in links), *behind]
