"""The links: whether headings come, how often, how evenly, and whether the helm would be ours. Nothing is steered.

With them the flight controller's parameters that fight the pilot, or the hand that wants the helm back, and what sends
at all on this machine's lines. What each parameter means for Norrbin: docs/flight_controllers.md. Source: ArduPilot,
Rover/failsafe.cpp, Rover/radio.cpp, libraries/RC_Channel/RC_Channels.cpp, libraries/AP_Arming.
"""

from __future__ import annotations

import itertools
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from autopilot.doctor.machine import Finding, Verdict, serial_devices, share_below
from autopilot.links.base import Link, LinkError, parted
from autopilot.links.mavlink.companion import CompanionLink
from autopilot.links.mavlink.requests import SPEED_SCALING, TWO_PADDLES, VehicleParameters
from autopilot.links.mavlink.steering import REACH_TOLERANCE_DEG, channel_of, share_from_servo
from autopilot.links.url import HEADING_SENTENCES, MAVLINK_HEADING, message_names, open_transport, sentence_names
from autopilot.runtime.machine import Clock
from autopilot.signals import AlarmEvent, AlarmSample, HeadingSample, HelmSample, RateSample
from autopilot.supervision.panel import sentences_of
from autopilot.vessel.schema import Vessel

IGNORE_RECEIVER, IGNORE_OVERRIDES, IGNORE_FAILSAFE, CLEAR_BY_STICK = 1 << 0, 1 << 1, 1 << 2, 1 << 14
"""RC_OPTIONS."""
STICK_ARMS, STICK_DISARMS = 1, 2
"""ARMING_RUDDER."""
UNEVEN = 0.05
"""A servo that goes further to one side by more than this share."""
PAGE = "docs/flight_controllers.md"


def firmware_findings(parameters: VehicleParameters, vessel: Vessel | None = None) -> list[Finding]:
    """Return what the parameters that have come mean for steering this vessel; nothing of those that have not."""
    looked = [_arming(parameters), _radio(parameters), _station(parameters), _action(parameters), _takeover(parameters)]
    if vessel is not None and not vessel.helm.firmware_steers:
        looked += [_servo(parameters, vessel), _stick(parameters)]
    return [finding for finding in looked if finding is not None]


def _arming(parameters: VehicleParameters) -> Finding | None:
    option = parameters.get("ARMING_RUDDER")
    if option is None:
        return None
    if option == STICK_DISARMS:
        found = "ARMING_RUDDER 2: some seconds of hard port rudder at neutral throttle, ours too, disarm the boat"
        return Finding("arming", Verdict.WARN, found, "set ARMING_RUDDER 0, as ardurover-boat does")
    what = "arms a boat that is disarmed" if option == STICK_ARMS else "neither arms nor disarms"
    return Finding("arming", Verdict.GO, f"the rudder {what} (ARMING_RUDDER {option:.0f})")


def _radio(parameters: VehicleParameters) -> Finding | None:
    option, limit = parameters.get("FS_THR_ENABLE"), parameters.get("FS_THR_VALUE")
    if option is None or limit is None:
        return None
    if option == 0.0:
        found = "FS_THR_ENABLE 0: nobody notices a lost radio, the throttle stays where its stick was"
        return Finding("radio fail-safe", Verdict.WARN, found, "set FS_THR_ENABLE 1 where there is a radio")
    if int(parameters.get("RC_OPTIONS") or 0) & IGNORE_FAILSAFE:
        found = "RC_OPTIONS bit 2: what the receiver sends after it has lost the radio counts as the stick"
        return Finding("radio fail-safe", Verdict.WARN, found, "take bit 2 (4) out of RC_OPTIONS")
    found = (
        f"acts on a throttle below {limit:.0f} us; a receiver that falls silent is not noticed while we steer ({PAGE})"
    )
    return Finding("radio fail-safe", Verdict.GO, found)


