"""A helm display's side of the link, shared by the page and the terminal: what comes, what goes, who is asked. Pure."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink_codec import Message
from autopilot.params.ftp_client import FtpClient
from autopilot.params.protocol import Target
from autopilot.params.session import GROUND_STATION_COMPONENT, GROUND_STATION_SYSTEM
from autopilot.web.alarms import AlarmBoard
from autopilot.web.course import Course
from autopilot.web.orders import Orders
from autopilot.web.parameter_desk import ParameterDesk
from autopilot.web.view import BoatView

HEARTBEAT_S = 1.0
RATES_S = 5.0
"""The rates are asked for again after this while they do not come: the boat may have started again."""
WANTED_HZ = {
    int(dialect.MAVLINK_MSG_ID_ATTITUDE): 10.0,
    int(dialect.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT): 5.0,
    int(dialect.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT): 2.0,
}
SYSTEM, COMPONENT = GROUND_STATION_SYSTEM, int(GROUND_STATION_COMPONENT)

__all__ = ["COMPONENT", "SYSTEM", "Station"]


class Station:
    """Give `receive` every message and send what `due` returns.

    Attributes:
        view: what is known of the boat.  orders: what it is told.  parameters, files, alarms, course: its desks.
    """

    def __init__(self) -> None:
        self.view = BoatView()
        self.orders = Orders()
        self.files = FtpClient()
        self.parameters = ParameterDesk(self.files)
        self.alarms = AlarmBoard(self.files)
        self.course = Course(self.orders, self.view)
        self._next_heartbeat = -math.inf
        self._next_rates = -math.inf
        self._boot_ms = 0
        self._count = 0

    @property
    def target(self) -> Target | None:
        """Whom orders go to: a running Norrbin, or nobody."""
        vehicle = self.view.vehicle
        return vehicle.target if vehicle is not None and self.view.is_ours else None

    def receive(self, now: float, message: Message) -> None:
        """Take a message that came at `now` [s]."""
        view = self.view
        view.take(now, message)
        target = self.target
        if target is None or (message.get_srcSystem(), message.get_srcComponent()) != target[:2]:
            return
        kind = message.get_type()
        if kind == "COMMAND_ACK":
            self.orders.receive(now, message)
        elif kind == "FILE_TRANSFER_PROTOCOL":
            self.files.receive(now, message)
        elif kind in ("PARAM_VALUE", "PARAM_ERROR"):
            self.parameters.receive(now, message, target)
        elif kind == "ATTITUDE":
            self._watch_start(now, message.time_boot_ms)
            self._count += 1

    def due(self, now: float) -> list[Message]:
        """Return what to send at `now` [s]."""
        messages: list[Message] = []
        if now >= self._next_heartbeat:
            self._next_heartbeat = now + HEARTBEAT_S
            messages.append(
                dialect.MAVLink_heartbeat_message(
                    dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3
                )
            )
        self.view.texts.look(now)
        target = self.target
        if target is None:
            return messages
        self.alarms.look(now, self.view)
        self.course.look()
        if now >= self._next_rates:
            messages += self._rates(now, target)
        messages += self.orders.due(now, target)
        messages += self.parameters.due(now, target)
        messages += self.files.due(now, target)
        return messages

    def _rates(self, now: float, target: Target) -> list[Message]:
        """Ask for the rates we want, unless headings already come about as often."""
        is_slow = self._count < 0.7 * RATES_S * WANTED_HZ[int(dialect.MAVLINK_MSG_ID_ATTITUDE)]
        self._next_rates, self._count = now + RATES_S, 0
        if not is_slow:
            return []
        return [
            dialect.MAVLink_command_long_message(
                *target[:2], dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 0, identity, 1.0e6 / rate, 0, 0, 0, 0, 0
            )
            for identity, rate in WANTED_HZ.items()
        ]

    def _watch_start(self, now: float, boot_ms: int) -> None:
        """A boat whose clock goes backwards has started again: its parameters may be others, our rates are gone."""
        if boot_ms < self._boot_ms:
            self.parameters.forget()
            self.alarms.forget()
            self._next_rates = now
        self._boot_ms = boot_ms
