"""Any row of orders, losses and hands on the helm: who has the rudder, and that nothing engages by itself."""

from __future__ import annotations

import math
from typing import Any

from boat_at_sea import ServedBoat, item, place
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.links.ground_station.mission import from_message
from autopilot.signals import HelmSample, Mode, OrderKind

COMMANDS: dict[str, tuple[int, tuple[float, ...]]] = {
    "arm": (dialect.MAV_CMD_COMPONENT_ARM_DISARM, (1,)),
    "disarm": (dialect.MAV_CMD_COMPONENT_ARM_DISARM, (0,)),
    "manual": (dialect.MAV_CMD_DO_SET_MODE, (1, 0)),
    "guided": (dialect.MAV_CMD_DO_SET_MODE, (1, 15)),
    "auto": (dialect.MAV_CMD_DO_SET_MODE, (1, 10)),
    "start": (dialect.MAV_CMD_MISSION_START, ()),
    "yaw": (dialect.MAV_CMD_CONDITION_YAW, (120,)),
    "place": (dialect.MAV_CMD_DO_REPOSITION, (-1, 0, 0, 0, 28.65, 11.46, 0)),
    "place and mode": (dialect.MAV_CMD_DO_REPOSITION, (-1, 1, 0, 0, 28.65, 11.46, 0)),
    "zigzag": (dialect.MAV_CMD_USER_1, (10, 10, 4)),
    "turn": (dialect.MAV_CMD_USER_2, (-15, 2)),
    "pattern": (dialect.MAV_CMD_USER_3, (1, 1, 40)),
}
ENGAGING = {"guided", "auto", "start", "place and mode", "zigzag", "turn", "pattern"}
TYPED = ("e", "e 90", "s", "+10", "-1", "r 5", "t", "t 1", "p u +", "f")
TYPED_ENGAGING = ("e", "e 90", "r 5", "t", "t 1", "p u +", "f")
OTHERS = ("upload", "clear", "set current", "helm taken", "helm free", "touch", "gps lost", "gps back", "wait")
ACCEPTED = (dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_IN_PROGRESS)


class Watch:
    """The boat, and what has been ordered of it since its helm was last taken or given back."""

    def __init__(self) -> None:
        self.boat = ServedBoat()
        self.gps, self.is_taken, self.may_steer = True, False, False
        self.boat.sail(1.0)

    def do(self, act: str) -> None:
        before = len(self.boat.ticks)
        if act in COMMANDS:
            self.command(act)
        elif act in TYPED:
            self.type_line(act)
        else:
            self.other(act)
        self.boat.sail(0.5, gps=self.gps)
        self.check(before)

    def command(self, act: str) -> None:
        command, values = COMMANDS[act]
        parameters = [*values, *[0.0] * (7 - len(values))]
        was_engaged = self.boat.ticks[-1].mode is Mode.ENGAGED
        self.boat.far.receive()
        self.boat.far.send(
            self.boat.station.encode(dialect.MAVLink_command_long_message(1, 1, command, 0, *parameters))
        )
        heard = self.boat.listen(0.1, gps=self.gps)
        (ack, *_) = [message for message in heard if message.get_type() == "COMMAND_ACK" and message.command == command]
        if act in ENGAGING and ack.result in ACCEPTED:
            assert self.boat.commands.armed or was_engaged, f"{act} accepted though disarmed"
            self.may_steer = True
        elif act in ("manual", "disarm"):
            assert ack.result == dialect.MAV_RESULT_ACCEPTED
            self.may_steer = False

    def type_line(self, line: str) -> None:
        try:
            self.boat.skipper.type_line(line)
        except InputError:
            return
        self.may_steer = (self.may_steer or line in TYPED_ENGAGING) and line != "s"

    def other(self, act: str) -> None:
        mission: Any = self.boat.mission
        if act == "upload":
            mission.replace([from_message(item(n, place(100.0 * n, 80.0))) for n in range(3)])
        elif act == "clear":
            mission.replace([])
        elif act == "set current":
            mission.set_current(1)
        elif act == "helm free":
            self.helm(False)
        elif act == "helm taken":
            self.helm(True)
        elif act == "touch":
            self.helm(True)
            self.helm(False)
        elif act in ("gps lost", "gps back"):
            self.gps = act == "gps back"
            self.boat.sail(6.0, gps=self.gps)

    def helm(self, taken: bool) -> None:
        self.is_taken = taken
        if taken and self.boat.ticks[-1].mode is Mode.ENGAGED:
            self.may_steer = False
        self.boat.sail(0.1, gps=self.gps, helm=HelmSample(0.0, not taken, "stick", "rc"))

    def check(self, before: int) -> None:
        for tick in self.boat.ticks[before:]:
            if tick.mode is Mode.ENGAGED:
                assert self.may_steer, "engaged though nobody has ordered it since the helm was taken"
                assert tick.command.engaged and abs(tick.command.angle) <= math.radians(30.0) + 1e-9
            if tick.mode in (Mode.STANDBY, Mode.OVERRIDE):
                assert not tick.command.engaged
        last = self.boat.ticks[-1]
        assert not (self.is_taken and last.command.engaged)
        if last.mode is Mode.OVERRIDE:
            assert not self.boat.track.following or self.may_steer, "a route outlives an override"
        if last.mode is Mode.ENGAGED and last.order.kind is OrderKind.HEADING:
            assert math.isfinite(self.boat.skipper(self.boat.box.time, last).heading)


ACTS = st.sampled_from([*COMMANDS, *TYPED, *OTHERS])


@given(st.lists(ACTS, min_size=4, max_size=14))
@settings(max_examples=12, deadline=None)
def test_nothing_engages_by_itself_and_a_hand_on_the_helm_wins(acts: list[str]) -> None:
    watch = Watch()
    for act in ("arm", "upload", *acts):
        watch.do(act)


def test_who_has_the_helm_is_known_though_no_station_was_there_when_it_changed() -> None:
    boat = ServedBoat(armed=True)
    line, none = boat.links, []
    guided = (dialect.MAV_CMD_DO_SET_MODE, 1, 15)

    def away(available: bool, reason: str) -> None:
        boat.links = none
        boat.sail(0.5, helm=HelmSample(0.0, available, reason, "vehicle"))
        boat.links = line

    boat.sail(0.5, helm=HelmSample(0.0, False, "the vehicle is disarmed", "vehicle"))
    assert boat.command(*guided) == dialect.MAV_RESULT_TEMPORARILY_REJECTED
    away(True, "")
    assert boat.command(*guided) == dialect.MAV_RESULT_ACCEPTED
    boat.command(dialect.MAV_CMD_DO_SET_MODE, 1, 0)
    away(False, "the vehicle is disarmed")
    assert boat.command(*guided) == dialect.MAV_RESULT_TEMPORARILY_REJECTED