def _station(parameters: VehicleParameters) -> Finding | None:
    option, timeout = parameters.get("FS_GCS_ENABLE"), parameters.get("FS_GCS_TIMEOUT")
    if option is None:
        return None
    if option == 0.0:
        return Finding("station fail-safe", Verdict.GO, "off: the boat goes on when Norrbin leaves or dies")
    after = "" if timeout is None else f", {timeout:g} s and FS_TIMEOUT later"
    found = f"FS_GCS_ENABLE {option:.0f}: the boat stops when Norrbin has left{after}, also where a hand steers by then"
    return Finding("station fail-safe", Verdict.WARN, found, "set FS_GCS_ENABLE 0 where somebody holds the radio")


def _action(parameters: VehicleParameters) -> Finding | None:
    if parameters.get("FS_ACTION") != 0.0:
        return None
    found = "FS_ACTION 0: a fail-safe of the firmware drops our orders and leaves mode and engine as they are"
    return Finding("fail-safe action", Verdict.WARN, found, "set FS_ACTION 2 (hold)")


def _takeover(parameters: VehicleParameters) -> Finding | None:
    """How a hand on the radio takes the helm, other than by the mode or disarming."""
    if (known := parameters.get("RC_OPTIONS")) is None:
        return None
    options, switch = int(known), parameters.override_switch
    name = "taking over"
    if options & IGNORE_OVERRIDES:
        found = "RC_OPTIONS bit 1: the vehicle ignores every override"
        return Finding(name, Verdict.NO_GO, found, "take bit 1 (2) out of RC_OPTIONS")
    if options & IGNORE_RECEIVER:
        found = "RC_OPTIONS bit 0: the vehicle ignores its radio, nobody can take over by it"
        return Finding(name, Verdict.WARN, found, "take bit 0 (1) out of RC_OPTIONS")
    if options & CLEAR_BY_STICK:
        if switch is not None:
            return Finding(
                name, Verdict.GO, f"the stick ends overrides, the switch on channel {switch} allows them again"
            )
        found = "the stick ends overrides (RC_OPTIONS bit 14), and only a reboot allows them again"
        return Finding(name, Verdict.WARN, found, "give a switch of the radio RCn_OPTION 46")
    if switch is not None:
        return Finding(
            name, Verdict.GO, f"by the override switch on channel {switch}; the steering stick alone does nothing"
        )
    found = "only another mode or disarming takes the helm: the steering stick does nothing while we steer"
    cure = f"give a switch RCn_OPTION 46, or from ArduRover 4.8 on add bit 14 (16384) to RC_OPTIONS too ({PAGE})"
    return Finding(name, Verdict.WARN, found, cure)


def _servo(parameters: VehicleParameters, vessel: Vessel) -> Finding | None:
    """What the end points of the steering servo are in degrees of rudder, by the vessel file."""
    channel, number, helm = channel_of(parameters), parameters.steering_servo, vessel.helm
    if channel is None:
        return None
    if parameters.drive.is_mixed:
        return _thrusters(parameters, vessel)
    full = helm.rudder_at_full_pwm_deg or vessel.rudder.angle_max_deg
    low, middle, high = channel.servo_min, channel.servo_trim, channel.servo_max
    ends = f"SERVO{number} goes from {low} over {middle} to {high} us"
    if helm.servo_us is not None:
        scaled = channel._replace(scale=helm.servo_us)
        least, most = sorted(full * share_from_servo(scaled, end) for end in (low, high))
        found = f"{ends}, {-least:.0f} and {most:.0f} deg of rudder by helm.servo_us"
        able = vessel.rudder.angle_max_deg
        if min(-least, most) < able - REACH_TOLERANCE_DEG:
            cure = f"rudder.angle_max_deg is {able:g}: widen SERVO{number}_MIN and _MAX, lower rudder.angle_max_deg"
            return Finding("servo", Verdict.NO_GO, found, f"{cure}, or measure helm.servo_us anew")
        return Finding("servo", Verdict.GO, found)
    if abs(high - 2 * middle + low) > UNEVEN * max(middle - low, high - middle):
        found = f"{ends}: {middle - low} us to one side and {high - middle} to the other both count as {full:g} deg"
        return Finding("servo", Verdict.WARN, found, "measure the angle at two pulses and write helm.servo_us")
    return Finding("servo", Verdict.GO, f"{ends}, taken for {full:g} deg to each side; helm.servo_us would pin it")


