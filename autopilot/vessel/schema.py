"""The vessel file's schema: typed, frozen, one unit in every key name.

Degrees and knots appear here because people write these files; `build` turns them into radians. Each field carries its
range, its purpose, and from when on a change of it counts: reading, checking, the JSON Schema, the parameters of ground
stations and the reference page all work from these declarations.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, make_dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

from autopilot.control.registry import LAWS, filed_laws
from autopilot.files.typed import NOW as NOW
from autopilot.files.typed import RESTART as RESTART
from autopilot.files.typed import Bounds as Bounds
from autopilot.files.typed import Counts as Counts
from autopilot.models.drives import DRIVES, DriveLaw, DriveName
from autopilot.models.norrbin import Norrbin

SCHEMA_VERSION = 2
"""What this version reads and writes."""
USUAL_RATES_DEG_S = (0.5, 400.0)
"""From what an auxiliary gear must give a ship (15 to 15 deg in 60 s: SOLAS II-1/29) to a model's servo under load."""


@dataclass(frozen=True)
class StandardErrors:
    """Standard errors of the identified parameters, in the parameters' units; absent: not determined."""

    K_1_s: Annotated[float, NOW, Bounds(0.0, None, "standard error of K")] | None = None
    T_s: Annotated[float, NOW, Bounds(0.0, None, "standard error of T")] | None = None
    n3_s2_rad2: Annotated[float, NOW, Bounds(0.0, None, "standard error of n3")] | None = None
    n0_rad_s: Annotated[float, NOW, Bounds(0.0, None, "standard error of n0")] | None = None
    speed_exponent: Annotated[float, NOW, Bounds(0.0, None, "standard error of it")] | None = None
    throttle_exponent: Annotated[float, NOW, Bounds(0.0, None, "standard error of it")] | None = None
    damping_share: Annotated[float, NOW, Bounds(0.0, None, "standard error of it")] | None = None


@dataclass(frozen=True)
class Model:
    """Norrbin model T r' + n3 r^3 + n2 r^2 + n1 r + n0 = K delta at the reference speed."""

    K_1_s: Annotated[
        float, NOW, Bounds(1.0e-5, 100.0, "rudder gain K: steady yaw rate per rudder angle", (1.0e-3, 20.0))
    ]
    T_s: Annotated[float, NOW, Bounds(0.01, 10000.0, "time constant T", (0.05, 2000.0))]
    reference_speed_m_s: Annotated[
        float, NOW, Bounds(1.0e-3, 100.0, "speed at which K, T and n0..n3 hold", (0.1, 30.0))
    ]
    n1: Annotated[float, NOW, Bounds(-1.0, 1.0, "+1 course-stable, -1 course-unstable")] = 1.0
    n3_s2_rad2: Annotated[float, NOW, Bounds(0.0, 1.0e9, "cubic damping", (0.0, 1.0e6))] = 0.0
    n2_s_rad: Annotated[float, NOW, Bounds(-1.0e6, 1.0e6, "quadratic damping (asymmetry)", (-1.0e3, 1.0e3))] = 0.0
    n0_rad_s: Annotated[float, NOW, Bounds(-10.0, 10.0, "trim or wind bias", (-0.2, 0.2))] = 0.0
    speed_exponent: Annotated[float, NOW, Bounds(-1.0, 3.0, "K/T goes with this power of the speed")] | None = None
    throttle_exponent: Annotated[float, NOW, Bounds(0.0, 3.0, "K/T goes with this power of the throttle")] | None = None
    damping_share: (
        Annotated[float, NOW, Bounds(-5.0, 1.0, "share of the yaw damping that goes with the speed")] | None
    ) = None
    reference_throttle: Annotated[float, NOW, Bounds(0.01, 1.0, "throttle at which K holds, share of full")] | None = (
        None
    )
    way_exponent: Annotated[float, NOW, Bounds(0.2, 3.0, "the speed goes with this power of the throttle")] | None = (
        None
    )
    slowest_m_s: Annotated[float, NOW, Bounds(0.0, 100.0, "slowest run of the trials")] | None = None
    fastest_m_s: Annotated[float, NOW, Bounds(0.0, 100.0, "fastest run of the trials")] | None = None
    """null, all seven: as is usual for the kind of drive. Of a rudder K ~ U and T ~ 1/U, and they have no say."""
    standard_errors: StandardErrors = field(default_factory=StandardErrors)
    source: Annotated[str, NOW] = ""
    date: Annotated[str, NOW] = ""
    log: Annotated[tuple[str, ...], NOW] = ()
    """The recordings that the model was identified from."""


