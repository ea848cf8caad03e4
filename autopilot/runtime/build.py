"""From a vessel file to a Pilot: model, rudder, law and gains chosen by name, degrees made radians."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from autopilot.control.bow_thruster import BowThruster
from autopilot.control.design import Verdict, judge
from autopilot.control.law import LawBoat, LawInForce, LoopGains
from autopilot.control.limits import RudderLimits
from autopilot.control.margins import Delays, OutputFeedbackLoop, refusal_of, steady_filter
from autopilot.control.registry import LAWS
from autopilot.control.roll_damping import RollDamping, checked
from autopilot.errors import RefusedError
from autopilot.estimation.disturbance import Filtered, FilterNoise, filter_noise, usual_bias_time
from autopilot.guidance.stop import lag_of_plan, preset_rate, stop_angle, symmetric_of, turn_limits
from autopilot.guidance.track import LEADS_AHEAD, LEADS_AHEAD_SLUGGISH, SLUGGISH, TrackSettings
from autopilot.guidance.tuning import HARD_OVER
from autopilot.guidance.wind_vane import WindSettings
from autopilot.links.rudder_order import FollowSettings
from autopilot.models.drives import DRIVES, PLAIN, Mixing, Needs, at_point, quickness
from autopilot.models.norrbin import Norrbin, at_speed_ratio, rudder_for
from autopilot.models.steering_gear import SteeringGear, sided
from autopilot.pilot import Pilot
from autopilot.pilot_state import PilotConfig
from autopilot.steering import CornerFrequencies
from autopilot.supervision.monitor_input import AlarmLimits
from autopilot.supervision.supervisor import FailsafeAction
from autopilot.supervision.tuning import LATE_PERIODS
from autopilot.vessel.schema import Vessel, drive_law_of
from autopilot.vessel.schema import model_of as model_of

if TYPE_CHECKING:
    from autopilot.identification.learning import Learner


def thrusters_of(vessel: Vessel) -> Mixing:
    """Return what the vessel file says of two thrusters."""
    drive = vessel.drive
    known = drive.thrust_exponent, drive.astern_share
    exponent, astern = (math.nan if each is None else each for each in known)
    return PLAIN._replace(exponent=exponent, astern_share=astern)


def model_at_ratio(vessel: Vessel, ratio: float) -> Norrbin:
    """Return the model at `ratio` times the trial's speed, the throttle being the trial's."""
    law, model = drive_law_of(vessel), model_of(vessel)
    if law.is_rudder:
        return at_speed_ratio(model, ratio)
    return at_point(law, model, ratio * model.reference_speed, math.nan)


def gear_of(vessel: Vessel) -> SteeringGear:
    """Return the steering gear of the vessel file."""
    rudder, valves = vessel.rudder, vessel.drive.valve
    # valves that move a rudder at all bring it all the way
    dead_band = 0.0 if valves is not None else math.radians(rudder.dead_band_deg)
    opening = 0.0 if valves is None else valves.opening_s
    gear = SteeringGear(
        math.radians(rudder.angle_max_deg),
        math.inf,
        rudder.lag_s,
        dead_band,
        rudder.delay_s + opening,
        play=math.radians(rudder.play_deg),
    )
    return sided(gear, *(math.radians(rate) for rate in rudder.rates_deg_s))


def limits_of(vessel: Vessel) -> RudderLimits:
    """Return what may be commanded: the file's limits, inside what the rudder can do."""
    gear = gear_of(vessel)
    limits = vessel.limits
    angle = gear.angle_max if limits.angle_max_deg is None else math.radians(limits.angle_max_deg)
    rate = radians_or_unlimited(limits.rate_max_deg_s)
    held = SteeringGear(min(angle, gear.angle_max), math.inf)
    held = sided(held, min(rate, gear.rate_max * gear.to_port), min(rate, gear.rate_max * gear.to_starboard))
    return RudderLimits(held.angle_max, held.rate_max, held.to_port, held.to_starboard)