DIRECTION_UNCHANGED = 3.0
"""PILOT_STEER_TYPE (Rover/Parameters.cpp)."""


def _stick(parameters: VehicleParameters) -> Finding | None:
    """What the firmware makes of the steering input beside its curve; a rudder is turned round once more than thrust
    where the throttle is astern (AP_MotorsUGV.cpp, output_regular)."""
    stick, options = parameters.get("PILOT_STEER_TYPE"), parameters.get("MANUAL_OPTIONS")
    if stick is None:
        return None
    is_mixed = parameters.drive.is_mixed
    found, usual = f"PILOT_STEER_TYPE is {stick:g}", DIRECTION_UNCHANGED if is_mixed else 0.0
    if stick == TWO_PADDLES:
        cure = f"set it to {usual:g}: with 1 the steering channel is the left paddle, and takes no steering"
        return Finding("stick", Verdict.NO_GO, found, cure)
    if int(options or 0.0) & SPEED_SCALING:
        found = "MANUAL_OPTIONS bit 0: the firmware steers by less the faster the boat is"
        return Finding("stick", Verdict.NO_GO, found, "take bit 0 (1) out of MANUAL_OPTIONS")
    if (stick == DIRECTION_UNCHANGED) is not is_mixed:
        cure = f"set it to {usual:g}, or steering turns round where the throttle is astern"
        return Finding("stick", Verdict.WARN, found, cure)
    return Finding("stick", Verdict.GO, found)


def _thrusters(parameters: VehicleParameters, vessel: Vessel) -> Finding:
    """What two thrusters are set up as."""
    left, right = parameters.steering_servos
    asymmetry = parameters.get("MOT_THST_ASYM")
    found = f"two thrusters: left on SERVO{left}, right on SERVO{right}"
    if asymmetry == 1.0 and vessel.drive.astern_share is None:
        root = "the root of " if vessel.drive.thrust_exponent == 2.0 else ""
        cure = f"set MOT_THST_ASYM to {root}thrust ahead over thrust astern, or a turn without throttle drives it ahead"
        return Finding("thrusters", Verdict.WARN, found, cure)
    return Finding("thrusters", Verdict.GO, found)


SLOW_HZ = 4.0
LEAST_JUDGED = 3
"""Headings at the rate asked for that show a gap and another one; with fewer all of them count."""
PACE_S = 0.05


class Received(NamedTuple):
    """When headings arrived [s] and how old they were [s], by their sources; the last word on the helm, and alarms;
    whether a rate of turn came with the headings or by itself, by its sources; how many headings came before the
    vehicle had them at the rate asked for."""

    arrivals: dict[str, list[float]]
    ages: dict[str, list[float]]
    helm: dict[str, str]
    alarms: dict[str, AlarmEvent | None]
    seconds: float
    turning: dict[str, bool]
    early: dict[str, int]


def listen(links: Sequence[Link], clock: Clock, seconds: float) -> Received:
    """Listen for so long. Raises LinkError where a link is lost."""
    received = Received(defaultdict(list), defaultdict(list), {}, {}, seconds, {}, {})
    end = clock.now() + seconds
    while (now := clock.now()) < end:
        for link in links:
            for sample in link.receive(now):
                _take(received, now, sample)
                if isinstance(sample, HeadingSample) and isinstance(link, CompanionLink) and link.session.awaits_rate:
                    received.early[sample.source] = len(received.arrivals[sample.source])
            link.poll(now)
        clock.wait([fd for fd in (link.fileno() for link in links) if fd >= 0], min(end, now + PACE_S))
    return received


def _take(received: Received, now: float, sample: object) -> None:
    if isinstance(sample, HeadingSample):
        received.arrivals[sample.source].append(now)
        received.ages[sample.source].append(now - sample.time)
        if sample.rate is not None:
            received.turning[sample.source] = True
    elif isinstance(sample, RateSample):
        received.turning[sample.source] = True
    elif isinstance(sample, HelmSample):
        received.helm[sample.source] = "" if sample.available else sample.reason
    elif isinstance(sample, AlarmSample):
        received.alarms[sample.source] = sample.event


