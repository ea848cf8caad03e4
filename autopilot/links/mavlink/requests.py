"""What is asked of the flight controller: the parameters that steering needs, and the messages it shall send. Pure.

The few parameters of the flight controller that steering needs: asked for by name until they have come. Pure.

Which messages the vehicle shall send and how often: asked for with SET_MESSAGE_INTERVAL until they come. Pure.
"""

from __future__ import annotations

import math

from autopilot.links.mavlink.steering_pwm import SteeringChannel
from autopilot.signals import AlarmEvent

FIRST_CHECK_S = 0.7
CHECK_S = 2.0
ENOUGH = 0.6
"""A stream below this share of its rate is asked for again: requests get lost, and ground stations change rates."""
PATIENT_CHECKS = 3
"""So many checks in a row may find the most wanted stream too slow before people are told."""
HEADINGS_IN_TIMEOUT = 3
"""Headings that must come within the time in which they grow too old: two may be lost in a row, as one in ten are on a
line that loses a third."""
WAITING = "waiting for headings (ATTITUDE) at the rate asked for"


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
    """

    def __init__(self, rates_hz: dict[int, float], timeout: float = math.inf) -> None:
        self._rates = dict(rates_hz)
        # what was asked for cannot be too slow
        self._least = min(HEADINGS_IN_TIMEOUT / timeout, ENOUGH * next(iter(self._rates.values())))
        self.reset()

    @property
    def waiting(self) -> str:
        """Why it is too soon to engage: the first stream has not come at its rate yet, or stays too slow to steer by.

        '' once it has come, or is slower than asked for and fast enough.
        """
        return self._too_slow if self._settled else WAITING

    @property
    def slow(self) -> AlarmEvent | None:
        """The alarm of a first stream that stays slow however often it is asked for; None where it does not."""
        return self._slow

    def reset(self) -> None:
        """Ask for everything anew, as after a reboot."""
        self._slow: AlarmEvent | None = None
        self._too_slow = ""
        self._slow_checks = 0
        self._settled = False
        self._counts = dict.fromkeys(self._rates, 0)
        self._since: float | None = None
        self._checked = False

    def count(self, message_id: int) -> None:
        """Note that a message of a wanted id has come."""
        self._counts[message_id] += 1

    def due(self, now: float) -> list[tuple[int, int]]:
        """Return (message id, interval [us]) of the streams to ask for at `now` [s]."""
        passed = 0.0 if self._since is None else now - self._since
        if self._since is not None and passed < (CHECK_S if self._checked else FIRST_CHECK_S):
            return []
        first = self._since is None
        if not first:
            self._checked = True
            self._watch_first(passed)
        needed = passed * ENOUGH
        wanted = [
            (identity, round(1.0e6 / rate))
            for identity, rate in self._rates.items()
            if first or self._counts[identity] < rate * needed
        ]
        self._since = now
        self._counts = dict.fromkeys(self._rates, 0)
        return wanted

    def _watch_first(self, seconds: float) -> None:
        identity, wanted = next(iter(self._rates.items()))
        rate = self._counts[identity] / seconds
        self._too_slow = TOO_SLOW.format(rate=rate, least=self._least) if 0.0 < rate < self._least else ""
        if rate >= wanted * ENOUGH:
            self._slow, self._slow_checks, self._settled = None, 0, True
            return
        self._slow_checks += 1
        if self._slow_checks < PATIENT_CHECKS:
            return
        self._settled = True
        # said once: a rate that wavers is no news; that nothing comes at all others will say
        if self._counts[identity] and not self._slow:
            self._slow = AlarmEvent("headings_slow", f"{rate:.0f} Hz though {wanted:.0f} Hz")


RETRY_S = 0.5
BURST = 8
"""Requests sent at once, so that a slow telemetry radio is not flooded."""
BURST_S = 0.1
OPTIONAL_TRIES = 3
FUNCTION_TRIES = 10
PATIENCE_TRIES = 6
GROUND_STEERING = 26
SERVO_COUNT = 16

GCS_NAMES = ("SYSID_MYGCS", "MAV_GCS_SYSID")
"""The parameter's name before and since ArduPilot 4.7; a vehicle has one of them."""
GCS_HIGH = "MAV_GCS_SYSID_HI"
EXPO = "MANUAL_STR_EXPO"
OVERRIDE_TIME = "RC_OVERRIDE_TIME"
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
)
"""What the firmware does when somebody falls silent, and what it takes from a stick."""
WELCOME = (*STICKS, *SETTINGS, *(f"RC{number}_OPTION" for number in range(1, CHANNEL_COUNT + 1)))
"""Asked for too, but steering does not wait for them."""
OVERRIDE_SWITCH = 46
"""RCn_OPTION of a switch on the radio that allows overrides (libraries/RC_Channel/RC_Channel.h, AUX_FUNC)."""
RC_SUFFIXES = ("MIN", "TRIM", "MAX", "DZ", "REVERSED")
SERVO_SUFFIXES = ("MIN", "TRIM", "MAX", "REVERSED")
RELEVANT = frozenset(
    (
        *(*GCS_NAMES, GCS_HIGH, EXPO, OVERRIDE_TIME, "RCMAP_ROLL", *WELCOME),
        *(f"RC{number}_{suffix}" for number in range(1, CHANNEL_COUNT + 1) for suffix in RC_SUFFIXES),
        *(f"SERVO{n}_{suffix}" for n in range(1, SERVO_COUNT + 1) for suffix in (*SERVO_SUFFIXES, "FUNCTION")),
    )
)
"""What is kept of all that a vehicle reports: no more, however much it sends."""


