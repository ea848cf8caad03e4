"""Whether the hand's radio still reaches the flight controller, as far as the vehicle shows it. Pure.

While we override the steering, ArduPilot takes our messages for radio input: a receiver that just falls silent makes no
fail-safe, and RC_CHANNELS goes on showing its last pulses and its count of channels. What does show of a lost radio:

- a receiver that sends a throttle below FS_THR_VALUE: the pulse in RC_CHANNELS, and the firmware's own fail-safe;
- RC_CHANNELS.rssi where it is measured beside the frames (RSSI_TYPE 1 or 4, a voltage or pulse), 255 where it is not;
- SYS_STATUS, MAV_SYS_STATUS_SENSOR_RC_RECEIVER: ArduRover 4.6 sets it never, other vehicles do;
- STATUSTEXT "Radio Failsafe" and, when it is over, "... Failsafe Cleared".

Source: ArduPilot, Rover/radio.cpp (radio_failsafe_check), Rover/failsafe.cpp, Rover/GCS_Rover.cpp,
libraries/RC_Channel/RC_Channels.cpp (read_input), libraries/AP_RSSI.
"""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink_codec import Message
from autopilot.links.vehicle_parameters import VehicleParameters

RECEIVER = dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
LASTS_S = 0.3
"""Longer than one or two odd reports at 10 Hz."""
RSSI_UNKNOWN = 255
RSSI_THERE, RSSI_GONE = 26, 5
"""A tenth and a fiftieth of RC_CHANNELS.rssi's 254."""
SETTLES_S = 1.5
"""A heartbeat that says critical may be so much older than the text about the fail-safe."""


class RadioWatch:
    """Takes what the vehicle says of its radio; `reason` has the sentence for a lost one."""

    def __init__(self) -> None:
        self._since: dict[str, float] = {}
        self._found: dict[str, str] = {}
        self._seen: set[str] = set()
        self._text_time = math.nan

    def reason(self, parameters: VehicleParameters) -> str:
        """Return why the radio counts as lost; empty where it does not, or where the firmware does without it."""
        return "" if parameters.get("FS_THR_ENABLE") == 0.0 else next(iter(self._found.values()), "")

    def channels(self, now: float, message: Message, parameters: VehicleParameters) -> None:
        """Take RC_CHANNELS."""
        channel, limit = parameters.throttle_input, parameters.get("FS_THR_VALUE")
        pulse = getattr(message, f"chan{channel}_raw")
        is_low = limit is not None and 0 < pulse < limit
        self._judge(now, "throttle", is_low, f"throttle, RC channel {channel}, is at {pulse} us, below FS_THR_VALUE")
        rssi = message.rssi
        gone = self._was_there("rssi", RSSI_THERE <= rssi < RSSI_UNKNOWN) and rssi <= RSSI_GONE
        self._judge(now, "rssi", gone, f"its strength (rssi) has fallen to {rssi} of 254")
        gone = self._was_there("count", message.chancount > 0) and message.chancount == 0
        self._judge(now, "count", gone, "its receiver sends no channels")

    def status(self, enabled: int, health: int) -> None:
        """Take SYS_STATUS: its sensors enabled and healthy."""
        is_well = bool(enabled & health & RECEIVER)
        is_gone = self._was_there("status", is_well) and bool(enabled & RECEIVER) and not is_well
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

    def _was_there(self, what: str, is_there: bool) -> bool:
        """A vehicle without a radio does not lose it."""
        if is_there:
            self._seen.add(what)
        return what in self._seen

    def _judge(self, now: float, what: str, is_gone: bool, sentence: str) -> None:
        if not is_gone:
            self._since.pop(what, None)
        lasts = is_gone and now - self._since.setdefault(what, now) >= LASTS_S
        self._set(what, lasts, sentence)

    def _set(self, what: str, is_gone: bool, sentence: str) -> None:
        if is_gone:
            self._found[what] = f"the radio is lost: {sentence}"
        else:
            self._found.pop(what, None)