def nothing_known() -> str:
    """Return '': what came over the lines is not known."""
    return ""


def judged(received: Received, timeout: float, came: Callable[[], str] = nothing_known) -> list[Finding]:
    """Return what was heard as findings; `timeout` [s] is the fail-safe's patience with a silent compass."""
    findings = [_heading(source, received, timeout) for source in sorted(received.arrivals)]
    if not findings:
        cure = came() or "check that the compass or vehicle is on, its wiring, and the baud rate"
        findings.append(Finding("heading", Verdict.NO_GO, f"none came in {received.seconds:.0f} s", cure))
    for source, reason in received.helm.items():
        verdict = Verdict.NO_GO if reason else Verdict.GO
        findings.append(Finding("helm", verdict, f"{source}: {reason or 'obeys us'}", "as it says; see --as-gcs"))
    said = sentences_of(event for event in received.alarms.values() if event is not None)
    findings += [Finding("alarm", Verdict.WARN, text, "as it says") for text in said]
    return findings


def _heading(source: str, received: Received, timeout: float) -> Finding:
    # a vehicle that was never asked sends one a second, and is not to be judged by that
    asked = received.arrivals[source][received.early.get(source, 0) :]
    arrivals = asked if len(asked) >= LEAST_JUDGED else received.arrivals[source]
    gaps = [later - sooner for sooner, later in itertools.pairwise(arrivals)]
    if not gaps:
        cure = "check the compass and its wiring"
        return Finding(f"heading {source}", Verdict.NO_GO, f"one in {received.seconds:.0f} s", cure)
    rate = len(gaps) / (arrivals[-1] - arrivals[0]) if arrivals[-1] > arrivals[0] else float("inf")
    usual, longest = share_below(gaps, 0.5), max(gaps)
    jitter = share_below([abs(gap - usual) for gap in gaps], 0.95)
    age = share_below(received.ages[source], 0.5)
    figures = {"rate_hz": rate, "jitter_ms": jitter * 1e3, "longest_gap_ms": longest * 1e3, "age_ms": age * 1e3}
    found = (
        f"{rate:.1f} Hz, 95 % within {jitter * 1e3:.0f} ms of even, longest gap {longest * 1e3:.0f} ms, "
        f"{age * 1e3:.0f} ms old"
    )
    name = f"heading {source}"
    if longest > timeout:
        cure = (
            f"the fail-safe acts after failsafe.heading_timeout_s = {timeout:g}: mend the line, or the rate asked for"
        )
        return Finding(name, Verdict.NO_GO, found, cure, figures)
    verdict = Verdict.WARN if rate < SLOW_HZ or longest > 0.5 * timeout else Verdict.GO
    return Finding(name, verdict, found, "a quicker compass, a higher baud rate, or fewer other sentences", figures)


def gyro_findings(received: Received, vessel: Vessel) -> list[Finding]:
    """Return whether what the gains were designed for is aboard; nothing where it is."""
    is_there, seconds = bool(received.turning), f"in {received.seconds:.0f} s"
    if vessel.sensors.gyro and not is_there:
        found = f"no rate of turn came {seconds}, and the file's gains are for a boat with a gyro (sensors.gyro)"
        return [
            Finding("gyro", Verdict.WARN, found, "set sensors.gyro: false and run autopilot gains again, or mend it")
        ]
    if is_there and not vessel.sensors.gyro:
        found = f"a rate of turn came {seconds} from {', '.join(sorted(received.turning))}"
        cure = "set sensors.gyro: true and run autopilot gains again: the course is held closer with less rudder"
        return [Finding("gyro", Verdict.WARN, found, cure)]
    return []


