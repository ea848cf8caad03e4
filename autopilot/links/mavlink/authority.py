"""Control authority: whether the vehicle lets us steer, and if not, the one sentence that says why. Pure.

Only what the vehicle shows counts: mode and arming from its heartbeat, the ground-station id from its parameters, and,
while we steer, the echo of our override: our own pulse seen again in RC_CHANNELS or the servo moving in
SERVO_OUTPUT_RAW. A bow thruster's channel has an echo of its own.

The override probe finds out, before the pilot may engage and without moving the rudder, that our steering is taken.
ArduPilot ignores overrides in silence: from a system id that is not its ground station's, while the pilot's override
switch is off, or when its parameters are other than they were read. So a pulse is sent that differs from the present
one by a few microseconds, inside the dead zone where there is one, and RC_CHANNELS must show exactly that pulse. Then
nothing is sent for a moment, in which it must stay: whoever else overrides the input shows then.

It is proved at the start, so that the skipper hears early of what stands in the way, and anew for each engagement:
another pilot may have taken the helm since.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection
from enum import Enum

from autopilot.links.mavlink.codec import Message
from autopilot.links.mavlink.requests import OVERRIDE_TIME, SPEED_SCALING, TWO_PADDLES, VehicleParameters
from autopilot.links.mavlink.steering import DISTINCT_US, SteeringOutput
from autopilot.models.drives import DRIVES
from autopilot.signals import HelmCause

DISOBEDIENCE_S = 1.0
"""The rudder may differ from the command this long: reports come at 5 to 10 Hz and are as old as the link."""
AGREEMENT_WEIGHT = 0.5
"""Reports that agree make good half as much: a rudder that follows somebody else every other time is found out too."""
PULSE_TOLERANCE_US = 3
HISTORY_S = 1.0
PATIENCE_S = 2.5
"""A slow telemetry radio may take this long from our message to the vehicle's report of it."""


class OverrideEcho:
    """Whether an override shows in what the vehicle reports: one for each channel that is overridden. Times in seconds.

    Attributes:
        began: when the overriding began.  report_time: when something was reported last, -inf before.
        pulses: the input pulses [us] commanded in the `HISTORY_S` before the last command, each once with its last
            time, the newest last.
    """

    def __init__(self) -> None:
        self.began = self.report_time = -math.inf
        self.pulses: dict[int, float] = {}
        self._earlier: dict[int, float] = {}
        self._is_held = False
        self._doubts: dict[str, tuple[float, float]] = {}

    def commanded(self, now: float, pulse: int | None) -> None:
        """Take a command as it was sent: the input pulse [us] it asks for, None where it asks for something else."""
        if not self._is_held:
            self._is_held, self._doubts = True, {}
            self.began = self.report_time = now
        if pulse is not None:
            self.pulses.pop(pulse, None)  # its last time orders it
            self.pulses[pulse] = now
        for oldest in [*self.pulses]:
            if now - self.pulses[oldest] <= HISTORY_S:
                break
            self._earlier.pop(oldest, None)
            self._earlier[oldest] = self.pulses.pop(oldest)
        for oldest in [*self._earlier]:
            if now - self._earlier[oldest] <= PATIENCE_S:
                break
            del self._earlier[oldest]

    def released(self) -> None:
        """Take note that nothing is overridden any more."""
        self._is_held = False
        self.pulses.clear()
        self._earlier.clear()

    def is_late(self, pulse: int) -> bool:
        """Return whether a reported `pulse` [us] was commanded before `pulses`, and not longer ago than a slow line."""
        return agrees_with(pulse, self._earlier)

    def shows(self, now: float, what: str, pulse: int, expected: Collection[int]) -> str:
        """Compare a reported `pulse` [us] with those that the commands of late ask for, the newest last; return what it
        is that has differed for too long, '' where nothing has.

        It is one of them: between two that lie on either side a pulse that stands still would seem to obey for as long
        as the order swings about it. `what` names the report, such as "RC channel 1" or "servo 1".
        """
        return differing(what, pulse, expected) if self.disagrees(now, what, agrees_with(pulse, expected)) else ""

    def disagrees(self, now: float, what: str, agrees: bool) -> bool:
        """Take whether the report `what` agrees with what is commanded; return whether it has not for too long."""
        self.report_time = now
        last, doubt = self._doubts.get(what, (self.began, 0.0))
        passed = now - last if now - last < DISOBEDIENCE_S else DISOBEDIENCE_S
        doubt += -AGREEMENT_WEIGHT * passed if agrees else passed
        self._doubts[what] = (now, doubt if doubt > 0.0 else 0.0)
        return doubt > DISOBEDIENCE_S