@dataclass(frozen=True)
class Rudder:
    """What the steering gear can do. rate_max_deg_s: null means a rudder of unlimited rate (simulation only).

    A hydraulic ram is quicker to one side: rate_port_deg_s is the rate to port then, rate_max_deg_s that to starboard.
    """

    angle_max_deg: Annotated[float, RESTART, Bounds(1.0, 90.0, "end stop of the rudder, each side", (5.0, 90.0))]
    rate_max_deg_s: (
        Annotated[float, RESTART, Bounds(0.1, 1000.0, "slewing rate; null: unlimited", USUAL_RATES_DEG_S)] | None
    )
    lag_s: Annotated[float, RESTART, Bounds(0.0, 60.0, "first-order lag of the steering gear", (0.0, 5.0))] = 0.0
    delay_s: Annotated[float, RESTART, Bounds(0.0, 10.0, "dead time from order to first movement", (0.0, 2.0))] = 0.0
    dead_band_deg: Annotated[float, RESTART, Bounds(0.0, 10.0, "smallest error the gear moves for")] = 0.0
    follow_tolerance_deg: Annotated[float, RESTART, Bounds(0.5, 90.0, "rudder this far off its order disobeys")] = 5.0
    rate_port_deg_s: (
        Annotated[float, RESTART, Bounds(0.1, 1000.0, "slewing rate to port", USUAL_RATES_DEG_S)] | None
    ) = None
    """null: as to starboard."""
    play_deg: Annotated[float, RESTART, Bounds(0.0, 20.0, "backlash of the linkage, each way", (0.0, 5.0))] = 0.0
    source: Annotated[str, RESTART] = ""
    date: Annotated[str, RESTART] = ""

    @property
    def rates_deg_s(self) -> tuple[float, float]:
        """Slewing rates to port and to starboard, inf where unlimited."""
        starboard = math.inf if self.rate_max_deg_s is None else self.rate_max_deg_s
        return starboard if self.rate_port_deg_s is None else self.rate_port_deg_s, starboard

    @property
    def slower_rate(self) -> float:
        """Slewing rate to the slower side [rad/s], inf where unlimited."""
        return math.radians(min(self.rates_deg_s))


