"""Control authority: whether the vehicle lets us steer, and if not, the one sentence that says why. Pure.

Only what the vehicle shows counts: mode and arming from its heartbeat, the ground-station id from its parameters, and,
while we steer, the echo of our override: our own pulse seen again in RC_CHANNELS or the servo moving in
SERVO_OUTPUT_RAW. A bow thruster's channel has an echo of its own.

Whether the hand's radio still reaches the flight controller. While we override the steering, ArduPilot takes our
messages for radio input: a receiver that just falls silent makes no fail-safe, and RC_CHANNELS goes on showing its last
pulses and its count of channels. What does show of a lost radio:

- a receiver that sends a throttle below FS_THR_VALUE: the pulse in RC_CHANNELS, and the firmware's own fail-safe;
- RC_CHANNELS.rssi where it is measured beside the frames (RSSI_TYPE 1 or 4, a voltage or pulse), 255 where it is not;
- SYS_STATUS, MAV_SYS_STATUS_SENSOR_RC_RECEIVER: ArduRover 4.6 sets it never, other vehicles do;
- STATUSTEXT "Radio Failsafe" and, when it is over, "... Failsafe Cleared".

Source: ArduPilot, Rover/radio.cpp (radio_failsafe_check), Rover/failsafe.cpp, Rover/GCS_Rover.cpp,
libraries/RC_Channel/RC_Channels.cpp (read_input), libraries/AP_RSSI.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Iterable, Sequence

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.overrides import ECHO_PATIENCE_S, OverrideEcho, agrees_with, differing
from autopilot.links.mavlink.requests import (
    IGNORES_OVERRIDES,
    OVERRIDE_TIME,
    SPEED_SCALING,
    TWO_PADDLES,
    VehicleParameters,
)
from autopilot.models.drives import DRIVES
from autopilot.signals import HelmCause

MANUAL_MODE = 0
GUIDED_MODE = 15
OFFBOARD_MODE = 6 << 16
PX4_MAIN, PX4_AUTO = "Manual Altitude Position Auto Acro Offboard Stabilised", "Ready Takeoff Hold Mission Return Land"
MODE_NAMES = {
    0: "MANUAL",
    1: "ACRO",
    3: "STEERING",
    4: "HOLD",
    5: "LOITER",
    6: "FOLLOW",
    7: "SIMPLE",
    8: "DOCK",
    9: "CIRCLE",
    10: "AUTO",
    11: "RTL",
    12: "SMART_RTL",
    15: "GUIDED",
    16: "INITIALISING",
    **dict(zip(range(1 << 16, 8 << 16, 1 << 16), PX4_MAIN.split(), strict=True)),
    **{4 << 16 | sub << 24: name for sub, name in enumerate(PX4_AUTO.split(), 1)},
    **{4 << 16 | (10 + number) << 24: f"External {number}" for number in range(1, 9)},
    10 << 16: "Termination",
}
"""ArduRover's custom modes, and PX4's, main mode << 16 | sub mode << 24 (Rover/mode.h; px4_custom_mode.h)."""
TERMINATED_STATE = 8
"""MAV_STATE of a PX4 whose outputs the kill switch has stopped; it counts as armed for some seconds more."""
STARTING = {
    dialect.MAV_STATE_UNINIT: "UNINIT",
    dialect.MAV_STATE_BOOT: "BOOT",
    dialect.MAV_STATE_CALIBRATING: "CALIBRATING",
}
"""MAV_STATE of a vehicle that has not come up; all beyond them has."""
STARTS = (
    "the vehicle says that it still starts up (MAV_STATE {name}) and is not asked for anything before it has; read its "
    "messages, let it lie still, and restart it where it stays so"
)
CALIBRATES = (
    "the vehicle says that it calibrates (MAV_STATE {name}) and is not asked for anything before it has: where it has "
    "just been switched on let it lie still; where its compass, gyro or radio is calibrated end that at the ground "
    "station; restart it where it stays so"
)
"""ArduPilot says so while it starts (Rover, mode INITIALISING), PX4 while a calibration runs, of which that of the
compass wants it turned (streams/HEARTBEAT.hpp)."""
TWINS = (
    "two vehicles with one system id are heard on this line, so that orders for one reach both: give each an id of its "
    "own (MAV_SYSID or SYSID_THISMAV; MAV_SYS_ID of a PX4), or switch one off"
)
TWINS_LAST_S, SAME_START_S, STARTS_KEPT = 30.0, 1.0, 8
"""So long [s] after two vehicles were seen last they are said; what began within so much [s] is one; so many
beginnings are kept."""
HEARTBEAT_S = 1.0
SILENCE_S = 3.0
"""Nothing at all from the vehicle for this long ends our right to steer."""
COUNTED_S = 10.0
"""A silence is said by the second up to so long, behind it in such steps."""
HEARTBEAT_TIMEOUT_S = 8.0
"""Heartbeats get lost one by one on a bad line; without any for this long nobody knows the mode."""
BLIND_S = 3.0
"""Steering without any report of the rudder is ended after this."""
FORGIVEN_S = 2.0
"""This long after our last command a rudder that did not obey may be tried again."""
STRANGE_REPORTS = 3
STRANGE_S = 10.0
STRANGE_LASTS_S = 8.0
"""So many reports of the input within this time are somebody else's, who tries every few seconds; the alarm lasts from
one of their tries to the next."""
CONTEST_GAP_S, CONTEST_S = 2.5, 3.0
"""Strange reports no further apart, for so long, are somebody who steers too, at however small a share of the time: at
nearly the reports' own rate their pulses hide behind ours for seconds. Another pilot's proof comes every four."""
TAKEN_FOR_A_MOMENT = "the mode, the arming or the radio's switch was changed and changed back"
SWITCH_LOW_US = 1200
"""Below this a switch is in its low position (libraries/RC_Channel, AuxSwitchPos)."""
STICK_MOVED_US = 150
"""A stick that is moved this far is meant."""


NOT_HEARD = "waiting for the heartbeat of a vehicle"


class ControlAuthority:
    """Collects what the vehicle shows; `reason` gives the sentence, or nothing where control is ours.

    Args:
        guided: whether we steer by heading targets in GUIDED mode, rather than by the rudder in MANUAL.
        offboard: whether we do by velocities in PX4's Offboard mode, of whose parameters and reports nothing is known.
        may_share: whether others may override the steering input beside us.

    Attributes:
        obstacle: why this vehicle cannot be steered at all; empty where it can.
        misfit: why its steering parameters cannot be used; empty where they can.
        mode, armed, heartbeat_time: from the last heartbeat, -inf before the first.
        booted: whether the vehicle has come up far enough to take commands: earlier ones can crash the firmware.
        received_time: when the vehicle last sent anything.
        steering: whether we have commanded something that we have not released.
        last_command: when something was commanded last, -inf before.
        disobeyed: why the rudder did not obey while we steered; empty where it did.
    """

    def __init__(self, guided: bool = False, offboard: bool = False, may_share: bool = False) -> None:
        self._guided, self._offboard, self._may_share = guided or offboard, offboard, may_share
        self._is_killed = False
        self.obstacle = NOT_HEARD
        self.misfit = ""
        self.mode = -1
        self.armed = self.booted = False
        self._state = -1
        self.heartbeat_time = self.received_time = -math.inf
        self.steering = False
        self.disobeyed = ""
        self.echo = OverrideEcho()
        self.last_command = -math.inf
        self._strange: deque[float] = deque(maxlen=STRANGE_REPORTS)
        self._strange_until = -math.inf
        self._contested = (-math.inf, -math.inf)
        """Since when, and when last, the input has shown pulses that are none of ours."""
        self._stood: dict[int, int] = {}
        self.cause = HelmCause.TAKEN
        """What kind the reason given last is of."""
        self.stood_still = 0.0
        """For how long [s] no command left while we steered, where the vehicle has let go meanwhile; whoever sees to it
        that we steer no more sets it back to 0."""
        self.radio = ""
        """Why the radio counts as lost; empty while it does not."""
        self.switched_off = False
        """Whether the radio's switch for overrides is off."""
        self.is_safe = False
        """Whether the vehicle's safety switch keeps its outputs still."""
        self.another_steers = False
        """Whether another pilot has said last that it steers."""
        self._rebooted = False
        self._starts: deque[tuple[float, float]] = deque(maxlen=STARTS_KEPT)
        """When [s] one clock was left for another, and when [s] by either of them the vehicle had begun."""
        self._twins_until = -math.inf
        self._judged: tuple[int, int] | None = None
        self._parameter_reason = ""

    def heartbeat(self, now: float, mode: int, armed: bool, system_state: int) -> None:
        """Take the vehicle's heartbeat."""
        self.heartbeat_time = now
        self.mode = mode
        self.armed = armed
        self._state, self.booted = system_state, system_state not in STARTING
        self._is_killed = system_state == TERMINATED_STATE
        self._note_taken()

    def switch(self, is_off: bool) -> None:
        """Take how the radio's switch for overrides stands."""
        self.switched_off = is_off
        self._note_taken()

    def _note_taken(self) -> None:
        """Keep that the helm was taken: it may be given back before anybody looks, where reports come in one go."""
        if self.steering and self._state_reason():
            self.disobeyed = TAKEN_FOR_A_MOMENT

    def commanded(self, now: float, pulse: int | None) -> None:
        """Take a command as it was sent: the input pulse [us] it asks for, None where it asks for a heading."""
        if not self.steering:
            self.steering = True
            self._strange.clear()  # the proof since has shown that they are gone
            self._strange_until = -math.inf
        self.last_command = now
        self.echo.commanded(now, pulse)

    def rebooted(self, now: float, left: float, begun: float) -> None:
        """Forget what the vehicle showed before it restarted: it is disarmed and must be asked anew.

        By the clock that was followed it had begun at `left` [s], by that which is now at `begun` [s]. No vehicle
        begins anew at a time at which it has begun before: that is the other one of two.
        """
        if any(now - when <= TWINS_LAST_S and abs(begun - each) <= SAME_START_S for when, each in self._starts):
            self._twins_until = now + TWINS_LAST_S
        self._starts.extend(((now, left), (now, begun)))
        self._rebooted = True
        self._state, self.armed, self.booted = -1, False, False
        self.released()
        self.misfit = self.radio = ""
        self.is_safe = False

    def let_go(self, now: float) -> None:
        """Take that no command left for so long that the vehicle has let go.

        Called before what piled up meanwhile is read: reports of a rudder that is not ours accuse nobody.
        """
        self.stood_still = now - self.last_command
        self.released()

    def released(self) -> None:
        """Take note that we no longer steer."""
        if self.steering:
            self.steering = False
            self.echo.released()

    @property
    def steers_by_hand(self) -> bool:
        """Whether the vehicle is in the mode, and armed, in which the steering input moves the rudder."""
        return self.armed and self.mode == MANUAL_MODE

    def inputs(self, now: float, pulses: Sequence[int], parameters: VehicleParameters) -> bool:
        """Take what RC_CHANNELS shows: the pulse [us] of each channel at its number, 0 where there is none; return
        whether the steering input may show an order of ours that came behind its release."""
        number, switch = parameters.steering_input, parameters.override_switch
        assert number is not None
        if switch is not None:
            self.switch(0 < pulses[switch] < SWITCH_LOW_US)
        pulse = pulses[number]
        if self._guided:
            self.sticks((*parameters.free_sticks, number), pulses)  # nobody overrides it: it shows the hand
            return False
        self.sticks(parameters.free_sticks, pulses)
        if recent := self.echo.pulses:
            self.seen(now, f"RC channel {number}", pulse, recent, is_input=True)
        is_meant = self.steering or self.another_steers or self._may_share
        return not is_meant and self.echo.acts_again(now, pulse)

    def others_override(self, now: float) -> bool:
        """Return whether the steering input has shown pulses of late that are none of ours, while we steer."""
        return self.steering and now <= self._strange_until

    def seen(self, now: float, what: str, pulse: int, expected: Collection[int], is_input: bool = False) -> None:
        """Compare a reported `pulse` [us] with those that the commands of late ask for; `OverrideEcho.shows`.

        `is_input`: it is the input that we override.
        """
        echo, agrees = self.echo, pulse in expected or agrees_with(pulse, expected)
        # nobody else's: what was reported before our first command of all arrived there, and an echo that comes late
        if is_input and not agrees and now - echo.began > ECHO_PATIENCE_S and not echo.is_late(pulse):
            self._strange.append(now)
            if len(self._strange) == STRANGE_REPORTS and now - self._strange[0] <= STRANGE_S:
                self._strange_until = now + STRANGE_LASTS_S
            since, last = self._contested
            self._contested = (since if now - last <= CONTEST_GAP_S else now, now)
            if now - self._contested[0] > CONTEST_S and not self._may_share:
                shown = differing(what, pulse, expected)
                self.disobeyed = f"another ground station steers, or a pilot: {shown}; stop one of the two"
        if echo.disagrees(now, what, agrees):
            self.disobeyed = (
                f"the rudder does not obey: {differing(what, pulse, expected)} "
                "(radio override switched off, or another ground station steers)"
            )

    def refuse(self, sentence: str) -> None:
        """Give the helm up for a reason that was found elsewhere."""
        self.disobeyed = sentence

    def sticks(self, numbers: Iterable[int], pulses: Sequence[int]) -> None:
        """Take where the sticks of these `numbers` stand, none of which steers: moved while we steer, it takes the
        helm."""
        stood = self._stood
        for number in numbers:
            pulse = pulses[number]
            if not self.steering or not pulse:
                stood.pop(number, None)
            elif number not in stood:
                stood[number] = pulse
            elif not -STICK_MOVED_US <= pulse - stood[number] <= STICK_MOVED_US:
                self.disobeyed = f"the stick on RC channel {number} was moved"

    def cleared_by_stick(self) -> None:
        """Take that the firmware has ended our overrides because a stick was moved (RC_OPTIONS bit 14)."""
        self.disobeyed = (
            "the stick was moved: the helm is yours; before you engage again centre it and switch radio override off "
            "and on (RCn_OPTION 46)"
        )

    def reason(self, now: float, parameters: VehicleParameters, system: int) -> str:
        """Return why the vehicle does not let `system` steer at `now` [s], empty when it does; `cause` is of it."""
        self.cause = HelmCause.TAKEN
        if self.stood_still:
            self.cause = HelmCause.STOOD_STILL
            return f"this computer stood still for {self.stood_still:.1f} s: the vehicle has taken the rudder back"
        if self.obstacle:
            return self.obstacle
        if now <= self._twins_until:
            return TWINS
        silence = now - self.heartbeat_time
        if silence > HEARTBEAT_TIMEOUT_S or now - self.received_time > SILENCE_S:
            self.cause = HelmCause.SILENT
            said = silence if silence < COUNTED_S else silence // COUNTED_S * COUNTED_S
            return f"no heartbeat from the vehicle for {said:.0f} s"
        judged = (parameters.revision, system)
        if judged != self._judged:
            self._judged = judged
            asks = not self._offboard
            self._parameter_reason = _parameter_reason(parameters, system, self._guided) if asks else ""
        waiting = self._parameter_reason or ("" if self._guided else self.misfit)
        if self._state in STARTING and not self.steering:
            words = CALIBRATES if self._state == dialect.MAV_STATE_CALIBRATING else STARTS
            waiting = words.format(name=STARTING[self._state])
        if waiting and self._rebooted:
            self.cause = HelmCause.REBOOTED
            return f"the vehicle has rebooted; {waiting}"
        self._rebooted = False
        if waiting and (lost := self._recent(now)):
            return f"{lost}; {waiting}"
        if self.radio and not waiting:
            self.cause = HelmCause.RADIO_LOST
        if found := waiting or self.radio or self._state_reason():
            return found
        if self.disobeyed and (found := self._recent(now)):
            return found
        # where the heartbeats stay away too, silence is the better word
        talks = self.received_time > self.echo.report_time + HEARTBEAT_S
        return self._blindness(now) if self.steering and talks and not self._offboard else ""

    def _state_reason(self) -> str:
        needed, ours = (GUIDED_MODE, "heading targets") if self._guided else (MANUAL_MODE, "rudder commands")
        needed = OFFBOARD_MODE if self._offboard else needed
        if self.mode != needed:
            name = MODE_NAMES.get(self.mode, f"{self.mode}, which is not known here")
            return f"the vehicle is in mode {name}, where {ours} are not obeyed; switch it to {MODE_NAMES[needed]}"
        if not self.armed:
            return "the vehicle is disarmed; arm it"
        if self._is_killed:
            return "the vehicle's outputs are stopped (kill switch or termination); release it, and arm anew"
        if self.is_safe and not self._offboard:
            return "the vehicle's safety switch keeps its outputs still; press it"
        if self.switched_off and not self._guided:
            return "the radio's switch for overrides is off; switch it on"
        return ""

    def _recent(self, now: float) -> str:
        if now - self.last_command > FORGIVEN_S:
            self.disobeyed = ""
        return self.disobeyed

    def _blindness(self, now: float) -> str:
        if now - self.echo.report_time <= BLIND_S:
            return ""
        if self._guided:
            return "the vehicle reports no NAV_CONTROLLER_OUTPUT, so nobody can see it take our headings"
        return "the vehicle reports neither RC_CHANNELS nor SERVO_OUTPUT_RAW, so nobody can see the rudder obey"