def agrees_with(pulse: int, expected: Collection[int]) -> bool:
    """Return whether a reported `pulse` [us] is one of those that are expected."""
    return pulse in expected or any(-PULSE_TOLERANCE_US <= pulse - each <= PULSE_TOLERANCE_US for each in expected)


def differing(what: str, pulse: int, expected: Collection[int]) -> str:
    """Return what is said of a reported `pulse` [us] that is none of those that are expected."""
    return f"{what} is at {pulse} us while {[*expected][-1]} is commanded"


MANUAL_MODE = 0
GUIDED_MODE = 15
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
}
"""ArduRover's custom modes; source: ArduPilot, Rover/mode.h."""
HEARTBEAT_S = 1.0
SILENCE_S = 3.0
"""Nothing at all from the vehicle for this long ends our right to steer."""
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
STANDBY_STATE = 3
TAKEN_FOR_A_MOMENT = "the mode, the arming or the radio's switch was changed and changed back: the helm is yours"
STICK_MOVED_US = 150
"""A stick that is moved this far is meant."""


class ControlAuthority:
    """Collects what the vehicle shows; `reason` gives the sentence, or nothing where control is ours.

    Args:
        guided: whether we steer by heading targets in GUIDED mode, rather than by the rudder in MANUAL.

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

    def __init__(self, guided: bool = False) -> None:
        self._guided = guided
        self.obstacle = "waiting for the heartbeat of a vehicle"
        self.misfit = ""
        self.mode = -1
        self.armed = self.booted = False
        self.heartbeat_time = self.received_time = -math.inf
        self.steering = False
        self.disobeyed = ""
        self.echo = OverrideEcho()
        self.last_command = -math.inf
        self._strange: deque[float] = deque(maxlen=STRANGE_REPORTS)
        self._strange_until = -math.inf
        self._sticks: dict[int, int] = {}
        self.cause = HelmCause.TAKEN
        """What kind the reason given last is of."""
        self.stood_still = 0.0
        """For how long [s] no command left while we steered, where the vehicle has let go meanwhile; whoever sees to it
        that we steer no more sets it back to 0."""
        self.radio = ""
        """Why the radio counts as lost; empty while it does not."""
        self.switched_off = False
        """Whether the radio's switch for overrides is off."""
        self._rebooted = False
        self._judged: tuple[int, int] | None = None
        self._parameter_reason = ""

    def heartbeat(self, now: float, mode: int, armed: bool, system_state: int) -> None:
        """Take the vehicle's heartbeat."""
        self.heartbeat_time = now
        self.mode = mode
        self.armed = armed
        self.booted = system_state >= STANDBY_STATE
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

    def rebooted(self) -> None:
        """Forget what the vehicle showed before it restarted: it is disarmed and must be asked anew."""
        self._rebooted = True
        self.armed = self.booted = False
        self.released()
        self.misfit = self.radio = ""

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

    def others_override(self, now: float) -> bool:
        """Return whether the steering input has shown pulses of late that are none of ours, while we steer."""
        if not self._strange:
            return False
        if len(self._strange) == STRANGE_REPORTS and self._strange[-1] - self._strange[0] <= STRANGE_S:
            self._strange_until = self._strange[-1] + STRANGE_LASTS_S
        return self.steering and now <= self._strange_until

    def seen(self, now: float, what: str, pulse: int, expected: Collection[int], is_input: bool = False) -> None:
        """Compare a reported `pulse` [us] with those that the commands of late ask for; `OverrideEcho.shows`.

        `is_input`: it is the input that we override.
        """
        echo, agrees = self.echo, pulse in expected or agrees_with(pulse, expected)
        # nobody else's: what was reported before our first command of all arrived there, and an echo that comes late
        if is_input and not agrees and now - echo.began > PATIENCE_S and not echo.is_late(pulse):
            self._strange.append(now)
        if echo.disagrees(now, what, agrees):
            self.disobeyed = (
                f"the rudder does not obey: {differing(what, pulse, expected)} "
                "(radio override switched off, or another ground station steers)"
            )

    def refuse(self, sentence: str) -> None:
        """Give the helm up for a reason that was found elsewhere."""
        self.disobeyed = sentence

    def stick(self, number: int, pulse: int) -> None:
        """Take where a stick stands that does not steer: moved while we steer, it takes the helm."""
        stood = self._sticks.get(number)
        if not self.steering or not pulse:
            self._sticks.pop(number, None)
        elif stood is None:
            self._sticks[number] = pulse
        elif not -STICK_MOVED_US <= pulse - stood <= STICK_MOVED_US:
            self.disobeyed = f"the stick on RC channel {number} was moved: the helm is yours"

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
        silence = now - self.heartbeat_time
        if silence > HEARTBEAT_TIMEOUT_S or now - self.received_time > SILENCE_S:
            self.cause = HelmCause.SILENT
            return f"no heartbeat from the vehicle for {silence:.0f} s"
        judged = (parameters.revision, system)
        if judged != self._judged:
            self._judged = judged
            self._parameter_reason = _parameter_reason(parameters, system, self._guided)
        waiting = self._parameter_reason or ("" if self._guided else self.misfit)
        if waiting and self._rebooted:
            self.cause = HelmCause.REBOOTED
            return f"the vehicle has rebooted; {waiting}"
        self._rebooted = False
        if self.radio and not waiting:
            self.cause = HelmCause.RADIO_LOST
        return waiting or self.radio or self._state_reason() or self._obedience_reason(now)

    def _state_reason(self) -> str:
        needed, ours = (GUIDED_MODE, "heading targets") if self._guided else (MANUAL_MODE, "rudder commands")
        if self.mode != needed:
            name = MODE_NAMES.get(self.mode, str(self.mode))
            return f"the vehicle is in mode {name}, where {ours} are not obeyed; switch it to {MODE_NAMES[needed]}"
        if not self.armed:
            return "the vehicle is disarmed; arm it"
        if self.switched_off and not self._guided:
            return "the radio's switch for overrides is off; switch it on"
        return ""

    def _obedience_reason(self, now: float) -> str:
        if self.disobeyed and now - self.last_command > FORGIVEN_S:
            self.disobeyed = ""
        if self.disobeyed:
            return self.disobeyed
        # where the heartbeats stay away too, silence is the better word
        reported = self.echo.report_time
        talks = self.received_time > reported + HEARTBEAT_S
        if self.steering and talks and now - reported > BLIND_S:
            if self._guided:
                return "the vehicle reports no NAV_CONTROLLER_OUTPUT, so nobody can see it take our headings"
            return "the vehicle reports neither RC_CHANNELS nor SERVO_OUTPUT_RAW, so nobody can see the rudder obey"
        return ""


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
    if parameters.steering_servo is None:
        return _without_outputs(parameters)
    if parameters.get("PILOT_STEER_TYPE") == TWO_PADDLES:
        usual = 3 if parameters.drive.is_mixed else 0
        return f"PILOT_STEER_TYPE is 1 (two paddles), which takes no steering; set it to {usual}"
    if int(parameters.get("MANUAL_OPTIONS") or 0.0) & SPEED_SCALING:
        return "MANUAL_OPTIONS has bit 0 set, so the firmware steers by less the faster the boat is; set it to 0"
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


