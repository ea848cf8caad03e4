"""What is asked of the flight controller, and what a companion says beside steering. Pure.

The few parameters that steering needs, asked for by name until they have come; the messages it shall send, asked for
with SET_MESSAGE_INTERVAL until they come at their rate.
"""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.codec import Message
from autopilot.models.drives import DRIVES, DriveKind, Needs
from autopilot.signals import AlarmEvent, Mode

FIRST_CHECK_S = 0.7
CHECK_S = 2.0
ENOUGH = 0.6
"""A stream below this share of its rate is asked for again: requests get lost, and ground stations change rates."""
OPTIONAL_ROUNDS = 2
"""What a vehicle may have nothing of is asked for so often, and then missed no more."""
PATIENT_CHECKS = 3
"""So many checks in a row may find the most wanted stream too slow before people are warned."""
HEADINGS_IN_TIMEOUT = 3
"""Headings that must come within the time in which they grow too old: two may be lost in a row, as one in ten are on a
line that loses a third."""
LEAST_SHARE = 0.25
"""Of its rate each stream is asked for at least, where the line has no room for all of them."""
LINE_SHARE = 0.75
"""Of what a line carries for the streams: the rest is for what a vehicle sends beside them, and that no queue forms."""
FEW_LOST = 0.1
"""With a larger share of messages lost it is not the line's room that is missing."""
MORE, MORE_S, ALL_COME = 1.2, 20.0, 0.9
"""Room that was found too little is tried for so many times as much after so long, where this share of all comes;
where it does not then, after twice as long again."""
MORE_MOST_S = 100.0 * CHECK_S
"""A try that fails fills the line until the next check: one per cent of the time at most."""
OFTEN_HZ = 5.0
"""Of slower streams a check sees too few."""
FRAME_BYTES = 12
"""Of a MAVLink 2 message, beside its fields."""
WAITING = "waiting for headings (ATTITUDE) at the rate asked for"
LATE_SHARE = 0.5
"""Where none is younger than this share of the age at which a heading counts as lost, that is an alarm."""
OVER_SHARE = 0.5
"""It is over below this share of that: by a clock that runs slow, a heading's age doubles and halves again with every
window of the offset."""


TOO_SLOW = (
    "headings (ATTITUDE) come at {rate:.1f} Hz, and {least:.1f} Hz is the least to steer by "
    "(3 within failsafe.heading_timeout_s); they are asked for on and on: raise the link's baud rate (SERIALn_BAUD), "
    "or let ground stations ask for less (SRn_ parameters)"
)