@dataclass(frozen=True)
class Sensors:
    """What the instruments are like: noise as standard deviation, latency from measurement to arrival."""

    heading_noise_deg: Annotated[float, NOW, Bounds(0.001, 30.0, "standard deviation of the heading")] = 0.3
    heading_latency_s: Annotated[float, RESTART, Bounds(0.0, 5.0, "age of a heading when it arrives", (0.0, 2.0))] = 0.0
    rate_noise_deg_s: Annotated[float, NOW, Bounds(0.001, 30.0, "standard deviation of the yaw rate")] = 0.2
    gyro: Annotated[bool, NOW, Bounds(None, None, "something aboard measures the rate of turn")] = True
    """false: gains are designed for a compass alone."""
    variation_deg: Annotated[float, RESTART, Bounds(-180.0, 180.0, "magnetic variation, east positive")] | None = None
    earth_field: Annotated[bool, RESTART, Bounds(None, None, "variation by the World Magnetic Model")] = False
    """Where neither variation_deg nor an instrument gives the variation, the World Magnetic Model does, at the boat's
    position and today's date (extra `field`)."""
    magnetic: Annotated[bool, RESTART, Bounds(None, None, "headings and courses are magnetic")] = False
    """Headings and courses are magnetic: a compass course is held, and no variation is needed; no routes then."""
    deviation_deg: Annotated[tuple[tuple[float, float], ...], RESTART] = ()
    """Compass deviation table: [compass heading deg, deviation deg, east positive], interpolated round the card."""
    priority: Annotated[tuple[tuple[str, float], ...], RESTART] = ()
    """Instruments, the one to believe first: [name or pattern such as HEHDT, "HC*", attitude, age in s when stale]."""
    compass: Annotated[str, RESTART] = ""
    """The compass that the skipper has chosen on a display, NAME@LINK: it goes before `priority`. "": none."""
    source_timeout_s: Annotated[float, RESTART, Bounds(0.1, 60.0, "age at which an unlisted instrument is stale")] = 2.0
    heading_monitor_deg: (
        Annotated[float, RESTART, Bounds(1.0, 180.0, "two compasses this far apart are an alarm")] | None
    ) = 15.0
    source: Annotated[str, NOW] = ""
    date: Annotated[str, NOW] = ""


@dataclass(frozen=True)
class Roll:
    """Rudder against roll rate beside the heading law, where the link brings roll; kept on only while it helps."""

    rate_gain_s: Annotated[float, NOW, Bounds(-100.0, 100.0, "rudder per roll rate; above 0 for displacement hulls")]
    rudder_max_deg: Annotated[float, NOW, Bounds(0.1, 45.0, "most rudder it may add")] = 5.0
    lowest_rad_s: Annotated[float, NOW, Bounds(0.0, 10.0, "off where the boat rolls at lower frequencies")] = 0.0


@dataclass(frozen=True)
class _Loop:
    law: Annotated[LawName, RESTART, Bounds(None, None, "heading law that steers")] = "backstepping"
    rate_hz: Annotated[float, RESTART, Bounds(1.0, 200.0, "control rate")] = 20.0
    loop_delay_s: Annotated[
        float, NOW, Bounds(0.0, 5.0, "dead time from heading to rudder order, all links", (0.0, 2.0))
    ] = 0.05
    path_delay_s: (
        Annotated[float, RESTART, Bounds(0.0, 1.1, "as loop_delay_s, as it was measured by the rudder's echo")] | None
    ) = None
    """null: not measured; a run begins with it, and goes on with what it measures itself."""
    steerage_m_s: (
        Annotated[float, NOW, Bounds(0.0, 50.0, "slower than this the rudder waits amidships; 0: never")] | None
    ) = None
    """null: a tenth of the model's reference speed, through the water; a number counts over the ground too."""


# a section and a word for every law that is registered, which no type checker can see
if TYPE_CHECKING:
    LawName = str

    @dataclass(frozen=True)
    class _Gains(_Loop):
        def __getattr__(self, law: str) -> Any: ...

else:
    LawName = Literal[filed_laws()]
    _Gains = make_dataclass(
        "_Gains",
        [(name, law.section | None, None) for name, law in LAWS.items() if law.section is not None],
        bases=(_Loop,),
        frozen=True,
    )


@dataclass(frozen=True)
class Control(_Gains):
    """Which law steers, how often, and its gains.

    Every law of `autopilot.control.registry` that has gains has a section of its name.
    """

    roll: Roll | None = None
    source: Annotated[str, NOW] = ""
    date: Annotated[str, NOW] = ""