REPEAT_S = 0.1
RETRY_S = 4.0
SEEN_REPORTS = 3
"""So many reports in a row must show the pulse: a stick that a hand moves passes by."""
STRANGE_PROBES = 2
"""One report may have been overtaken on its way."""
PAUSE_S = 0.35
"""Others repeat their overrides at 5 Hz at least."""
PAUSE_REPORTS = 2
OTHER = (
    "another pilot or ground station overrides the steering input: RC channel {number} went to {pulse} us while "
    "{ours} us was sent last; stop it, or start with --with-other-pilot"
)
MOVES = (
    "another pilot or ground station, or a hand, moves the steering input (RC channel {number}) and ours does not "
    "show: hold the stick still, and stop what else steers"
)
LATE = (
    "the vehicle shows our steering {seconds:.1f} s after it was sent (RC channel {number}): over so slow a line no "
    "boat is steered well; raise its baud rate, or let it carry less"
)
REPORT_TIMEOUT_S = 3.0
CHECKED_ON_ENGAGING = "the steering input is checked anew when an order to engage comes"
CHECKING = "checking the steering input"


class Stage(Enum):
    """How far a proof is; the reason says it in words."""

    WAITING = "nothing is reported yet"
    CHECKING = "a pulse of ours is sent, or will be"
    NOT_TAKEN = "the vehicle does not take our steering"
    SHARED = "somebody else, or a hand, moves the input"
    GROWN_OLD = "tried once, and tried anew when somebody waits for it"
    PASSED = "the vehicle takes our steering"