def law_boat_of(vessel: Vessel) -> LawBoat:
    """Return what the gains of a law are worked out for."""
    gear = gear_of(vessel)
    delay = vessel.sensors.heading_latency_s + vessel.control.loop_delay_s + gear.delay
    return LawBoat(model_of(vessel), gear, limits_of(vessel), delay, not DRIVES[vessel.drive.kind].is_mixed)


def law_of(vessel: Vessel, name: str | None = None) -> LawInForce:
    """Return the heading law `name` (the file's own choice when None) with the file's gains.

    Raises RefusedError where the file has no gains for it, or such as must not be engaged.
    """
    law = LAWS[name or vessel.control.law]
    section = getattr(vessel.control, law.name) if law.section else None
    if law.section and section is None:
        cure = "or let `autopilot gains` work them out" if law.design else law.advice or "as its module says"
        raise RefusedError(
            f"vessel {vessel.name!r} has no gains for the law {law.name!r}: add control.{law.name} to the file, {cure}"
        )
    if law.takes_roll and vessel.control.roll is not None:
        raise RefusedError(
            f"vessel {vessel.name!r}: the law {law.name!r} damps roll itself and excludes the section control.roll; "
            "leave one of them out"
        )
    try:
        return LawInForce(law, law.gains(section, law_boat_of(vessel)))
    except ValueError as error:
        raise RefusedError(f"vessel {vessel.name!r}: control.{law.name}: {error}") from error


def shown_gains_of(vessel: Vessel, name: str, ratio: float = 1.0) -> dict[str, float]:
    """Return the gains of the law at `ratio` times the speed of the trial, as its `shown` says; of a PID they are the
    same at every speed."""
    law, gains = law_of(vessel, name)
    times = quickness(drive_law_of(vessel), model_of(vessel), model_at_ratio(vessel, ratio))
    return law.shown(getattr(vessel.control, name), gains, times)


def loop_gains_of(vessel: Vessel, name: str | None = None, ratio: float = 1.0) -> LoopGains:
    """Return the law's gains on heading error, rate and integral, about straight running.

    ratio: at so many times the speed of the trial. Raises RefusedError for a law that closes no loop.
    """
    law, gains = law_of(vessel, name)
    if law.linear is None:
        raise RefusedError(f"vessel {vessel.name!r}: the law {law.name!r} closes no loop")
    try:
        here = model_at_ratio(vessel, ratio)
        return law.linear(law.at(gains, quickness(drive_law_of(vessel), model_of(vessel), here)), here)
    except ValueError as error:
        raise RefusedError(f"vessel {vessel.name!r}: control.{law.name}: {error}") from error


def radians_or_unlimited(degrees: float | None) -> float:
    """Return `degrees` in radians; inf where there is no limit."""
    return math.inf if degrees is None else math.radians(degrees)


UNATTENDED_S = 3.0
"""A rudder drive without a time-out of its own is left without orders for so long, as ArduPilot's overrides are."""
FILTER_SHARE = 0.4
"""Waves quicker than this share of the steering loop's natural frequency are filtered out: below it the rudder still
lessens them, above it rudder and waves get out of step (docs/wave_filter.md)."""
STEERAGE_SHARE = 0.1
"""Below this share of the model's speed a boat is not steered, where the file says nothing."""
HEADING_INTERVAL = 0.1
"""Loops are judged as if headings came so often [s], as most compasses send them."""
HEADING_NOISE_LEAST_DEG = 0.1
"""The monitors hold no compass for better than its last digit."""


def _integrates(vessel: Vessel, law: str | None) -> bool:
    """Return whether the law, None: the file's, learns the bias by itself and does not go by the estimated one."""
    return not LAWS[law or vessel.control.law].uses_bias