class VehicleParameters:
    """What is known of the vehicle's parameters and what has still to be asked; `throttle`: of that stick too."""

    def __init__(self, throttle: bool = False) -> None:
        self._throttle = throttle
        self.revision = 0
        """Counts every change, so that what follows from the parameters is worked out only once."""
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after a reboot."""
        self.revision += 1
        self._values: dict[str, float] = {}
        self._asked: dict[str, tuple[float, int]] = {}
        self._next_burst = -math.inf
        self._missing = self._find_missing()

    def take(self, name: str, value: float) -> bool:
        """Keep a value that the vehicle reports; return whether it is one of those used here and new."""
        if not math.isfinite(value) or not _relevant(name) or self._values.get(name) == value:
            return False
        self.revision += 1
        self._values[name] = value
        self._missing = self._find_missing()
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
            if self._asked.get(name, (0.0, 0))[1] >= PATIENCE_TRIES and not self._given_up(name)
        ]

    @property
    def complete(self) -> bool:
        """Whether all that steering needs is known; what old firmware lacks was asked for often enough."""
        return self.gcs_system is not None and all(
            self._given_up(name) or name in (OVERRIDE_TIME, GCS_HIGH, *WELCOME) for name in self._missing
        )

    def due(self, now: float) -> list[str]:
        """Return the names to request at `now` [s]."""
        if not self._missing or now < self._next_burst:
            return []
        names = []
        for name in self._missing:
            last, tries = self._asked.get(name, (-math.inf, 0))
            if now - last >= RETRY_S and not self._given_up(name):
                names.append(name)
                self._asked[name] = (now, tries + 1)
                if len(names) == BURST:
                    break
        if names:
            self.revision += 1
            self._next_burst = now + BURST_S
        return names

    @property
    def gcs_name(self) -> str:
        """The name under which this vehicle keeps its ground-station id."""
        return next((name for name in GCS_NAMES if name in self._values), GCS_NAMES[0])

    @property
    def gcs_system(self) -> int | None:
        """The system id whose overrides the vehicle obeys, None while unknown or impossible."""
        value = self._values.get(self.gcs_name)
        return round(value) if value is not None and 1.0 <= value <= 255.0 else None

    @property
    def gcs_impossible(self) -> bool:
        """Whether the vehicle has told a ground-station id that is none."""
        return self.gcs_name in self._values and self.gcs_system is None

    def obeys(self, system: int) -> bool:
        """Return whether the vehicle obeys overrides from `system`, as far as its parameters tell."""
        low = self.gcs_system
        if low is None:
            return False
        return low <= system <= max(low, self._values.get(GCS_HIGH, 0.0))

    @property
    def steering_input(self) -> int | None:
        """Number of the input channel that steers (RCMAP_ROLL), None while unknown or impossible."""
        value = self._values.get("RCMAP_ROLL")
        return round(value) if value is not None and 1.0 <= value <= 16.0 else None

    @property
    def throttle_input(self) -> int:
        """Number of the input channel of the throttle (RCMAP_THROTTLE), ArduPilot's default while unknown."""
        number = round(self._values.get("RCMAP_THROTTLE", STICKS["RCMAP_THROTTLE"]))
        return number if 1 <= number <= CHANNEL_COUNT else STICKS["RCMAP_THROTTLE"]

    @property
    def override_switch(self) -> int | None:
        """Number of the channel whose switch allows overrides, None where there is none."""
        for number in range(1, CHANNEL_COUNT + 1):
            if self._values.get(f"RC{number}_OPTION") == OVERRIDE_SWITCH:
                return number
        return None

    @property
    def free_sticks(self) -> tuple[int, ...]:
        """Channels of the sticks that neither steer nor give throttle: nobody moves them but by intent."""
        mapped = {name: round(self._values.get(name, default)) for name, default in STICKS.items()}
        used = (self.steering_input, mapped["RCMAP_THROTTLE"])
        return tuple(
            number
            for name, number in mapped.items()
            if name != "RCMAP_THROTTLE" and number not in used and 1 <= number <= CHANNEL_COUNT
        )

    @property
    def throttle_neutral(self) -> tuple[int, int, int] | None:
        """Channel of the throttle stick, and the pulses [us] between which it asks for nothing; None while unknown."""
        number = round(self._values.get("RCMAP_THROTTLE", STICKS["RCMAP_THROTTLE"]))
        trim, dead_zone = (self._values.get(f"RC{number}_{suffix}") for suffix in ("TRIM", "DZ"))
        if trim is None or dead_zone is None:
            return None
        return number, round(trim - dead_zone), round(trim + dead_zone)

    @property
    def steering_servo(self) -> int | None:
        """Number of the first servo output whose function is GroundSteering, None where none is known."""
        for number in range(1, SERVO_COUNT + 1):
            if self._values.get(f"SERVO{number}_FUNCTION") == GROUND_STEERING:
                return number
        return None

    def steering_channel(self) -> SteeringChannel | None:
        """Return the way from steering input to rudder servo; None while a piece of it is unknown."""
        rc, servo = self.steering_input, self.steering_servo
        if rc is None or servo is None:
            return None
        names = [f"RC{rc}_{suffix}" for suffix in RC_SUFFIXES] + [f"SERVO{servo}_{suffix}" for suffix in SERVO_SUFFIXES]
        found = [self._values.get(name) for name in names]
        values = [round(value) for value in found if value is not None]
        if len(values) != len(names):
            return None
        rc_min, rc_trim, rc_max, dead_zone, rc_reversed, servo_min, servo_trim, servo_max, servo_reversed = values
        return SteeringChannel(
            rc_min,
            rc_trim,
            rc_max,
            dead_zone,
            bool(rc_reversed),
            servo_min,
            servo_trim,
            servo_max,
            bool(servo_reversed),
            self._values.get(EXPO, 0.0),
        )

    def _find_missing(self) -> list[str]:
        names = [] if self.gcs_system is not None else list(GCS_NAMES)
        names += ["RCMAP_ROLL", EXPO, OVERRIDE_TIME, GCS_HIGH]
        rc, servo = self.steering_input, self.steering_servo
        if rc is not None:
            names += [f"RC{rc}_{suffix}" for suffix in RC_SUFFIXES]
        if servo is None:
            names += [f"SERVO{number}_FUNCTION" for number in range(1, SERVO_COUNT + 1)]
        else:
            names += [f"SERVO{servo}_{suffix}" for suffix in SERVO_SUFFIXES]
        if self._throttle:
            number = round(self._values.get("RCMAP_THROTTLE", STICKS["RCMAP_THROTTLE"]))
            names += [f"RC{number}_{suffix}" for suffix in ("TRIM", "DZ")]
        # what steering needs goes first
        return [name for name in (*names, *WELCOME) if name not in self._values]

    def _given_up(self, name: str) -> bool:
        return self._asked.get(name, (0.0, 0))[1] >= _tries(name)


def _tries(name: str) -> float:
    if name.endswith("_FUNCTION"):
        return FUNCTION_TRIES  # a board with fewer outputs has no SERVO16_FUNCTION
    return OPTIONAL_TRIES if name in (EXPO, OVERRIDE_TIME, GCS_HIGH, *WELCOME) else math.inf


def _relevant(name: str) -> bool:
    return name in RELEVANT