@dataclass(frozen=True)
class Guidance:
    """How the boat is taken through a change of heading, and along a track."""

    rudder_share: Annotated[float, NOW, Bounds(0.1, 1.0, "share of rudder angle and rate a turn may plan with")] = 0.7
    turn_rate_max_deg_s: Annotated[float, NOW, Bounds(0.01, 360.0, "fastest turn")] | None = None
    turn_radius_m: Annotated[float, NOW, Bounds(0.5, 20000.0, "tightest turn, through the water")] | None = None
    """null, both: as quick as the rudder allows; the slower of two holds."""
    lookahead_s: Annotated[float, NOW, Bounds(2.0, 120.0, "a track is met this much way ahead: short is sharp")] = 4.0
    waypoint_radius_m: Annotated[float, NOW, Bounds(0.5, 5000.0, "a waypoint is reached within")] = 10.0
    off_track_alarm_m: Annotated[float, NOW, Bounds(1.0, 20000.0, "alarm further than this off the track")] = 50.0
    wind_time_s: Annotated[float, NOW, Bounds(1.0, 60.0, "a shift of wind is followed in about so long")] = 5.0
    gybe_wind_max_m_s: Annotated[float, NOW, Bounds(0.0, 60.0, "in more true wind a gybe must be confirmed aboard")] = (
        12.0
    )
    source: Annotated[str, NOW] = ""
    date: Annotated[str, NOW] = ""


@dataclass(frozen=True)
class Estimator:
    """What is made of heading and rate before the law sees them."""

    wave_filter: Annotated[Literal["auto", "off", "meet"], NOW, Bounds(None, None, "what is done about waves")] = "auto"
    """auto: wave motion is learnt; gains with smoothing_s undo of it what is worth their rudder's travel, other laws
    are shown slow waves alone. meet: the same, kept for files that say so."""
    bias_time_s: Annotated[float, NOW, Bounds(1.0, 100000.0, "wind, current and trim change in so long")] | None = None
    """null: 10 s, or two time constants if that is longer. A longer time keeps the rudder quieter in following seas,
    a shorter one follows a change of wind sooner."""
    source: Annotated[str, NOW] = ""
    date: Annotated[str, NOW] = ""


@dataclass(frozen=True)
class Limits:
    """What may be commanded; null: what the rudder can do."""

    angle_max_deg: Annotated[float, NOW, Bounds(1.0, 90.0, "largest rudder angle commanded")] | None = None
    rate_max_deg_s: Annotated[float, NOW, Bounds(0.1, 1000.0, "fastest change of the command")] | None = None
    dead_band_deg: Annotated[float, NOW, Bounds(0.0, 5.0, "on a course the rudder rests until wrong by more")] = 0.0
    source: Annotated[str, NOW] = ""
    date: Annotated[str, NOW] = ""


@dataclass(frozen=True)
class Failsafe:
    """What happens when the heading is lost: the action at once, the release after `release_after_s`."""

    heading_timeout_s: Annotated[float, RESTART, Bounds(0.1, 60.0, "age at which a heading is stale")] = 1.0
    action: Annotated[
        Literal["release", "amidships", "hold", "dead_reckoning", "windward", "firmware"],
        RESTART,
        Bounds(None, None, "what the rudder does when the heading is lost"),
    ] = "amidships"
    """dead_reckoning: hold the last heading by model and rate of turn; windward: turn slowly into the wind; firmware:
    release, and order the flight controller into firmware_mode."""
    firmware_mode: Annotated[
        Literal["HOLD", "LOITER", "RTL"], RESTART, Bounds(None, None, "mode that action firmware orders")
    ] = "HOLD"
    windward_rudder_deg: Annotated[float, NOW, Bounds(1.0, 45.0, "rudder of the slow turn to windward")] = 10.0
    release_after_s: Annotated[float, NOW, Bounds(0.0, 600.0, "action held this long, then rudder released")] = 10.0
    resume: Annotated[bool, NOW, Bounds(None, None, "engage again by itself when the heading is back")] = False
    reengage_after_reboot: Annotated[bool, NOW, Bounds(None, None, "engage again when a rebooted vehicle is ready")] = (
        False
    )
    """Ready is: armed, and in the mode to steer."""
    reengage_after_restart_s: Annotated[
        float,
        RESTART,
        Bounds(0.0, 600.0, "hold the heading again when our own process died and is back within this; 0: never"),
    ] = 0.0
    source: Annotated[str, NOW] = ""
    date: Annotated[str, NOW] = ""