def noise_of(vessel: Vessel, law: str | None = None) -> FilterNoise:
    """Return the filter's noise: instruments from the file, sea and wind from `autopilot.estimation.tuning`."""
    sensors = vessel.sensors
    return filter_noise(
        model_of(vessel),
        Filtered(
            math.radians(sensors.heading_noise_deg) ** 2,
            math.radians(sensors.rate_noise_deg_s) ** 2,
            # in which wind, current and trim change [s]: the file's, or the usual one
            vessel.estimator.bias_time_s or usual_bias_time(model_of(vessel), gear_of(vessel).angle_max),
            gear_of(vessel).angle_max,
            math.inf if _integrates(vessel, law) else HARD_OVER * limits_of(vessel).angle_max,
            waves=vessel.estimator.wave_filter != "off",
        ),
    )


def corner_frequencies_of(vessel: Vessel, law: str | None = None) -> CornerFrequencies:
    """Return which waves the law is shown, all of them where it closes no loop or works against roll in the waves, and
    which of them are cancelled."""
    chosen = LAWS[law or vessel.control.law]
    if chosen.linear is None or chosen.takes_roll:
        return CornerFrequencies(math.inf)
    gains = loop_gains_of(vessel, law)
    square = gains.proportional * vessel.model.K_1_s / vessel.model.T_s
    weighted = math.cbrt(square / gains.smoothing) if gains.smoothing > 0.0 else 0.0
    return CornerFrequencies(FILTER_SHARE * math.sqrt(square), weighted)


def verdict_of(vessel: Vessel, name: str | None = None, ratio: float = 1.0) -> Verdict:
    """Return the margins of the vessel's law with its rudder, and why it must not engage where it must not.

    ratio: at so many times the speed of the trial.
    """
    verdict = _of_exact_boat(vessel, name, ratio)
    return (
        verdict if verdict.refusal else verdict._replace(refusal=refusal_of(output_feedback_loop(vessel, name, ratio)))
    )


def _of_exact_boat(vessel: Vessel, name: str | None = None, ratio: float = 1.0) -> Verdict:
    """Return the same of a law that knows exactly what the boat does, without the filter."""
    return judge(
        model_at_ratio(vessel, ratio),
        gear_of(vessel),
        limits_of(vessel).rate_max,
        vessel.control.loop_delay_s,
        loop_gains_of(vessel, name, ratio),
    )


def delay_margin_of(vessel: Vessel, name: str | None = None) -> float:
    """Return by how much later [s] orders could come to the rudder, did the law know the boat exactly; inf for one that
    closes no loop."""
    return _of_exact_boat(vessel, name).margins.delay if LAWS[name or vessel.control.law].linear else math.inf


def refusal_to_engage(vessel: Vessel, name: str | None = None) -> str:
    """Return why the law must not be engaged on the vessel's rudder, or ""; one that closes no loop may always be."""
    return verdict_of(vessel, name).refusal if LAWS[name or vessel.control.law].linear else ""


def output_feedback_loop(
    vessel: Vessel, name: str | None = None, ratio: float = 1.0, disturbed: bool = False
) -> OutputFeedbackLoop:
    """Return the loop of the vessel's law with the heading filter in it, at `ratio` times the speed of the trial.

    in_gusts: with the bias as quick as the filter learns it to be at most; without waves it learns nothing.
    """
    model, noise = model_at_ratio(vessel, ratio), noise_of(vessel)
    if disturbed and noise.waves:
        noise = noise._replace(bias=noise.gusty_bias)
    return OutputFeedbackLoop(
        model,
        gear_of(vessel),
        Delays(vessel.control.loop_delay_s, vessel.sensors.heading_latency_s),
        loop_gains_of(vessel, name, ratio),
        not _integrates(vessel, name),
        steady_filter(model, noise, HEADING_INTERVAL, vessel.sensors.heading_latency_s),
    )


def build_pilot(vessel: Vessel, law: str | None = None, *, learns: bool = False) -> Pilot:
    """Return the pilot of a vessel, one that learns its model where asked for.

    Raises RefusedError where its gains must not be engaged on its rudder.
    """
    if refusal := refusal_to_engage(vessel, law):
        raise RefusedError(f"vessel {vessel.name!r}: {refusal}")
    config = pilot_config(vessel, law)
    return Pilot(config, law_of(vessel, law), learner_of(vessel) if learns else None)