class OverrideProbe:
    """One proof when the vehicle starts and one for each engagement. `may_share`: others may override the input too.

    Attributes:
        reason: why control is not ours yet; empty once the vehicle has shown that it takes our steering.
        stage: how far the proof is.
        pulse [us]: the input that the proof asks for.
        message: what is being sent for the proof, None while nothing is.
    """

    def __init__(self, output: SteeringOutput, may_share: bool = False) -> None:
        self._output = output
        self._may_share = may_share
        self._is_waited_for = True
        self.reset()

    def reset(self) -> None:
        """Ask for the proof anew, as after a reboot."""
        self.stage = Stage.WAITING
        self.reason = "waiting for the vehicle to report its steering input (RC_CHANNELS)"
        self._reported: int | None = None
        self._report_time = -math.inf  # unheard of for ever is silent
        self.message: Message | None = None
        self.pulse = 0
        self._began = self._aimed = self._next = -math.inf
        self._base = self._seen = self._strange = self._moves = 0
        self._has_shown = False
        self._paused: float | None = None

    def wanted(self, waits: bool) -> None:
        """Take whether an order to engage waits, while we do not steer: a proof that nobody waits for grows old.

        Where others may override the input too the first proof is enough, and another would not come through.
        """
        if self._may_share:
            return
        self._is_waited_for = waits
        if waits and self.stage is Stage.GROWN_OLD:
            self.stage, self.reason = Stage.CHECKING, CHECKING
        elif not waits and self.passed:
            self.stage, self.reason = Stage.GROWN_OLD, CHECKED_ON_ENGAGING

    @property
    def passed(self) -> bool:
        """Whether the vehicle has shown that it takes our steering."""
        return self.stage is Stage.PASSED

    def report(self, now: float, number: int, pulse: int) -> None:
        """Take what RC_CHANNELS says of the steering channel `number`."""
        self._report_time = now
        if self.message is None:
            self._reported = pulse
            return
        if self._paused is not None:
            self._judge_pause(now, number, pulse)
            return
        self._seen = self._seen + 1 if pulse == self.pulse else 0
        if self._seen and not self._has_shown and now - self._aimed > DISOBEDIENCE_S:
            # the same lateness would end the steering as soon as the order moves
            self._refuse(now, Stage.NOT_TAKEN, LATE.format(number=number, seconds=now - self._aimed))
            return
        self._has_shown = self._has_shown or self._seen > 0
        # an override stays for seconds: what shows behind ours is no stick
        self._strange += self._has_shown and pulse != self.pulse
        if self._strange >= STRANGE_PROBES and not self._may_share:
            self._refuse(now, Stage.SHARED, OTHER.format(number=number, pulse=pulse, ours=self.pulse))
        elif self._seen >= SEEN_REPORTS:
            self._paused, self._seen = now, 0
            if self._may_share:
                self.stage, self.reason, self.message = Stage.PASSED, "", None
        elif now - self._began > PATIENCE_S and self._moves >= STRANGE_PROBES:
            self._refuse(now, Stage.SHARED, MOVES.format(number=number))
        elif now - self._began > PATIENCE_S:
            self._refuse(
                now,
                Stage.NOT_TAKEN,
                f"the vehicle does not take our steering: RC channel {number} stays at {pulse} us while {self.pulse} "
                "us is sent; switch radio override on, close other ground stations, or start with --as-gcs",
            )
        elif not self._has_shown and abs(pulse - self._base) > DISTINCT_US:
            self._moves += 1
            self._aim(now, pulse)  # where the rudder was is no place to hold it

    def _aim(self, now: float, pulse: int) -> None:
        """Have a pulse sent that leaves the servo where an input `pulse` [us] has it."""
        found = self._output.unmoving(pulse)
        if found is not None:
            self._aimed = now
            self._base = pulse
            self.message, self.pulse = found

    def _judge_pause(self, now: float, number: int, pulse: int) -> None:
        assert self._paused is not None
        if pulse != self.pulse:
            self._refuse(now, Stage.SHARED, OTHER.format(number=number, pulse=pulse, ours=self.pulse))
            return
        self._seen += 1
        if now - self._paused >= PAUSE_S and self._seen >= PAUSE_REPORTS:
            self.stage, self.reason, self.message, self._paused = Stage.PASSED, "", None, None

    def _refuse(self, now: float, stage: Stage, reason: str) -> None:
        self.message, self._reported, self._paused, self._next = None, None, None, now + RETRY_S
        self.stage, self.reason = stage, reason

    def due(self, now: float) -> Message | None:
        """Return the message to send at `now` [s], None where none is."""
        if self.stage in (Stage.PASSED, Stage.GROWN_OLD) or now < self._next:
            return None
        if self.message is None and not self._is_waited_for and self.stage is Stage.SHARED:
            # to try again would disturb who steers; and whether they still do is not known without
            self.stage, self.reason = Stage.GROWN_OLD, CHECKED_ON_ENGAGING
            return None
        if now - self._report_time > REPORT_TIMEOUT_S:
            self.message = self._paused = None
            return None
        if self._paused is not None:
            return None
        if self.message is None:
            if self._reported is None:
                return None
            self._aim(now, self._reported)
            if self.message is None:
                return None
            self._began, self._seen, self._strange, self._moves, self._has_shown = now, 0, 0, 0, False
            # what the last try found stays said while the next is under way
            if self.stage not in (Stage.NOT_TAKEN, Stage.SHARED):
                self.stage, self.reason = Stage.CHECKING, CHECKING
        self._next = now + REPEAT_S
        return self.message