@dataclass(frozen=True)
class Alarms:
    """What is watched while a course is held; null: not watched."""

    off_course_deg: Annotated[float, NOW, Bounds(3.0, 180.0, "alarm this far off the course ordered")] | None = 20.0
    off_course_s: Annotated[float, NOW, Bounds(1.0, 600.0, "for this long, turns apart")] = 5.0
    roll_deg: Annotated[float, NOW, Bounds(5.0, 180.0, "alarm at this heel")] | None = None
    wind_shift_deg: Annotated[float, NOW, Bounds(5.0, 180.0, "alarm where the wind has shifted by more")] | None = 30.0
    """Against the heading held, or in a wind hold against the course that it began with."""
    frozen_heading: Annotated[bool, RESTART, Bounds(None, None, "a compass that stands still is found")] = True
    """A compass that stands still to the last digit while the boat turns ends steering, as a silent one does."""
    heading_jump_deg: (
        Annotated[float, RESTART, Bounds(5.0, 180.0, "no boat turns this far between two headings")] | None
    ) = 25.0
    rate_disagrees_deg: (
        Annotated[float, NOW, Bounds(3.0, 180.0, "turns by heading and by rate this far apart in 5 s are an alarm")]
        | None
    ) = 15.0
    innovation_sigmas: (
        Annotated[float, NOW, Bounds(1.0, 5.0, "alarm where measurements lie this far to one side for 20 s")] | None
    ) = 3.0
    reversed_rudder: Annotated[bool, NOW, Bounds(None, None, "a boat that turns against its rudder is found")] = True
    """A boat that does not answer to its rudder, or to its opposite, ends steering, rudder sensor or not."""
    outputs: Annotated[tuple[str, ...], RESTART] = ("bell",)
    """Where alarms are heard: bell (the terminal's), tune (the vehicle's buzzer), relay:N (the vehicle's relay N),
    file:PATH (1 is written while an alarm sounds, else 0: a GPIO's value)."""
    battery_percent: Annotated[float, RESTART, Bounds(1.0, 90.0, "alarm below this vehicle charge")] | None = 20.0


Pulse = Annotated[float, Bounds(500.0, 2500.0, "pulse of the steering servo in us")]


@dataclass(frozen=True)
class Helm:
    """How rudder commands reach a MAVLink flight controller."""

    method: Annotated[
        Literal["rc_override", "manual_control", "guided", "offboard"],
        RESTART,
        Bounds(None, None, "how orders reach the vehicle"),
    ] = "rc_override"
    """guided: the firmware steers by itself to the headings it is given; offboard: so does PX4, and works the throttle;
    the other two move the rudder."""
    rate_hz: Annotated[float, RESTART, Bounds(5.0, 100.0, "least rate at which the command is repeated")] = 10.0
    rudder_at_full_pwm_deg: Annotated[float, RESTART, Bounds(1.0, 90.0, "rudder at full servo travel")] | None = None
    servo_us: Annotated[tuple[Pulse, Pulse, Pulse], RESTART] | None = None
    """Pulses at full rudder to one side, amidships and to the other, for which that angle was measured; null: whatever
    SERVOn_MIN, _TRIM and _MAX of the flight controller are."""
    reversed: Annotated[bool, RESTART, Bounds(None, None, "orders go out to the other side")] = False
    guided_speed_share: Annotated[
        float, RESTART, Bounds(0.0, 1.0, "guided: thrust as a share of WP_SPEED; 0: the stick's")
    ] = 0.0
    offboard_speed_m_s: Annotated[float, RESTART, Bounds(0.1, 50.0, "offboard: speed that PX4 goes at")] | None = None
    source: Annotated[str, RESTART] = ""
    date: Annotated[str, RESTART] = ""

    @property
    def firmware_steers(self) -> bool:
        """Whether the firmware's own controller moves the rudder."""
        return self.method in ("guided", "offboard")