class MessageStreams:
    """Counts what arrives and names what must be asked for.

    Args:
        rates_hz: wanted rate by message id, the most wanted first.
        timeout [s]: age at which the most wanted counts as lost; inf: at none.
        optional_hz: rates of what not every vehicle has, by message id.

    Attributes:
        counts: messages that have come since the last check, by id; who receives them counts.
        checked_at, pause: when [s] they were checked last, -inf before, and how long [s] it is until they are again.
        slow: the alarm of a first stream that stays slow however often it is asked for; None where it does not.
        age: how old [s] the youngest of the first stream since the last check was as it came, inf before one; who
            receives it says so.
        late: the alarm of a first stream whose youngest has become so old; None where it has not.
        lost, came: of the vehicle's messages since the last check, by their numbers; who receives them says so.
        narrow: the notice of a line that has no room for all; None where there is no such line.
    """

    def __init__(
        self, rates_hz: dict[int, float], timeout: float = math.inf, optional_hz: dict[int, float] | None = None
    ) -> None:
        self._wanted, self._optional = dict(rates_hz), dict(optional_hz or {})
        self._rates = self._wanted
        self._cost = {each: FRAME_BYTES + dialect.mavlink_map[each].unpacker.size for each in rates_hz}
        self._carries = self._room = math.inf
        # what was asked for cannot be too slow
        self._least = min(HEADINGS_IN_TIMEOUT / timeout, ENOUGH * next(iter(self._rates.values())))
        self._oldest = LATE_SHARE * timeout
        self.reset()

    @property
    def waiting(self) -> str:
        """Why it is too soon to engage: the first stream has not come at its rate yet, or stays too slow to steer by.

        '' once it has come, or is slower than asked for and fast enough.
        """
        comes_back = self._was_silent and self.counts[next(iter(self._rates))] > 0
        return WAITING if comes_back or not self._settled else self._too_slow

    @property
    def is_open(self) -> bool:
        """Whether the first stream has neither come at its rate yet nor stayed too slow."""
        return not self._settled

    def reset(self) -> None:
        """Ask for everything anew, as after a reboot."""
        self.slow: AlarmEvent | None = None
        self.late: AlarmEvent | None = None
        self.age = math.inf
        self._too_slow = ""
        self._slow_checks = 0
        self._was_silent = False
        self._settled = False
        self._rounds = OPTIONAL_ROUNDS
        self.lost = self.came = self._full_checks = 0
        self._fitted_at, self._more_s = -math.inf, MORE_S
        self._came_before = 0.0
        self._fit(self._carries)
        self.counts = dict.fromkeys(self._rates, 0)
        self.checked_at, self.pause = -math.inf, FIRST_CHECK_S

    def carry(self, bytes_per_s: float) -> None:
        """Take what the line carries, inf where nobody knows: no more is asked for than goes over it."""
        self._carries = LINE_SHARE * bytes_per_s
        self._fit(self._carries)

    def _fit(self, room: float, is_tried: bool = False) -> None:
        """Ask for what `room` [B/s] is enough for: a share of each, and of the rest the most wanted first; what is only
        tried is not said yet."""
        self._room, wanted, cost = room, self._wanted, self._cost
        least = {each: LEAST_SHARE * rate for each, rate in wanted.items()}
        first = next(iter(wanted))
        # of headings what is needed, or 200 Hz of them would fill a line alone
        least[first] = min(self._least / ENOUGH, wanted[first]) or least[first]
        left = max(room - sum(least[each] * cost[each] for each in wanted), 0.0)
        given = {}
        for each, rate in wanted.items():
            given[each] = min(least[each] + left / cost[each], rate)
            left = max(left - (given[each] - least[each]) * cost[each], 0.0)
        self._rates, self._is_tried = given, is_tried
        if is_tried:
            return
        less = f"headings at {given[first]:.0f} Hz of {wanted[first]:.0f}" if given[first] < wanted[first] else ""
        others = (
            f"headings at {wanted[first]:.0f} Hz, the rest less often"
            if any(given[each] < rate for each, rate in wanted.items())
            else ""
        )
        self.narrow = AlarmEvent("line_narrow", less or others) if less or others else None

    def _refit(self, now: float, seconds: float) -> bool:
        """Return whether less, or more again, is to be asked for, by what came in the last `seconds`.

        A line without room loses next to nothing, for the vehicle waits; what is sent most often waits most (ArduPilot
        takes what has waited longest). Where the headings alone are slow, it is the vehicle that sends no more.
        """
        brought = {each: count / seconds for each, count in self.counts.items()}
        shares = {each: brought[each] / rate for each, rate in self._rates.items()}
        first, *rest = shares
        others = [shares[each] for each in rest if self._wanted[each] >= OFTEN_HZ]
        share, come = shares[first], brought[first]
        is_whole = self.lost <= FEW_LOST * (self.came + self.lost) and self._came_before < math.inf
        waits = self._came_before > 0.0 or any(0.0 < other < ALL_COME for other in others)
        is_full = is_whole and waits and 0.0 < share < ENOUGH
        all_come = min([share, *others]) >= ALL_COME
        self._full_checks = self._full_checks + 1 if is_full else 0
        if share >= ENOUGH and self._came_before < math.inf:
            self._came_before = 0.0
        if self._full_checks >= PATIENT_CHECKS and come <= MORE * self._came_before:
            self._fit(self._carries)  # to ask for less has brought no more: it is not the line
            self._came_before = math.inf
        elif self._full_checks >= PATIENT_CHECKS:
            self._came_before = come
            self._fit(LINE_SHARE * sum(rate * self._cost[each] for each, rate in brought.items()))
        elif self._is_tried and not all_come:
            self._fit(self._room / MORE)
            self._more_s = min(2.0 * self._more_s, MORE_MOST_S)
        elif self.narrow and self._room < self._carries and now - self._fitted_at > self._more_s and all_come:
            self._fit(min(MORE * self._room, self._carries), is_tried=True)
        else:
            if self._is_tried:
                # where there was more room there may be more yet
                self._more_s = MORE_S
                self._fit(self._room)
            return False
        self._full_checks, self._fitted_at = 0, now
        return True

    def due(self, now: float) -> list[tuple[int, int]]:
        """Return (message id, interval [us]) of the streams to ask for at `now` [s]."""
        passed, first = now - self.checked_at, self.checked_at == -math.inf
        if passed < self.pause:
            return []
        if not first:
            self.pause = CHECK_S
            first = self._refit(now, passed)
            if first:
                self._slow_checks = 0  # of what is asked for from now on
            else:
                self._watch_first(passed)
        if self._oldest * (OVER_SHARE if self.late else 1.0) < self.age < math.inf:
            # said once: how old they are wavers
            self.late = self.late or AlarmEvent("headings_late", f"{self.age:.1f} s")
        else:
            self.late = None
        self.age = math.inf
        needed = passed * ENOUGH
        wanted = [
            (identity, round(1.0e6 / rate))
            for identity, rate in self._rates.items()
            if first or self.counts[identity] < rate * needed
        ]
        if self._rounds:
            self._rounds -= 1
            wanted += [(identity, round(1.0e6 / rate)) for identity, rate in self._optional.items()]
        self.checked_at = now
        self.counts = dict.fromkeys(self._rates, 0)
        self.lost = self.came = 0
        return wanted

    def _watch_first(self, seconds: float) -> None:
        identity, wanted = next(iter(self._rates.items()))
        rate = self.counts[identity] / seconds
        # of a check within which they came back it is not known how quickly they come
        is_known, self._was_silent = not self._was_silent or rate == 0.0, rate == 0.0
        is_slow = 0.0 < rate < self._least
        self._too_slow = "" if not is_slow else TOO_SLOW.format(rate=rate, least=self._least) if is_known else WAITING
        if rate >= wanted * ENOUGH:
            self.slow, self._slow_checks, self._settled = None, 0, True
            return
        self._slow_checks += 1
        if self._slow_checks < PATIENT_CHECKS:
            return
        self._settled = True
        # said once: a rate that wavers is no news; that nothing comes at all others will say
        if self.counts[identity] and is_known and not self.slow:
            self.slow = AlarmEvent("headings_slow", f"{rate:.0f} Hz though {wanted:.0f} Hz")