def _parameter_reason(parameters: VehicleParameters, system: int, guided: bool) -> str:
    gcs = parameters.gcs_system
    if gcs is not None and not parameters.obeys(system) and not guided:
        return f"the vehicle obeys only system id {gcs}; start with --as-gcs or set {parameters.gcs_name} to {system}"
    if parameters.gcs_impossible:
        return f"the vehicle's {parameters.gcs_name} is no system id; set it to 255"
    if not parameters.complete:
        unanswered = ", ".join(parameters.unanswered[:5])
        if unanswered:
            return (
                f"the vehicle does not answer when asked for {unanswered}; check that both directions of the link "
                "work, and start with --as-gcs if its SYSID_ENFORCE is 1"
            )
        return "reading the vehicle's parameters"
    if guided:
        return ""
    if parameters.steering_input is None:
        return "the vehicle's RCMAP_ROLL names no input channel from 1 to 16; correct it"
    if (steering := parameters.steering_input) == parameters.get("RCMAP_THROTTLE"):
        return f"RCMAP_ROLL and RCMAP_THROTTLE are both {steering}: to steer would work the throttle; correct one"
    return _without_outputs(parameters) if parameters.steering_servo is None else _input_reason(parameters)


def _input_reason(parameters: VehicleParameters) -> str:
    """Return why the vehicle does not make of the steering input what we mean."""
    if parameters.get("PILOT_STEER_TYPE") == TWO_PADDLES:
        usual = 3 if parameters.drive.is_mixed else 0
        return f"PILOT_STEER_TYPE is 1 (two paddles), which takes no steering; set it to {usual}"
    if int(parameters.get("MANUAL_OPTIONS") or 0.0) & SPEED_SCALING:
        return "MANUAL_OPTIONS has bit 0 set, so the firmware steers by less the faster the boat is; set it to 0"
    if int(parameters.get("RC_OPTIONS") or 0.0) & IGNORES_OVERRIDES:
        return "RC_OPTIONS has bit 1 set: the vehicle ignores every override; take 2 out of it"
    if (seconds := parameters.get(OVERRIDE_TIME)) is not None and (what := _wrong_lapse(seconds)):
        return f"the vehicle's RC_OVERRIDE_TIME is {seconds:g}, which {what}; set it to 3"
    return ""