def learner_of(vessel: Vessel) -> Learner:
    """Return what learns the vessel's model while it sails. Raises RefusedError for a model with n2."""
    from autopilot.identification.learning import Learner

    if vessel.model.n2_s_rad:
        raise RefusedError(f"vessel {vessel.name!r}: --learn knows no model.n2_s_rad; set it to 0 or leave --learn out")
    return Learner(model_of(vessel), rudder_max=limits_of(vessel).angle_max, gear=gear_of(vessel))


def pilot_config(vessel: Vessel, law: str | None = None) -> PilotConfig:
    """Return what the pilot knows of the vessel that `law` (None: the file's own) is to steer."""
    failsafe, steerage = vessel.failsafe, vessel.control.steerage_m_s
    return PilotConfig(
        model=model_of(vessel),
        gear=gear_of(vessel),
        noise=noise_of(vessel, law),
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
        rudder_share=planned_share(vessel),
        turn_rate_max=radians_or_unlimited(vessel.guidance.turn_rate_max_deg_s),
        turn_curvature_max=curvature_max_of(vessel),
        rudder_is_ours=not vessel.helm.firmware_steers,
        corner_frequencies=corner_frequencies_of(vessel, law),
        steerage=_steerage_of(vessel),
        steerage_over_ground=steerage is not None,
        roll=roll_damping_of(vessel),
        dead_band=math.radians(vessel.limits.dead_band_deg),
        law=drive_law_of(vessel),
        steers_by=DRIVES[vessel.drive.kind].needs,
        loop_delay=vessel.control.loop_delay_s,
        path_delay=math.nan if vessel.control.path_delay_s is None else vessel.control.path_delay_s,
        shows_path=vessel.drive.valve is None,
        delay_margin=delay_margin_of(vessel, law),
        thruster=bow_thruster_of(vessel),
    )


def bow_thruster_of(vessel: Vessel) -> BowThruster | None:
    """Return what is known of the vessel's bow thruster, in radians; None where the pilot has none."""
    bow = vessel.drive.bow_thruster
    if bow is None:
        return None
    return BowThruster(
        rate=math.radians(bow.rate_at_rest_deg_s),
        time=bow.rate_time_s,
        useless_above=bow.useless_above_m_s,
        delay=bow.delay_s,
        proportional=bow.proportional,
        least=bow.least_share,
        run=bow.run_s,
        rest=bow.rest_s,
        least_on=bow.least_on_s,
        least_off=bow.least_off_s,
        dead_band=math.radians(bow.dead_band_deg),
    )


def planned_share(vessel: Vessel) -> float:
    """Return the share [-] of the rudder that turns are planned with.

    A course-unstable boat is planned for as the weakest that the identification leaves, two standard errors of K below.
    """
    share, error = vessel.guidance.rudder_share, vessel.model.standard_errors.K_1_s
    if vessel.model.n1 > 0.0 or error is None:
        return share
    return min(share, max(1.0 - 2.0 * error / vessel.model.K_1_s, LEAST_SHARE))


def _steerage_of(vessel: Vessel) -> float:
    """Return the speed [m/s] below which the boat does not steer; -inf where it needs none."""
    if DRIVES[vessel.drive.kind].needs is Needs.NOTHING:
        return -math.inf
    steerage = vessel.control.steerage_m_s
    return STEERAGE_SHARE * vessel.model.reference_speed_m_s if steerage is None else steerage