def examine(
    open_links: Callable[[], list[Link]],
    clock: Clock,
    seconds: float,
    timeout: float,
    vessel: Vessel | None = None,
    came: Callable[[], str] = nothing_known,
) -> list[Finding]:
    """Open links, listen, close them again, and return the findings; of the servo's scale where `vessel` is given.

    `came` says what came over the links where no heading did.
    """
    try:
        links = open_links()
    except LinkError as error:
        return [Finding("link", Verdict.NO_GO, *parted(str(error)))]
    try:
        received = listen(links, clock, seconds)
        findings = judged(received, timeout, came)
        if vessel is not None and received.arrivals:
            findings += gyro_findings(received, vessel)
        for link in links:
            if isinstance(link, CompanionLink):
                findings += firmware_findings(link.session.parameters, vessel)
        return findings
    except LinkError as error:
        return [Finding("link", Verdict.NO_GO, *parted(str(error)))]
    finally:
        for link in links:
            link.release(clock.now())
            link.close()


LISTENED_S = 2.5
"""Two heartbeats, and a slow compass's second sentence."""
PAUSE_S = 0.02
LOOPBACK = ("udpin:127.0.0.1:14550", "nmea-udp:127.0.0.1:10110")
SERIAL = (("serial", 115200), ("serial", 57600), ("nmea", 4800), ("nmea", 38400))
SHOWN = 8
ENOUGH_BYTES = 4096


class Sender(NamedTuple):
    """What was found: the link that reads it, the protocol, its messages by how often they came, and whether there is
    a heading among them."""

    url: str
    protocol: str
    names: tuple[str, ...]
    has_heading: bool

    @property
    def words(self) -> str:
        """The finding for a line of a list."""
        more = ", ..." if len(self.names) > SHOWN else ""
        heading = "with a heading" if self.has_heading else "NO heading among them"
        return f"{self.url}: {self.protocol} ({', '.join(self.names[:SHOWN])}{more}), {heading}"


def candidates(devices: Iterable[Path] | None = None) -> list[str]:
    """Return the links to try: the serial devices that are plugged in, at each usual rate, and the loopback."""
    plugged = sorted(serial_devices() if devices is None else devices)
    return [*LOOPBACK, *(f"{kind}:{device}:{baud}" for device in plugged for kind, baud in SERIAL)]


def sender_of(url: str, data: bytes) -> Sender | None:
    """Return who sent `data` to a link, None where it means nothing there."""
    if url.startswith("nmea"):
        sentences = sentence_names(data)
        heading = any(name in sentences for name in HEADING_SENTENCES)
        return Sender(url, "NMEA 0183", _by_count(sentences), heading) if sentences else None
    messages = message_names(data)
    return Sender(url, "MAVLink", _by_count(messages), MAVLINK_HEADING in messages) if messages else None


def _by_count(names: dict[str, int]) -> tuple[str, ...]:
    return tuple(sorted(names, key=lambda name: (-names[name], name)))


def listened(url: str, seconds: float = LISTENED_S) -> bytes:
    """Return what comes over a link in some seconds; nothing where it cannot be opened."""
    try:
        transport = open_transport(url)
    except LinkError:
        return b""
    came, ends = b"", time.monotonic() + seconds
    try:
        while time.monotonic() < ends and len(came) < ENOUGH_BYTES:
            came += b"".join(transport.receive())
            time.sleep(PAUSE_S)
    except LinkError:
        pass  # unplugged meanwhile: what came, came
    finally:
        transport.close()
    return came


def discover(
    urls: Sequence[str], listen: Callable[[str], bytes] = listened, tell: Callable[[str], None] = lambda url: None
) -> list[Sender]:
    """Return who sends to the links `urls`; a device that was understood is not tried at other rates."""
    found: list[Sender] = []
    for url in urls:
        if any(_device(url) == _device(sender.url) for sender in found):
            continue
        tell(url)
        sender = sender_of(url, listen(url))
        if sender is not None:
            found.append(sender)
    return found


def _device(url: str) -> str:
    """Return the device of a serial link, whatever is spoken on it; other links are each their own."""
    kind, _, rest = url.partition(":")
    return rest.rpartition(":")[0] if kind in ("serial", "nmea") else url