SHORTEST_LAPSE_S, LONGEST_LAPSE_S = 0.5, 10.0
"""Orders may be so far apart on a line that loses some; a rudder that its pilot has left is not to stand for longer."""


def _wrong_lapse(seconds: float) -> str:
    """Return what is wrong with an RC_OVERRIDE_TIME [s], '' where nothing is."""
    if seconds == 0.0:
        return "forbids overrides"
    if 0.0 < seconds < SHORTEST_LAPSE_S:
        return "takes the rudder back between two orders"
    if seconds < 0.0 or seconds > LONGEST_LAPSE_S:
        return f"would keep the rudder for {'good' if seconds < 0.0 else f'{seconds:g} s'} where this line breaks"
    return ""


def _without_outputs(parameters: VehicleParameters) -> str:
    """Return what to do where no outputs carry the steering as the drive of the vessel file wants them."""
    drive, there = parameters.drive, parameters.found_functions
    words = ", ".join(str(function) for function in drive.outputs)
    found = next((kind for kind in DRIVES.values() if there and there.issuperset(kind.outputs)), None)
    if found is not None:
        has = " and ".join(str(function) for function in found.outputs)
        return (
            f"drive.kind is {drive.name}, and the vehicle's outputs have the function {has}, which is {found.name}: "
            f"set drive.kind: {found.name} in the vessel file and identify the boat with it, or {drive.advice}"
        )
    half = f"; of {words} only {', '.join(map(str, sorted(there)))} is there" if there else ""
    return f"no servo outputs have the function {words} that drive.kind {drive.name} steers by{half}; {drive.advice}"