def alarm_limits_of(vessel: Vessel) -> AlarmLimits:
    """Return what the monitors of the vessel go by."""
    alarms, follow, gear = vessel.alarms, follow_of(vessel), gear_of(vessel)
    return AlarmLimits(
        radians_or_unlimited(alarms.off_course_deg),
        alarms.off_course_s,
        radians_or_unlimited(alarms.roll_deg),
        alarms.frozen_heading,
        radians_or_unlimited(alarms.heading_jump_deg),
        radians_or_unlimited(alarms.rate_disagrees_deg),
        math.inf if alarms.innovation_sigmas is None else alarms.innovation_sigmas,
        alarms.reversed_rudder,
        follow.tolerance,
        follow.rate,
        follow.delay,
        vessel.failsafe.action == "windward",
        math.radians(max(vessel.sensors.heading_noise_deg, HEADING_NOISE_LEAST_DEG)) ** 2,
        LATE_PERIODS / vessel.control.rate_hz,
        (gear.to_port, gear.to_starboard),
    )


LEAST_SHARE = 0.3
"""A boat whose K is less sure than this allows is turned with this share of the rudder."""
TRACK_TURN = 0.75
"""Corners of a track are planned with this share of the fastest turn: the rest brings a boat back that is off it."""


def track_settings_of(vessel: Vessel) -> TrackSettings:
    """Return how the vessel follows a route.

    The turning circle is that at the model's speed: without a preset rate it hardly depends on it, K grows with it.
    """
    guidance, model = vessel.guidance, model_of(vessel)
    limits = limits_of(vessel)
    fastest = radians_or_unlimited(guidance.turn_rate_max_deg_s)
    turn_rate = preset_rate(fastest, curvature_max_of(vessel), model.reference_speed)
    # the circle between two legs is one that leaves rudder to keep to it
    gear = SteeringGear(limits.angle_max, limits.rate_max)
    share = planned_share(vessel)
    turn = turn_limits(model, gear, share, turn_rate, begins=1.0)
    free = turn_limits(model, gear, share, begins=1.0)
    rate = min(TRACK_TURN * free.rate_max, turn.rate_max)
    symmetric = symmetric_of(model)
    # a turn that goes on at this rate is planned so far behind its order
    behind = lag_of_plan(turn, rate) + stop_angle(symmetric, turn, rate, rudder_for(symmetric, rate, 0.0)) / rate
    lead = behind + vessel.control.loop_delay_s
    is_sluggish = model.n1 <= 0.0 or model.time_constant > SLUGGISH * lead
    return TrackSettings(
        lookahead=guidance.lookahead_s,
        radius=guidance.waypoint_radius_m,
        turn_radius=model.reference_speed / rate,
        lead=lead,
        speed=model.reference_speed,
        sway_time=model.time_constant,
        alarm_distance=guidance.off_track_alarm_m,
        magnetic=vessel.sensors.magnetic,
        leads_ahead=LEADS_AHEAD_SLUGGISH if is_sluggish else LEADS_AHEAD,
    )


def wind_settings_of(vessel: Vessel) -> WindSettings:
    """Return how the vessel is held to the wind, and which shift is reported."""
    guidance = vessel.guidance
    return WindSettings(
        guidance.wind_time_s, guidance.gybe_wind_max_m_s, radians_or_unlimited(vessel.alarms.wind_shift_deg)
    )


def curvature_max_of(vessel: Vessel) -> float:
    """Return 1/R [1/m] of the vessel's tightest turn; inf where the file names none."""
    radius = vessel.guidance.turn_radius_m
    return math.inf if radius is None else 1.0 / radius


def roll_damping_of(vessel: Vessel) -> RollDamping | None:
    """Return how the vessel's rudder works against roll; None where the file has no section control.roll."""
    roll = vessel.control.roll
    if roll is None:
        return None
    return checked(RollDamping(roll.rate_gain_s, math.radians(roll.rudder_max_deg), roll.lowest_rad_s))


def follow_of(vessel: Vessel) -> FollowSettings:
    """Return how closely the vessel's rudder must follow its orders, and how long it may be left without one."""
    rudder = vessel.rudder
    tolerance = math.radians(rudder.follow_tolerance_deg)
    patience = max(UNATTENDED_S, vessel.failsafe.heading_timeout_s, LATE_PERIODS / vessel.control.rate_hz)
    return FollowSettings(tolerance, rudder.slower_rate, rudder.delay_s + rudder.lag_s, patience)