@dataclass(frozen=True)
class Valves:
    """On/off valves of a hydraulic steering gear, as a stopwatch shows them; the rates are those of `rudder`."""

    opening_s: Annotated[float, RESTART, Bounds(0.0, 2.0, "time a rudder loses while a valve opens")] = 0.08
    coasting_s: Annotated[float, RESTART, Bounds(0.0, 5.0, "how far it runs on when shut, over its rate")] = 0.1
    least_pulse_s: Annotated[float, RESTART, Bounds(0.02, 5.0, "shortest time for which one is opened")] = 0.1
    """opening_s is measured by the whole way of an opening for t, the rate times (t - opening_s + coasting_s). To begin
    to move takes less: the oil comes up to its rate as gradually as it runs on."""
    sensor_channel: Annotated[int, RESTART, Bounds(0, 23, "analogue input with the rudder sensor")] | None = None
    """null: no sensor; the rudder is reckoned from the time for which each valve was open."""


@dataclass(frozen=True)
class BowThruster:
    """A bow thruster on an output of the flight controller that passes a channel of the radio on
    (SERVOn_FUNCTION 139 + channel). The boat that lies still is turned by it at full for the first two numbers."""

    rate_at_rest_deg_s: Annotated[float, RESTART, Bounds(0.1, 90.0, "rate of turn it comes to, lying still")]
    rate_time_s: Annotated[float, RESTART, Bounds(0.1, 120.0, "time in which 63 % of that rate is there")]
    useless_above_m_s: Annotated[float, RESTART, Bounds(0.1, 10.0, "speed through the water at which it does nothing")]
    channel: Annotated[int, RESTART, Bounds(5, 16, "channel of the radio that its output passes on")]
    proportional: Annotated[bool, RESTART, Bounds(None, None, "it runs at less than full, too")] = False
    """false: it knows full and nothing."""
    least_share: Annotated[float, RESTART, Bounds(0.01, 1.0, "proportional: least share of full it turns with")] = 0.2
    reversed: Annotated[bool, RESTART, Bounds(None, None, "the longer pulse turns the bow to port")] = False
    delay_s: Annotated[float, RESTART, Bounds(0.0, 3.0, "dead time from order to thrust")] = 0.3
    run_s: Annotated[float, RESTART, Bounds(1.0, 3600.0, "so long it may run at full, cold")] = 60.0
    rest_s: Annotated[float, RESTART, Bounds(1.0, 36000.0, "so long it takes to cool from there")] = 600.0
    least_on_s: Annotated[float, RESTART, Bounds(0.1, 10.0, "shortest run")] = 0.5
    least_off_s: Annotated[float, RESTART, Bounds(0.1, 60.0, "shortest rest, and before it turns the other way")] = 1.0
    dead_band_deg: Annotated[float, RESTART, Bounds(0.5, 45.0, "it rests this near the course")] = 3.0


@dataclass(frozen=True)
class Drive:
    """What steers the boat; and of a rudder drive on a line of its own (pypilot, Jrk, Maestro) what its scale from -1
    to 1 means."""

    kind: Annotated[DriveName, RESTART, Bounds(None, None, "what steers the boat")] = "rudder"
    """rudder; outboard, jet, vectored: thrust that is turned; two_thrusters: their difference steers, mixed by the
    flight controller (servo functions 73 and 74)."""
    thrust_exponent: (
        Annotated[float, RESTART, Bounds(0.5, 3.0, "two thrusters: thrust goes with this power of the output")] | None
    ) = None
    """null: as MOT_THST_EXPO says."""
    astern_share: (
        Annotated[float, RESTART, Bounds(0.05, 1.5, "two thrusters: full thrust astern over that ahead")] | None
    ) = None
    """null: as MOT_THST_ASYM says."""
    angle_at_full_deg: Annotated[float, RESTART, Bounds(1.0, 180.0, "rudder at each end of the scale")] | None = None
    amidships: Annotated[float, RESTART, Bounds(-0.9, 0.9, "where amidships is on the scale from -1 to 1")] = 0.0
    reversed: Annotated[bool, RESTART, Bounds(None, None, "orders go out to the other side")] = False
    current_max_a: Annotated[float, RESTART, Bounds(0.1, 60.0, "motor current of a stall")] | None = None
    channel: Annotated[int, RESTART, Bounds(0, 23, "servo channel of a Maestro; of two valves that to port")] = 0
    device: Annotated[int, RESTART, Bounds(0, 127, "Pololu device number; null: compact protocol")] | None = None
    valve: Valves | None = None
    """Of valve:PATH:BAUD; null: the numbers above."""
    bow_thruster: BowThruster | None = None
    """null: there is none, or the pilot leaves it alone."""
    rate_hz: Annotated[float, RESTART, Bounds(5.0, 100.0, "how often orders leave")] = 20.0
    source: Annotated[str, RESTART] = ""
    date: Annotated[str, RESTART] = ""