AGAIN_S = 3.0
"""One of the parameters in use is asked for again so often: word of a change by another station may be lost."""
DOUBT_AGAIN_S = 10.0
RETRY_S = 0.5
BURST = 8
"""Requests sent at once, so that a slow telemetry radio is not flooded."""
BURST_S = 0.1
OPTIONAL_TRIES = 3
FUNCTION_TRIES = 10
PATIENCE_TRIES = 6
THROTTLE = 70
"""SERVOn_FUNCTION of the one throttle."""
STEERING_FUNCTIONS = frozenset(function for kind in DRIVES.values() for function in kind.outputs)
SERVO_COUNT = 16
MIXING = ("MOT_THST_ASYM", "MOT_THST_EXPO", "MOT_STR_THR_MIX", "PILOT_STEER_TYPE")
"""How a skid-steered frame mixes steering and throttle, and what its sticks are; old firmware has not all of it."""
TWO_PADDLES = 1.0
"""PILOT_STEER_TYPE: the steering channel is the left paddle."""

GCS_NAMES = ("SYSID_MYGCS", "MAV_GCS_SYSID")
"""The parameter's name before and since ArduPilot 4.7; a vehicle has one of them."""
GCS_HIGH = "MAV_GCS_SYSID_HI"
EXPO = "MANUAL_STR_EXPO"
OVERRIDE_TIME = "RC_OVERRIDE_TIME"
SPEED_SCALING = 1
"""MANUAL_OPTIONS: steering is made less with the speed."""
IGNORES_OVERRIDES = 2
"""RC_OPTIONS: no override is taken."""
OVERRIDE_TIME_S = 3.0
"""Where the vehicle has not reported it."""
CHANNEL_COUNT = 16
STICKS = {"RCMAP_PITCH": 2, "RCMAP_THROTTLE": 3, "RCMAP_YAW": 4}
"""The other sticks' channels, by default as ArduPilot has them (libraries/AP_RCMapper)."""
SETTINGS = (
    "FS_THR_ENABLE",
    "FS_THR_VALUE",
    "FS_GCS_ENABLE",
    "FS_GCS_TIMEOUT",
    "FS_ACTION",
    "ARMING_RUDDER",
    "RC_OPTIONS",
    "PILOT_STEER_TYPE",
    "MANUAL_OPTIONS",
)
"""What the firmware does when somebody falls silent, and what it takes from a stick."""
WELCOME = (*STICKS, *SETTINGS, *(f"RC{number}_OPTION" for number in range(1, CHANNEL_COUNT + 1)))
"""Asked for too, but steering does not wait for them."""
WAYS = ("RC_OPTIONS", "PILOT_STEER_TYPE", "MANUAL_OPTIONS")
"""Of these, what may keep the steering input from the rudder."""
SCALED = 139
"""SERVOn_FUNCTION of an output that passes channel n of the radio on, by the channel's end points, is n more."""
SAFE_MASK = "SERVO_RC_FS_MSK"
"""Which of those the radio's fail-safe sends to their trim; old firmware has it not."""
RADIO_TIMEOUT = "RC_FS_TIMEOUT"
"""Without any input for so long [s] the radio's fail-safe comes; older firmware has 0.5 s."""
OVERRIDE_SWITCH = 46
"""RCn_OPTION of a switch on the radio that allows overrides (libraries/RC_Channel/RC_Channel.h, AUX_FUNC)."""
RC_SUFFIXES = ("MIN", "TRIM", "MAX", "DZ", "REVERSED")
SERVO_SUFFIXES = ("MIN", "TRIM", "MAX", "REVERSED")
RELEVANT = frozenset(
    (
        *(*GCS_NAMES, GCS_HIGH, EXPO, OVERRIDE_TIME, SAFE_MASK, RADIO_TIMEOUT, "RCMAP_ROLL", *WELCOME, *MIXING),
        *(f"RC{number}_{suffix}" for number in range(1, CHANNEL_COUNT + 1) for suffix in RC_SUFFIXES),
        *(f"SERVO{n}_{suffix}" for n in range(1, SERVO_COUNT + 1) for suffix in (*SERVO_SUFFIXES, "FUNCTION")),
    )
)
"""What is kept of all that a vehicle reports: no more, however much it sends."""


