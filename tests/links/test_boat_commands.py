"""Every command of a ground station by itself: what the helmsman is given, what is answered, and why it is refused."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.guidance.track import TrackGuide, TrackSettings, Waypoint
from autopilot.links.ground_station.commands import Commands
from autopilot.links.ground_station.mission import Mission, MissionItem
from autopilot.links.ground_station.orders import TuningCommands
from autopilot.signals import (
    HelmCause,
    HelmSample,
    Mode,
    NavState,
    Order,
    OrderKind,
    PositionSample,
    Reference,
    RudderCommand,
    Tick,
)
from autopilot.supervision.alarms import CATALOGUE
from autopilot.supervision.supervisor import NOTHING_SEEN, FailsafeAction, against_engaging

ACCEPTED, REJECTED, DENIED, UNSUPPORTED, IN_PROGRESS = 0, 1, 2, 3, 5
ARM, SET_MODE, SET_STANDARD_MODE, YAW, CHANGE_HEADING, REPOSITION = 400, 176, 262, 115, 43002, 192
MISSION_START, SET_CURRENT = 300, 224
ZIGZAG, TURNING, PATTERN, LEARNING, LEVEL, ACKNOWLEDGE = 31010, 31011, 31012, 31013, 31014, 31009
MANUAL, HEADING, TRACK, TRIAL = 0, 15, 10, 3
DEG = math.pi / 180.0


class Run:
    """Something that takes a while."""

    def __init__(self, said: str = "") -> None:
        self.is_over = self.is_complete = False
        self.progress = 0.0
        self.said = said


class Hand:
    """Writes down what was ordered; refuses what it is ordered to."""

    def __init__(self) -> None:
        self.orders: list[tuple[Any, ...]] = []
        self.refuses = ""
        self.run = Run()

    def __getattr__(self, name: str) -> Any:
        def order(*values: Any) -> Run:
            if self.refuses:
                raise InputError(self.refuses)
            self.orders.append((name, *values))
            return self.run

        return order


class Tuner:
    """Writes down what is to be put in force."""

    level = 5.0

    def __init__(self) -> None:
        self.asked: list[tuple[Any, ...]] = []
        self.run = Run("the level is 7 now")

    def set_level(self, level: int) -> Run:
        self.asked.append(("level", level))
        return self.run

    def adopt(self) -> Run:
        self.asked.append(("adopt",))
        return self.run

    def revert(self) -> Run:
        self.asked.append(("revert",))
        return self.run

    def learnt(self) -> dict[str, float]:
        return {}


def tick(mode: Mode = Mode.ENGAGED, kind: OrderKind = OrderKind.HEADING, is_led: bool = False) -> Tick:
    order = Order(kind, 0.5, serial=1, is_led=is_led)
    state = NavState(1.0, 1.0, 0.0, 4.0, 0.0, 0.0, 0.1, True)
    return Tick(1, 1.0, (), order, state, Reference(0.7), 0.0, RudderCommand(1.0, 0.0, True), mode, ())


STANDBY = tick(Mode.STANDBY)
ITEMS = tuple(MissionItem(3, 16, (0.0, 0.0, 0.0, 0.0), 10_000 * number, 10_000, 0.0) for number in range(1, 4))


class Service:
    """Commands with a helmsman who writes down, a route of three places and a position."""

    def __init__(self, armed: bool = True, tuner: bool = True, position: bool = True, magnetic: bool = False) -> None:
        self.hand, self.tuner = Hand(), Tuner()
        self.guide = TrackGuide(TrackSettings(magnetic=magnetic))
        if position:
            self.guide.take(PositionSample(1.0, 0.0, 0.0))
        self.mission = Mission(self.guide, ITEMS)
        self.memory, self.failsafe = NOTHING_SEEN, FailsafeAction(1.0, "release", 0.0, resume=False)
        self.commands = Commands(
            self.hand,  # type: ignore[arg-type]
            armed,
            self.mission,
            self.tuner if tuner else None,
            against_engaging=lambda at: against_engaging(self.memory, self.failsafe, at.state),
        )

    def give(self, command: int, *values: float, at: Tick | None = STANDBY) -> int:
        return self.commands.execute(command, (*values, *[0.0] * (7 - len(values))), at)

    @property
    def said(self) -> str:
        return self.commands.refusal


def test_arming_and_disarming() -> None:
    service = Service(armed=False)
    assert service.give(ARM, 1.0) == ACCEPTED and service.commands.armed and service.hand.orders == []
    assert service.give(ARM, 2.0) == UNSUPPORTED and service.commands.armed
    assert service.give(ARM, 0.0) == ACCEPTED and not service.commands.armed
    assert service.hand.orders == [("stand_by",)]
    assert service.give(ARM, -1.0) == service.give(ARM, math.nan) == service.give(ARM, 0.5) == UNSUPPORTED


@pytest.mark.parametrize("at", [STANDBY, tick(Mode.OVERRIDE), tick(Mode.FAILSAFE), tick(kind=OrderKind.RUDDER)])
def test_the_heading_mode_engages_where_none_is_steered(at: Tick | None) -> None:
    service = Service()
    assert service.give(SET_MODE, 1.0, 15.0, at=at) == ACCEPTED
    assert service.hand.orders == [("engage", None)]


SILENT = STANDBY._replace(state=STANDBY.state._replace(heading_age=1.1))
NEVER_HEARD = STANDBY._replace(state=STANDBY.state._replace(valid=False))
ORDERS_THAT_ENGAGE = [
    (SET_MODE, 1.0, 15.0), (SET_MODE, 1.0, 10.0), (MISSION_START, 0.0, 0.0), (ZIGZAG, 10.0, 10.0, 60.0),
    (PATTERN, 1.0, 0.0), (REPOSITION, -1.0, 1.0, 0.0, math.nan, 0.001, 0.001),
]  # fmt: skip


@pytest.mark.parametrize("order", ORDERS_THAT_ENGAGE)
@pytest.mark.parametrize("at", [SILENT, NEVER_HEARD])
def test_nothing_engages_a_boat_that_is_silent(at: Tick, order: tuple[float, ...]) -> None:
    service = Service()
    assert service.give(int(order[0]), *order[1:], at=at) == REJECTED
    assert service.said == "no heading comes: nothing to steer by" and service.hand.orders == []
    assert service.give(int(order[0]), *order[1:]) in (ACCEPTED, IN_PROGRESS)


def test_how_old_a_heading_may_be_to_engage_on_is_for_the_vessel_to_say() -> None:
    service = Service()
    service.failsafe = service.failsafe._replace(heading_timeout=8.0)
    aged = [STANDBY._replace(state=STANDBY.state._replace(heading_age=age)) for age in (7.9, 8.1)]
    assert [service.give(SET_MODE, 1.0, 15.0, at=at) for at in aged] == [ACCEPTED, REJECTED]


def test_nothing_engages_where_somebody_else_has_the_helm() -> None:
    service = Service()

    def helm(available: bool, reason: str, cause: HelmCause = HelmCause.TAKEN) -> None:
        sample = HelmSample(1.0, available, reason, "vehicle", cause)
        service.memory = service.memory._replace(helm={"vehicle": sample})

    helm(False, "the vehicle is not armed")
    assert service.give(SET_MODE, 1.0, 15.0) == REJECTED and service.said == "the vehicle is not armed"
    helm(False, "to be proved on engaging", HelmCause.UNPROVEN)
    assert service.give(SET_MODE, 1.0, 15.0) == ACCEPTED
    helm(False, "the vehicle is not armed")
    assert service.give(SET_MODE, 1.0, 0.0) == ACCEPTED, "to stand by needs nothing"
    helm(True, "")
    assert service.give(SET_MODE, 1.0, 15.0) == ACCEPTED


def test_the_heading_mode_keeps_the_heading_that_is_steered() -> None:
    service = Service()
    assert service.give(SET_MODE, 1.0, 15.0, at=tick()) == ACCEPTED
    assert service.hand.orders == []
    assert service.give(SET_MODE, 1.0, 15.0, at=tick(is_led=True)) == ACCEPTED
    assert service.hand.orders == [("turn_to", 0.5)], "a pattern or the wind"
    service.guide.follow([Waypoint(0.1, 0.1)])
    assert service.give(SET_MODE, 1.0, 15.0, at=tick(is_led=True)) == ACCEPTED
    assert service.hand.orders == [("turn_to", 0.5)], "going to a place belongs to the mode"
    service.mission.follow()
    assert service.give(SET_MODE, 1.0, 15.0, at=tick()) == ACCEPTED
    assert service.hand.orders == [("turn_to", 0.5)] * 2


@pytest.mark.parametrize(
    ("values", "result", "says"),
    [
        ((1.0, 3.0), DENIED, "a trial is begun by its command: MAV_CMD_USER_1 or USER_2"),
        ((1.0, 4.0), DENIED, "mode 4 is not known: MANUAL (0), GUIDED (15), AUTO (10) and ACRO, the wind (1), are"),
        ((1.0, 15.5), DENIED, ""),
        ((1.0, math.nan), DENIED, ""),
        ((math.nan, 15.0), DENIED, ""),
        ((0.0, 15.0), UNSUPPORTED, ""),
        ((254.0, 15.0), UNSUPPORTED, ""),
    ],
)
def test_modes_that_cannot_be_ordered_are_refused(values: tuple[float, ...], result: int, says: str) -> None:
    service = Service()
    assert service.give(SET_MODE, *values) == result
    assert (service.said, service.hand.orders) == (says, [])


def test_standby_is_taken_unarmed_and_other_modes_are_not() -> None:
    service = Service(armed=False)
    assert service.give(SET_MODE, 1.0, 0.0) == ACCEPTED
    assert service.hand.orders == [("stand_by",)]
    for at in (None, STANDBY):
        for mode in (15.0, 10.0):
            assert (service.give(SET_MODE, 1.0, mode, at=at), service.said) == (REJECTED, "arm first")
    assert service.give(SET_MODE, 1.0, 10.0, at=tick()) == ACCEPTED, "engaged from the terminal is armed"
    assert service.said == "", "the refusal before is not said again"


def test_the_track_mode_follows_the_route_once() -> None:
    service = Service()
    assert service.give(SET_STANDARD_MODE, 6.0) == ACCEPTED
    assert service.hand.orders == [("hand_to_track",)] and service.mission.is_followed
    assert service.give(SET_MODE, 1.0, 10.0, at=tick()) == ACCEPTED
    assert len(service.hand.orders) == 1, "already there"
    assert service.give(SET_MODE, 1.0, 10.0, at=STANDBY) == ACCEPTED
    assert len(service.hand.orders) == 2, "not engaged any more"
    assert service.give(SET_STANDARD_MODE, 1.0) == UNSUPPORTED


@pytest.mark.parametrize(
    ("service", "at", "says"),
    [
        (Service(position=False), STANDBY, "no position: check the GPS and its link"),
        (Service(), None, "no heading comes: nothing to steer by"),
        (Service(magnetic=True), STANDBY, "courses are magnetic"),
    ],
)
def test_a_route_that_cannot_be_followed(service: Service, at: Tick | None, says: str) -> None:
    for command, values in ((SET_MODE, (1.0, 10.0)), (MISSION_START, (0.0, 0.0))):
        assert service.give(command, *values, at=at) == REJECTED
        assert says in service.said and service.hand.orders == []


@pytest.mark.parametrize(("first", "last"), [(0.0, 0.0), (1.0, 0.0), (2.0, 2.0), (1.0, 2.0)])
def test_a_mission_starts_at_an_item_and_goes_to_its_end(first: float, last: float) -> None:
    service = Service()
    assert service.give(MISSION_START, first, last) == ACCEPTED
    assert service.mission.is_followed and service.mission.current == service.guide.target == int(first)


@pytest.mark.parametrize(
    ("armed", "values", "result", "says"),
    [
        (True, (0.0, 1.0), DENIED, "a route is followed to its end: set the last item to 0"),
        (True, (0.0, 3.0), DENIED, "a route is followed to its end: set the last item to 0"),
        (True, (math.nan, 0.0), DENIED, "a route is followed to its end: set the last item to 0"),
        (True, (3.0, 0.0), DENIED, "there is no waypoint 3 in a route of 3"),
        (True, (-1.0, 0.0), DENIED, "there is no waypoint -1 in a route of 3"),
        (False, (0.0, 0.0), REJECTED, "arm first"),
    ],
)
def test_missions_that_cannot_be_followed_are_not_started(
    armed: bool, values: tuple[float, ...], result: int, says: str
) -> None:
    service = Service(armed)
    assert (service.give(MISSION_START, *values), service.said) == (result, says)
    assert not service.mission.is_followed


def test_the_current_item_is_set_and_minus_one_leaves_it() -> None:
    service = Service()
    assert service.give(SET_CURRENT, 2.0) == ACCEPTED and service.mission.current == 2
    assert service.give(SET_CURRENT, -1.0) == ACCEPTED and service.mission.current == 2
    for number, named in ((3.0, "3"), (-2.0, "-2"), (0.5, "0.5"), (math.nan, "nan"), (math.inf, "inf")):
        assert service.give(SET_CURRENT, number) == DENIED
        assert service.said == f"there is no waypoint {named} in a route of 3"
    assert service.mission.current == 2


@pytest.mark.parametrize(
    ("values", "heading_deg"),
    [
        ((90.0, 0.0, 0.0, 0.0), 90.0),
        ((90.0, 0.0, -1.0, 0.0), 90.0),
        ((270.0, 0.0, 1.0, 0.0), -90.0),
        ((10.0, 0.0, 1.0, 1.0), 0.5 / DEG + 10.0),
        ((10.0, 0.0, 0.0, 1.0), 0.5 / DEG + 10.0),
        ((10.0, 0.0, -1.0, 1.0), 0.5 / DEG - 10.0),
        ((-10.0, 0.0, -1.0, 1.0), 0.5 / DEG - 10.0),
        ((-10.0, 0.0, 1.0, 1.0), 0.5 / DEG - 10.0),
    ],
)
def test_a_yaw_is_absolute_or_from_the_heading_ordered(values: tuple[float, ...], heading_deg: float) -> None:
    service = Service()
    assert service.give(YAW, *values, at=tick()) == ACCEPTED
    assert service.hand.orders == [("turn_to", pytest.approx(heading_deg * DEG))]


@pytest.mark.parametrize("angle", [360.5, -360.5, 900.0, -1e9, 3e38])
def test_an_angle_beyond_a_full_turn_is_denied(angle: float) -> None:
    service = Service()
    for command, values in ((YAW, (angle,)), (YAW, (angle, 0.0, 1.0, 1.0)), (CHANGE_HEADING, (1.0, angle))):
        assert service.give(command, *values, at=tick()) == DENIED
        assert service.said == "give an angle of -360 to 360 degrees" and service.hand.orders == []


@pytest.mark.parametrize("angle", [360.0, -360.0])
def test_a_full_turn_is_an_angle(angle: float) -> None:
    service = Service()
    assert service.give(YAW, angle, at=tick()) == service.give(CHANGE_HEADING, 1.0, angle, at=tick()) == ACCEPTED
    assert service.hand.orders == [("turn_to", pytest.approx(0.0))] * 2


@pytest.mark.parametrize("command", [YAW, CHANGE_HEADING])
@pytest.mark.parametrize("at", [None, STANDBY, tick(Mode.OVERRIDE), tick(kind=OrderKind.RUDDER)])
def test_a_heading_is_changed_only_while_one_is_steered(command: int, at: Tick | None) -> None:
    service = Service()
    values = (90.0,) if command == YAW else (1.0, 90.0)
    assert service.give(command, *values, at=at) == REJECTED
    assert service.said == "not engaged: arm and set mode GUIDED first" and service.hand.orders == []


@pytest.mark.parametrize("values", [(math.nan,), (math.inf,), (10.0, 0.0, 0.0, 0.5), (10.0, 0.0, 0.0, 2.0)])
def test_a_yaw_of_no_sense_is_denied(values: tuple[float, ...]) -> None:
    service = Service()
    assert service.give(YAW, *values, at=tick()) == DENIED and service.hand.orders == []


def test_a_relative_yaw_needs_a_heading() -> None:
    service, at = Service(), tick()
    nameless = at._replace(order=at.order._replace(heading=math.nan))
    for each in (None, nameless):
        assert service.give(YAW, 10.0, 0.0, 1.0, 1.0, at=each) == REJECTED
        assert service.said == "no heading is being steered yet"
    assert service.give(YAW, 10.0, at=nameless) == ACCEPTED, "an absolute one does not"


def test_each_of_two_turns_between_two_ticks_turns() -> None:
    service, at = Service(), tick()
    ordered = at.order.heading
    for each in (10.0, 10.0, -5.0):
        assert service.give(YAW, abs(each), 0.0, math.copysign(1.0, each), 1.0, at=at) == ACCEPTED
    assert [heading for _, heading in service.hand.orders] == [
        pytest.approx(ordered + turn * DEG) for turn in (10.0, 20.0, 15.0)
    ]
    assert service.give(YAW, 10.0, 0.0, 1.0, 1.0, at=tick()) == ACCEPTED
    assert service.hand.orders[-1][1] == pytest.approx(ordered + 10.0 * DEG), "the next tick says what is ordered"
    assert service.give(YAW, 90.0, at=at) == service.give(YAW, 10.0, 0.0, 1.0, 1.0, at=at) == ACCEPTED
    assert service.hand.orders[-1][1] == pytest.approx(100.0 * DEG)


def test_a_heading_is_of_type_1() -> None:
    service = Service()
    assert service.give(CHANGE_HEADING, 1.0, 190.0, at=tick()) == ACCEPTED
    assert service.hand.orders == [("turn_to", pytest.approx(-170.0 * DEG))]
    assert service.give(CHANGE_HEADING, 0.0, 90.0, at=tick()) == UNSUPPORTED
    assert service.said == "a course over the ground cannot be steered; give a heading (type 1)"
    for values in ((2.0, 90.0), (1.0, math.nan), (-1.0, 90.0), (1.0, math.inf)):
        assert service.give(CHANGE_HEADING, *values, at=tick()) == DENIED
    assert len(service.hand.orders) == 1


# going to a place: speed, flags, radius, yaw, latitude, longitude, altitude


@pytest.mark.parametrize(
    ("radius", "within"), [(25.0, 25.0), (0.5, 0.5), (0.0, math.nan), (-5.0, math.nan), (math.inf, math.nan)]
)
def test_a_place_is_gone_to_within_its_radius(radius: float, within: float) -> None:
    service = Service()
    assert service.give(REPOSITION, -1.0, 0.0, radius, 0.0, 45.0, -120.0, at=tick()) == ACCEPTED
    assert service.hand.orders == [("hand_to_track",)]
    (place,) = service.guide.route
    assert place == (pytest.approx(45.0 * DEG), pytest.approx(-120.0 * DEG), pytest.approx(within, nan_ok=True))
    assert service.guide.following and not service.mission.is_followed


@pytest.mark.parametrize(
    ("latitude", "longitude", "result"),
    [
        (89.0, 180.0, ACCEPTED),
        (-89.0, -180.0, ACCEPTED),
        (89.01, 0.0, DENIED),
        (-89.01, 0.0, DENIED),
        (0.0, 180.01, DENIED),
        (0.0, -180.01, DENIED),
        (0.0, 0.0, DENIED),
        (0.0, 1.0, ACCEPTED),
        (1.0, 0.0, ACCEPTED),
        (math.nan, 1.0, DENIED),
        (1.0, math.nan, DENIED),
    ],
)
def test_a_place_lies_on_the_map_up_to_89_degrees(latitude: float, longitude: float, result: int) -> None:
    service = Service()
    assert service.give(REPOSITION, -1.0, 0.0, 0.0, 0.0, latitude, longitude, at=tick()) == result
    says = "give a latitude of up to 89 and a longitude of up to 180 degrees"
    assert service.said == ("" if result == ACCEPTED else says)


@pytest.mark.parametrize(("speed", "result"), [(-1.0, 0), (0.0, 0), (math.nan, 0), (0.1, 3), (1.0, 3), (5.0, 3)])
def test_the_speed_is_not_ours(speed: float, result: int) -> None:
    service = Service()
    assert service.give(REPOSITION, speed, 0.0, 0.0, 0.0, 1.0, 1.0, at=tick()) == result
    assert service.said == ("" if result == ACCEPTED else "the speed is not ours to set: leave it at -1")


@pytest.mark.parametrize(
    ("armed", "at", "flags", "result"),
    [
        (True, STANDBY, 1.0, ACCEPTED),
        (True, STANDBY, 3.0, ACCEPTED),
        (True, STANDBY, 0.0, REJECTED),
        (True, STANDBY, 2.0, REJECTED),
        (True, STANDBY, math.nan, REJECTED),
        (False, STANDBY, 1.0, REJECTED),
        (True, tick(Mode.OVERRIDE), 0.0, REJECTED),
        (False, tick(), 0.0, ACCEPTED),
        (True, tick(kind=OrderKind.RUDDER), 0.0, REJECTED),
        (True, tick(kind=OrderKind.RUDDER), 1.0, ACCEPTED),
    ],
)
def test_who_is_not_engaged_goes_to_a_place_with_the_flag_and_armed(
    armed: bool, at: Tick, flags: float, result: int
) -> None:
    service = Service(armed)
    assert service.give(REPOSITION, -1.0, flags, 0.0, 0.0, 1.0, 1.0, at=at) == result
    assert service.said == (
        "" if result == ACCEPTED else "not engaged: arm, and set mode GUIDED or the flag that changes it"
    )
    assert bool(service.hand.orders) is (result == ACCEPTED)


def test_a_route_is_left_for_a_place_with_the_flag() -> None:
    service = Service()
    service.mission.follow()
    assert service.give(REPOSITION, -1.0, 0.0, 0.0, 0.0, 1.0, 1.0, at=tick()) == REJECTED
    assert service.said == "a route is followed: set mode GUIDED first, or the flag that changes it"
    assert service.mission.is_followed
    assert service.give(REPOSITION, -1.0, 1.0, 0.0, 0.0, 1.0, 1.0, at=tick()) == ACCEPTED
    assert not service.mission.is_followed


def test_a_place_needs_a_position_and_true_courses() -> None:
    for service, at, result, says in (
        (Service(position=False), tick(), REJECTED, "no position: check the GPS and its link"),
        (Service(), None, REJECTED, "no position: check the GPS and its link"),
        (Service(magnetic=True), tick(), DENIED, "courses are magnetic"),
    ):
        assert service.give(REPOSITION, -1.0, 1.0, 0.0, 0.0, 1.0, 1.0, at=at) == result
        assert says in service.said and service.hand.orders == []


# what takes a while


@pytest.mark.parametrize(
    ("command", "values", "order"),
    [
        (ZIGZAG, (20.0, 10.0, 60.0), ("zigzag", pytest.approx(20.0 * DEG), pytest.approx(10.0 * DEG), 60.0)),
        (TURNING, (-15.0, 90.0), ("turning", pytest.approx(-15.0 * DEG), 90.0)),
    ],
)
def test_a_trial_is_begun_said_again_and_let_end(command: int, values: tuple[float, ...], order: Any) -> None:
    service = Service()
    assert service.give(command, *values) == IN_PROGRESS
    assert service.hand.orders == [order]
    assert service.give(command, *values) == IN_PROGRESS, "our answer was lost"
    assert len(service.hand.orders) == 1
    differing = [(command, (*values[:n], values[n] + 1.0, *values[n + 1 :])) for n in range(len(values))]
    for other, others in (*differing, (ZIGZAG + TURNING - command, values)):
        assert service.give(other, *others) == REJECTED
        assert service.said == "a trial is being sailed: cancel it first"
    assert service.give(LEVEL, 3.0) == REJECTED
    assert service.said == "something else is under way: let it end first"
    service.hand.run.is_over = True
    assert service.give(command, *values) == IN_PROGRESS
    assert len(service.hand.orders) == 2, "the one before is over"


def test_a_trial_is_refused_unarmed_and_by_the_helmsman() -> None:
    service = Service(armed=False)
    assert (service.give(ZIGZAG, 20.0, 10.0, 60.0), service.said) == (REJECTED, "arm first")
    assert (service.give(PATTERN, 1.0, 1.0), service.said) == (REJECTED, "arm first")
    service.commands.armed = True
    service.hand.refuses = "rudder 80 deg: -30 to 30 are allowed"
    for command in (ZIGZAG, TURNING, PATTERN):
        assert (service.give(command, 1.0, 1.0), service.said) == (DENIED, service.hand.refuses)
    assert service.commands.running is None


def test_a_trial_is_cancelled_by_its_own_number() -> None:
    service = Service()
    assert not service.commands.cancel(ZIGZAG), "nothing runs"
    service.give(ZIGZAG, 20.0, 10.0, 60.0)
    running = service.commands.running
    assert running is not None
    assert not service.commands.cancel(TURNING) and not running.is_cancelled
    assert service.commands.cancel(ZIGZAG) and running.is_cancelled
    assert service.hand.orders[-1] == ("end_trial",)
    service.hand.run.is_over = True
    assert running.result == 6
    assert not service.commands.cancel(ZIGZAG), "it is over"


def test_how_far_a_trial_is_and_how_it_ended() -> None:
    service = Service()
    service.give(ZIGZAG, 20.0, 10.0, 60.0)
    running, run = service.commands.running, service.hand.run
    assert running is not None
    for progress, percent in ((0.0, 0), (0.25, 25), (0.994, 99), (1.0, 100)):
        run.progress = progress
        assert (running.percent, running.result) == (percent, IN_PROGRESS)
    run.is_over = True
    assert running.result == 4, "failed"
    run.is_complete = True
    assert running.result == ACCEPTED


def test_a_pattern_has_a_number_a_side_and_its_sizes() -> None:
    service = Service()
    assert service.give(PATTERN, 2.0, -1.0, 50.0, 30.0) == ACCEPTED
    assert service.hand.orders == [("pattern", 2, -1.0, (50.0, 30.0))]
    for number in (math.nan, math.inf, 1.5):
        assert service.give(PATTERN, number, 1.0) == DENIED
    assert len(service.hand.orders) == 1


def test_alarms_are_acknowledged_by_anybody() -> None:
    service = Service(armed=False)
    assert service.give(ACKNOWLEDGE, at=None) == ACCEPTED
    number = CATALOGUE["rudder_stuck"].number
    assert service.give(ACKNOWLEDGE, number, at=None) == ACCEPTED
    assert float(np.float32(number)) == number, "a float of MAVLink holds it"
    for unknown in (1.0, -1.0, math.nan, math.inf):
        assert service.give(ACKNOWLEDGE, unknown, at=None) == DENIED
    assert service.hand.orders == [("acknowledge", ""), ("acknowledge", "rudder_stuck")]


@pytest.mark.parametrize(
    ("command", "value", "asked"),
    [
        (LEARNING, 1.0, ("adopt",)),
        (LEARNING, 2.0, ("revert",)),
        (LEVEL, 7.0, ("level", 7)),
        (LEVEL, -1.0, ("level", -1)),
    ],
)
def test_tuning_is_begun_said_again_and_let_end(command: int, value: float, asked: tuple[Any, ...]) -> None:
    service = Service(armed=False)
    assert service.give(command, value, at=None) == IN_PROGRESS
    assert service.tuner.asked == [asked]
    assert service.give(command, value) == IN_PROGRESS
    assert service.tuner.asked == [asked], "said again, not begun again"
    assert not service.commands.cancel(command), "it cannot be cancelled"
    service.commands.armed = True
    assert service.give(ZIGZAG, 1.0, 1.0, 1.0) == REJECTED
    for other, number in ((LEVEL + LEARNING - command, 1.0), (command, value + 1.0)):
        assert (service.give(other, number), service.said) == (
            REJECTED,
            "something else is under way: let it end first",
        )
    service.tuner.run.is_over = True
    assert service.give(command, value) == IN_PROGRESS
    assert service.tuner.asked == [asked] * 2


def test_tuning_of_no_sense_is_refused() -> None:
    service = Service()
    for value in (0.0, 3.0, 1.5, math.nan):
        assert service.give(LEARNING, value) == UNSUPPORTED
    for value, named in ((1.5, "1.5"), (math.nan, "nan"), (math.inf, "inf")):
        assert service.give(LEVEL, value) == DENIED
        assert service.said == f"response level {named}: allowed is a whole number from 1 (calm) to 9 (quick)"
    assert service.tuner.asked == [] and service.commands.running is None
    without = Service(tuner=False)
    assert without.give(LEVEL, 5.0) == without.give(LEARNING, 1.0) == UNSUPPORTED


def test_what_tuning_came_to_is_reported_once() -> None:
    tuner = Tuner()
    commands = TuningCommands(tuner)
    assert commands.outcome() == ""
    commands.begin(LEVEL, 7.0)
    assert commands.outcome() == ""
    tuner.run.is_over = True
    assert commands.outcome() == "the level is 7 now"
    assert commands.outcome() == ""


def test_what_is_unknown_is_unsupported() -> None:
    service = Service()
    for command in (0, 16, 399, 401, 31008, 31015, 65535):
        assert service.give(command) == UNSUPPORTED
    assert service.hand.orders == [] and service.said == ""
    assert dialect.MAV_CMD_USER_5 == LEVEL and dialect.MAV_CMD_SPATIAL_USER_5 == ACKNOWLEDGE