RECEIVER = dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
LASTS_S = 0.3
"""Longer than one or two odd reports at 10 Hz."""
RSSI_UNKNOWN = 255
RSSI_THERE, RSSI_GONE = 26, 5
"""A tenth and a fiftieth of RC_CHANNELS.rssi's 254."""
SETTLES_S = 1.5
"""A heartbeat that says critical may be so much older than the text about the fail-safe."""


class RadioWatch:
    """Takes what the vehicle says of its radio; `reason` has the sentence for a lost one, where there is one.

    Attributes:
        found: what shows that the radio is lost, as sentences by where it shows.
    """

    def __init__(self) -> None:
        self.found: dict[str, str] = {}
        self._since: dict[str, float] = {}
        self._seen: set[str] = set()
        self._text_time = math.nan

    def reason(self, parameters: VehicleParameters) -> str:
        """Return why the radio counts as lost; empty where it does not, or where the firmware does without it."""
        return "" if parameters.get("FS_THR_ENABLE") == 0.0 else next(iter(self.found.values()), "")

    def channels(self, now: float, pulses: Sequence[int], rssi: int, parameters: VehicleParameters) -> None:
        """Take RC_CHANNELS: how many channels there are, and behind it their pulses [us], each at its number. A vehicle
        without a radio does not lose it."""
        seen, count = self._seen, pulses[0]
        if RSSI_THERE <= rssi < RSSI_UNKNOWN:
            seen.add("rssi")
        if count > 0 and "count" not in seen:
            seen.add("count")
        limit, channel = parameters.throttle_failsafe, parameters.throttle_input
        pulse = pulses[channel] if limit is not None else 0
        is_low = limit is not None and 0 < pulse < limit
        is_weak, has_none = "rssi" in seen and rssi <= RSSI_GONE, "count" in seen and count == 0
        if is_low or is_weak or has_none or self._since:
            words = f"throttle, RC channel {channel}, is at {pulse} us, below FS_THR_VALUE"
            self._judge(now, "throttle", is_low, words)
            self._judge(now, "rssi", is_weak, f"its strength (rssi) has fallen to {rssi} of 254")
            self._judge(now, "count", has_none, "its receiver sends no channels")

    def status(self, enabled: int, health: int) -> None:
        """Take SYS_STATUS: its sensors enabled and healthy."""
        is_well = bool(enabled & health & RECEIVER)
        if is_well:
            self._seen.add("status")
        is_gone = "status" in self._seen and bool(enabled & RECEIVER) and not is_well
        self._set("status", is_gone, "the vehicle says that its receiver is not well")

    def text(self, now: float, words: str) -> None:
        """Take a STATUSTEXT."""
        if "Failsafe Cleared" in words:
            self._set("text", False, "")
        elif words.startswith("Radio Failsafe"):
            self._text_time = now
            self._set("text", True, "the vehicle is in its radio fail-safe")

    def heartbeat(self, now: float, system_state: int) -> None:
        """Take the vehicle's MAV_STATE: a fail-safe that is over is no longer critical, though its text was lost."""
        if system_state != dialect.MAV_STATE_CRITICAL and now - self._text_time > SETTLES_S:
            self._set("text", False, "")

    def _judge(self, now: float, what: str, is_gone: bool, sentence: str) -> None:
        if not is_gone:
            self._since.pop(what, None)
        lasts = is_gone and now - self._since.setdefault(what, now) >= LASTS_S
        self._set(what, lasts, sentence)

    def _set(self, what: str, is_gone: bool, sentence: str) -> None:
        if is_gone:
            self.found[what] = f"the radio is lost: {sentence}"
        else:
            self.found.pop(what, None)