class VehicleParameters:
    """What is known of the vehicle's parameters and what has still to be asked; `throttle`: of that stick too.
    `asks`: anything at all; False for a vehicle that has others, of which nothing is needed.

    What follows from them is worked out whenever one comes.

    Attributes:
        revision: counts every change.
        gcs_name: the name under which this vehicle keeps its ground-station id.
        gcs_system: the system id whose overrides the vehicle obeys, None while unknown or impossible.
        override_time [s]: RC_OVERRIDE_TIME, None while unknown.
        patience [s]: without an order for so long the vehicle lets go; where it never does, as long as by default, for
        by then nobody has looked after the rudder for too long.
        steering_input: number of the input channel that steers (RCMAP_ROLL), None while unknown or impossible.
        steering_servos: numbers of the servo outputs that carry the steering, one for each of the drive's functions;
        empty while one of them is not known. steering_servo: the first of them, None where there is none.
        throttle_servo: number of the output whose function is Throttle, None where none is known.
        found_functions: functions that steer, whether this drive's or another's, that some output has.
        throttle_failsafe [us]: FS_THR_VALUE, None while unknown.
        throttle_input: number of the throttle's input channel (RCMAP_THROTTLE), ArduPilot's default while unknown.
        override_switch: number of the channel whose switch allows overrides, None where there is none.
        functions: numbers of the outputs of each SERVOn_FUNCTION that has come.
        free_sticks: channels of the sticks that neither steer nor give throttle: nobody moves them but by intent.
        to_ask: names that have not come yet, and may still. next_again [s]: before, nothing is asked for once more.
    """

    def __init__(
        self,
        throttle: bool = False,
        drive: DriveKind = DRIVES["rudder"],
        thruster: int | None = None,
        asks: bool = True,
    ) -> None:
        self._asks = asks
        self._throttle, self._thruster = throttle, thruster
        self.drive = drive
        self.revision = 0
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after a reboot."""
        self._values: dict[str, float] = {}
        self._asked: dict[str, tuple[float, int]] = {}
        self.to_ask: list[str] = []
        self._next_burst = self.next_again = -math.inf
        self._again, self._doubted_at = 0, -math.inf
        self._doubted: list[str] = []
        self._changed()

    def take(self, name: str, value: float) -> bool:
        """Keep a value that the vehicle reports; return whether it is one of those used here and new."""
        if not (self._asks and math.isfinite(value)) or name not in RELEVANT or self._values.get(name) == value:
            return False
        self._values[name] = value
        self._changed()
        return True

    def get(self, name: str) -> float | None:
        """Return the value of the parameter, None where it has not come."""
        return self._values.get(name)

    @property
    def missing(self) -> list[str]:
        """Names that are needed and have not come; a name may be optional, see `complete`."""
        return self._missing

    @property
    def unanswered(self) -> list[str]:
        """Names that were asked for `PATIENCE_TRIES` times in vain and are still needed."""
        return [
            name
            for name in self._missing
            if self._asked.get(name, (0.0, 0))[1] >= PATIENCE_TRIES
            and not (self._given_up(name) or name in self._unneeded)
        ]

    @property
    def complete(self) -> bool:
        """Whether all that steering needs is known; what old firmware lacks was asked for often enough."""
        return not self._asks or (
            self.gcs_system is not None
            and all(
                self._given_up(name)
                or name in self._unneeded
                or (name in (OVERRIDE_TIME, GCS_HIGH, *WELCOME) and not (self.drive.is_mixed and name in MIXING))
                for name in self._missing
            )
        )

    def due(self, now: float) -> list[str]:
        """Return the names to request at `now` [s]; none once all have come."""
        if not self.to_ask or now < self._next_burst:
            return []
        names = []
        for name in self.to_ask:
            last, tries = self._asked.get(name, (-math.inf, 0))
            if now - last >= RETRY_S:
                names.append(name)
                self._asked[name] = (now, tries + 1)
                if len(names) == BURST:
                    break
        if names:
            self.revision += 1
            self._next_burst = now + BURST_S
            self.to_ask = [name for name in self.to_ask if not self._given_up(name)]
        return names

    def again(self, now: float) -> list[str]:
        """Return what to ask for once more at `now` [s], once all has come: a name in use now and then, or behind
        `doubt` all of them, a burst at a time."""
        if not self._in_use or now < self.next_again:
            return []
        if self._doubted:
            names, self._doubted = self._doubted[:BURST], self._doubted[BURST:]
        else:
            self._again = (self._again + 1) % len(self._in_use)
            names = [self._in_use[self._again]]
        self.next_again = now + (BURST_S if self._doubted else AGAIN_S)
        return names

    def doubt(self, now: float) -> None:
        """Have all that is in use asked for once more: our orders do not do what they should. A slow line makes that
        seem so again and again, and is not to be filled by it."""
        if now - self._doubted_at > DOUBT_AGAIN_S:
            self._doubted, self._doubted_at, self.next_again = self._in_use, now, -math.inf

    @property
    def gcs_impossible(self) -> bool:
        """Whether the vehicle has reported a ground-station id that is none."""
        return self.gcs_name in self._values and self.gcs_system is None

    def obeys(self, system: int) -> bool:
        """Return whether the vehicle obeys overrides from `system`, as far as its parameters tell."""
        low = self.gcs_system
        if low is None:
            return False
        return low <= system <= max(low, self._values.get(GCS_HIGH, 0.0))

    @property
    def throttle_neutral(self) -> tuple[int, int, int] | None:
        """Channel of the throttle stick, and the pulses [us] between which it asks for nothing; None while unknown."""
        number = self._mapped("RCMAP_THROTTLE")
        trim, dead_zone = (self._values.get(f"RC{number}_{suffix}") for suffix in ("TRIM", "DZ"))
        if trim is None or dead_zone is None:
            return None
        return number, round(trim - dead_zone), round(trim + dead_zone)

    def _mapped(self, name: str) -> int:
        return round(self._values.get(name, STICKS[name]))

    def _changed(self) -> None:
        self.revision += 1
        values, numbers = self._values, range(1, CHANNEL_COUNT + 1)
        self.gcs_name = next((name for name in GCS_NAMES if name in values), GCS_NAMES[0])
        gcs = values.get(self.gcs_name, 0.0)
        self.gcs_system: int | None = round(gcs) if 1.0 <= gcs <= 255.0 else None
        self.override_time, self.throttle_failsafe = values.get(OVERRIDE_TIME), values.get("FS_THR_VALUE")
        override_time = values.get(OVERRIDE_TIME, OVERRIDE_TIME_S)
        self.patience = override_time if override_time > 0.0 else OVERRIDE_TIME_S
        steering, throttle = values.get("RCMAP_ROLL", 0.0), self._mapped("RCMAP_THROTTLE")
        self.steering_input: int | None = round(steering) if 1.0 <= steering <= 16.0 else None
        self.throttle_input = throttle if throttle in numbers else STICKS["RCMAP_THROTTLE"]
        switches = (number for number in numbers if values.get(f"RC{number}_OPTION") == OVERRIDE_SWITCH)
        self.override_switch: int | None = next(switches, None)
        sticks = (self._mapped(name) for name in STICKS if name != "RCMAP_THROTTLE")
        self.free_sticks = tuple(n for n in sticks if n not in (self.steering_input, throttle) and n in numbers)
        all_outputs: dict[int, tuple[int, ...]] = {}
        for n in range(1, SERVO_COUNT + 1):
            function = values.get(f"SERVO{n}_FUNCTION")
            if function is not None:
                all_outputs[round(function)] = (*all_outputs.get(round(function), ()), n)
        outputs = {function: numbers[0] for function, numbers in all_outputs.items()}
        self.functions = all_outputs
        wanted = [outputs.get(function) for function in self.drive.outputs]
        found = tuple(number for number in wanted if number is not None)
        self.steering_servos: tuple[int, ...] = found if len(found) == len(wanted) else ()
        self.steering_servo: int | None = self.steering_servos[0] if self.steering_servos else None
        self.throttle_servo: int | None = outputs.get(THROTTLE) if self.drive.needs is Needs.THRUST else None
        self.found_functions = frozenset(outputs) & STEERING_FUNCTIONS
        self._in_use = [
            *(name for name in (self.gcs_name, "RCMAP_ROLL", EXPO, OVERRIDE_TIME, *WAYS) if name in values),
            *(f"RC{self.steering_input}_{suffix}" for suffix in RC_SUFFIXES if self.steering_input is not None),
            *(f"SERVO{n}_{suffix}" for n in self.steering_servos for suffix in (*SERVO_SUFFIXES, "FUNCTION")),
        ]
        self._missing = self._find_missing()
        self.to_ask = [name for name in self._missing if not self._given_up(name)]

    def _find_missing(self) -> list[str]:
        if not self._asks:
            return []
        names = [] if self.gcs_system is not None else list(GCS_NAMES)
        names += ["RCMAP_ROLL", EXPO, OVERRIDE_TIME, GCS_HIGH]
        rc, servos = self.steering_input, self.steering_servos
        names += MIXING if self.drive.is_mixed else ()
        if rc is not None:
            names += [f"RC{rc}_{suffix}" for suffix in RC_SUFFIXES]
        knows_throttle = self.drive.needs is not Needs.THRUST or self.throttle_servo is not None
        if not servos or not knows_throttle:
            names += [f"SERVO{number}_FUNCTION" for number in range(1, SERVO_COUNT + 1)]
        extra = () if self.throttle_servo is None else (self.throttle_servo,)
        names += [f"SERVO{number}_{suffix}" for number in (*servos, *extra) for suffix in SERVO_SUFFIXES]
        if self._throttle:
            number = self._mapped("RCMAP_THROTTLE")
            names += [f"RC{number}_{suffix}" for suffix in ("TRIM", "DZ")]
        # what steering needs goes first
        self._unneeded = frozenset(self._aside()) - frozenset(names)
        names += [
            *(name for name in WELCOME if name not in names),
            *(name for name in self._aside() if name in self._unneeded),
        ]
        return [name for name in names if name not in self._values]

    def _aside(self) -> list[str]:
        """Names that a bow thruster needs and steering does not wait for."""
        number = self._thruster
        if number is None:
            return []
        names = [SAFE_MASK, RADIO_TIMEOUT, *(f"RC{number}_{suffix}" for suffix in RC_SUFFIXES)]
        outputs = self.functions.get(SCALED + number, ())
        if not outputs:
            return [*names, *(f"SERVO{n}_FUNCTION" for n in range(1, SERVO_COUNT + 1))]
        return [*names, *(f"SERVO{n}_{suffix}" for n in outputs for suffix in SERVO_SUFFIXES)]

    @property
    def has_functions(self) -> bool:
        """Whether the function of every output has come, or was asked for often enough."""
        names = (f"SERVO{n}_FUNCTION" for n in range(1, SERVO_COUNT + 1))
        return all(name in self._values or self._given_up(name) for name in names)

    def _given_up(self, name: str) -> bool:
        return self._asked.get(name, (0.0, 0))[1] >= _tries(name)


def _tries(name: str) -> float:
    if name.endswith("_FUNCTION"):
        return FUNCTION_TRIES  # a board with fewer outputs has no SERVO16_FUNCTION
    return (
        OPTIONAL_TRIES
        if name in (EXPO, OVERRIDE_TIME, GCS_HIGH, SAFE_MASK, RADIO_TIMEOUT, *MIXING, *WELCOME)
        else math.inf
    )


AUTOPILOT_COMPONENT = 1
BOATS = (dialect.MAV_TYPE_SURFACE_BOAT, dialect.MAV_TYPE_GROUND_ROVER)

STATES = {
    Mode.STANDBY: dialect.MAV_STATE_STANDBY,
    Mode.ENGAGED: dialect.MAV_STATE_ACTIVE,
    Mode.OVERRIDE: dialect.MAV_STATE_STANDBY,
    Mode.FAILSAFE: dialect.MAV_STATE_CRITICAL,
    Mode.FAULT: dialect.MAV_STATE_EMERGENCY,
}
"""MAV_STATE of our heartbeats, by the pilot's mode."""