@dataclass(frozen=True)
class Security:
    """Whom ground stations' links hear, and how much. No parameter: it is not tuned from afar."""

    allow_systems: Annotated[
        tuple[Annotated[int, Bounds(1, 255, "MAVLink system id of a ground station")], ...], RESTART
    ] = ()
    """Ground stations that are heard over --serve and --forward; empty: all."""
    allow_addresses: Annotated[tuple[str, ...], RESTART] = ()
    """Addresses and networks that may come to listening links (192.168.1.20, 10.0.0.0/24); empty: all."""
    commands_per_s: Annotated[float, RESTART, Bounds(0.1, 1000.0, "commands taken, four seconds' worth at once")] = 10.0
    writes_per_s: Annotated[
        float, RESTART, Bounds(0.1, 1000.0, "parameter writes taken, four seconds' worth at once")
    ] = 25.0
    orders_without_key: Annotated[bool, RESTART, Bounds(None, None, "orders are taken without a signing key")] = False
    """Whether orders are taken over --serve from other machines and serial lines where no signing key is set."""


@dataclass(frozen=True)
class Vessel:
    """One boat: identity, identified model, rudder, sensors, gains, limits and fail-safes."""

    schema_version: Annotated[int, NOW]
    name: Annotated[str, NOW]
    model: Model
    rudder: Rudder
    description: Annotated[str, NOW] = ""
    length_m: Annotated[float, NOW, Bounds(0.2, 500.0, "length, to compare the boat with others")] | None = None
    sensors: Sensors = field(default_factory=Sensors)
    control: Control = field(default_factory=Control)
    guidance: Guidance = field(default_factory=Guidance)
    estimator: Estimator = field(default_factory=Estimator)
    limits: Limits = field(default_factory=Limits)
    failsafe: Failsafe = field(default_factory=Failsafe)
    alarms: Alarms = field(default_factory=Alarms)
    helm: Helm = field(default_factory=Helm)
    drive: Drive = field(default_factory=Drive)
    security: Security = field(default_factory=Security)


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


def drive_law_of(vessel: Vessel) -> DriveLaw:
    """Return how K and T go with speed and throttle: the file's numbers, or what is usual for the kind of drive."""
    usual, model = DRIVES[vessel.drive.kind].usual, vessel.model
    if usual.is_rudder:
        return usual
    return DriveLaw(
        usual.speed_exponent if model.speed_exponent is None else model.speed_exponent,
        usual.throttle_exponent if model.throttle_exponent is None else model.throttle_exponent,
        usual.damping_share if model.damping_share is None else model.damping_share,
        math.nan if model.reference_throttle is None else model.reference_throttle,
        usual.way_exponent if model.way_exponent is None else model.way_exponent,
        usual.slowest if model.slowest_m_s is None else model.slowest_m_s / model.reference_speed_m_s,
        usual.fastest if model.fastest_m_s is None else model.fastest_m_s / model.reference_speed_m_s,
    )