def companion_heartbeat(state: int) -> Message:
    """Return our own heartbeat, with MAV_STATE `state`."""
    return dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID, 0, 0, state, 3
    )


def station_heartbeat() -> Message:
    """Return the heartbeat of a ground station: the one in whose name we steer, and what looks on as one."""
    return dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3
    )


def vehicle_command(vehicle: int, command: int, *parameters: float) -> Message:
    """Return a command to the vehicle's flight controller; what is not given of its seven `parameters` is 0."""
    values = (*parameters, *(0.0,) * (7 - len(parameters)))
    return dialect.MAVLink_command_long_message(vehicle, AUTOPILOT_COMPONENT, command, 0, *values)


def interval_request(vehicle: int, identity: int, interval_us: int) -> Message:
    """Return the request to stream the message `identity` every `interval_us`."""
    return vehicle_command(vehicle, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, identity, interval_us)


def parameter_request(vehicle: int, name: str) -> Message:
    """Return the request for one parameter by its name."""
    return dialect.MAVLink_param_request_read_message(vehicle, AUTOPILOT_COMPONENT, name.encode(), -1)


def obstacle_of(autopilot: int, kind: int, offboard: bool = False) -> str:
    """Return why a vehicle of this MAV_AUTOPILOT and MAV_TYPE cannot be steered; '' where it can. `offboard`: in that
    mode of PX4's."""
    if offboard and autopilot != dialect.MAV_AUTOPILOT_PX4:
        return (
            "the vehicle does not run PX4, whose mode Offboard is; start with --steer rc_override or guided (ArduRover)"
        )
    if not offboard and autopilot == dialect.MAV_AUTOPILOT_PX4:
        return "the vehicle runs PX4, which takes no rudder of ours; start with --steer offboard (throttle by PX4)"
    if not offboard and autopilot != dialect.MAV_AUTOPILOT_ARDUPILOTMEGA:
        return "the vehicle does not run ArduPilot, whose steering input is the only one known so far; use ArduRover"
    if kind not in BOATS:
        return f"the vehicle is of MAV_TYPE {kind}, not a boat or rover; connect to the boat's flight controller"
    return ""


MODES = {"HOLD": 4, "LOITER": 5, "RTL": 11}
"""ArduRover's custom modes; source: ArduPilot, Rover/mode.h."""
