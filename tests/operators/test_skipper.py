"""What the skipper types becomes orders; every request to engage has a new serial, a mere change of heading has not."""

from __future__ import annotations

import fcntl
import math
import os
import pty
import subprocess
import sys
import termios
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.angles import wrap
from autopilot.errors import InputError
from autopilot.guidance.plotter import PlotterGuide
from autopilot.guidance.track import TrackGuide
from autopilot.links.ground_station.mission import Mission
from autopilot.operators.skipper import HELP, Skipper
from autopilot.operators.trial_script import heading_of
from autopilot.signals import (
    AlarmEvent,
    CompassSample,
    Mode,
    NavState,
    Order,
    OrderKind,
    PositionSample,
    Reference,
    RudderCommand,
    Tick,
)

RUDDER_MAX = math.radians(30.0)


def ticked(order: Order, mode: Mode = Mode.ENGAGED, heading: float = 1.0) -> Tick:
    state = NavState(0.0, heading, 0.0, 4.6, 0.0, 0.0, 0.0, True)
    command = RudderCommand(0.0, 0.0, mode is Mode.ENGAGED)
    return Tick(0, 0.0, (), order, state, Reference(heading), 0.0, command, mode, ())


@pytest.fixture
def skipper() -> Skipper:
    return Skipper(RUDDER_MAX, PlotterGuide(), Mission(TrackGuide()))


def test_nothing_is_steered_before_the_first_wish(skipper: Skipper) -> None:
    assert skipper(0.0, None).kind is OrderKind.STANDBY


@pytest.mark.parametrize("line", ["", "  ", "?", "h", "help\n"])
def test_help_changes_nothing(skipper: Skipper, line: str) -> None:
    assert skipper.type_line(line) == HELP
    assert skipper(0.0, None) == Order()


def test_a_heading_is_engaged_in_degrees(skipper: Skipper) -> None:
    skipper.type_line("e 270\n")
    order = skipper(0.0, None)
    assert (order.kind, order.serial) == (OrderKind.HEADING, 1)
    assert order.heading == pytest.approx(math.radians(-90.0))


def test_the_present_heading_is_adopted_once_engaged_and_then_kept(skipper: Skipper) -> None:
    skipper.type_line("e")
    wanted = skipper(0.0, None)
    assert math.isnan(wanted.heading)
    assert math.isnan(skipper(0.1, ticked(wanted, Mode.STANDBY)).heading), "not before the pilot has engaged"
    assert skipper(0.2, ticked(wanted, heading=0.7)).heading == 0.7
    assert skipper(0.3, ticked(wanted, heading=0.9)).heading == 0.7


def test_an_older_order_is_not_taken_for_the_adoption(skipper: Skipper) -> None:
    skipper.type_line("e 10")
    before = skipper(0.0, None)
    skipper.type_line("e")
    assert math.isnan(skipper(0.1, ticked(before)).heading)


@pytest.mark.parametrize(("line", "degrees"), [("+10", 5.0), ("-1", -6.0), ("+ 10", 5.0), ("-170", -175.0)])
def test_a_change_of_heading_keeps_the_serial_and_wraps(skipper: Skipper, line: str, degrees: float) -> None:
    skipper.type_line("e 355")
    skipper.type_line(line)
    order = skipper(0.0, None)
    assert math.degrees(wrap(order.heading - math.radians(degrees))) == pytest.approx(0.0, abs=1e-9)
    assert order.serial == 1


@pytest.mark.parametrize("first", ["", "s", "r 5"])
def test_without_a_heading_there_is_none_to_change(skipper: Skipper, first: str) -> None:
    skipper.type_line(first)
    before = skipper(0.0, None)
    with pytest.raises(InputError, match="no heading is being steered yet"):
        skipper.type_line("+10")
    assert skipper(0.0, None).is_same(before)


def test_a_step_before_the_pilot_has_engaged_counts_from_where_it_does(skipper: Skipper) -> None:
    skipper.type_line("e")
    assert skipper.type_line("+10") == "engaging +10 deg from the present heading"
    skipper.type_line("-1")
    wanted = skipper(0.0, None)
    assert skipper(0.1, ticked(wanted, heading=0.7)).heading == pytest.approx(0.7 + math.radians(9.0))
    skipper.type_line("e")
    wanted = skipper(0.2, None)
    assert skipper(0.3, ticked(wanted, heading=0.5)).heading == 0.5, "of an engagement before nothing is left"


@pytest.mark.parametrize("mode", [Mode.STANDBY, Mode.OVERRIDE, Mode.FAILSAFE])
def test_a_step_behind_an_order_that_the_pilot_has_not_engaged_on_is_refused(skipper: Skipper, mode: Mode) -> None:
    skipper.type_line("e")
    wanted = skipper(0.0, None)
    skipper(0.1, ticked(wanted, heading=0.7)._replace(mode=mode))
    with pytest.raises(InputError, match="engage first"):
        skipper.type_line("+10")
    skipper.type_line("e")
    assert skipper.type_line("+10").startswith("engaging"), "the pilot has not seen this one yet"


def test_a_rudder_angle_is_held_and_standby_ends_it(skipper: Skipper) -> None:
    assert skipper.type_line("r -5") == "rudder -5 deg"
    order = skipper(0.0, None)
    assert (order.kind, order.serial) == (OrderKind.RUDDER, 1)
    assert order.rudder == pytest.approx(math.radians(-5.0))
    skipper.type_line("s")
    assert (skipper(0.0, None).kind, skipper(0.0, None).serial) == (OrderKind.STANDBY, 2)


@pytest.mark.parametrize("mode", [Mode.OVERRIDE, Mode.FAILSAFE, Mode.FAULT])
def test_a_step_while_nothing_is_steered_says_so(skipper: Skipper, mode: Mode) -> None:
    skipper.type_line("e 80")
    skipper(0.1, ticked(skipper(0.0, None)))
    assert skipper.type_line("+20") == "heading 100.0 deg"
    skipper(0.2, ticked(skipper(0.0, None), mode))
    assert skipper.type_line("+20").endswith("nothing is steered now")


@pytest.mark.parametrize("line", ["standby", "STANDBY", "stop", "S"])
def test_the_word_for_standby_gives_the_rudder_back(skipper: Skipper, line: str) -> None:
    skipper.type_line("Engage 90")
    assert skipper(0.0, None).heading == pytest.approx(math.pi / 2.0)
    assert skipper.type_line(line) == "standby: the rudder is yours"
    assert skipper(0.0, None).kind is OrderKind.STANDBY


def test_each_wish_to_engage_has_a_new_serial(skipper: Skipper) -> None:
    serials = []
    for line in ("e 10", "e 10", "e", "r 1", "e 20"):
        skipper.type_line(line)
        serials.append(skipper(0.0, None).serial)
    assert serials == [1, 2, 3, 4, 5]


@pytest.mark.parametrize("line", ["q", "Q", "quit", "exit"])
def test_quit_is_reported(skipper: Skipper, line: str) -> None:
    assert not skipper.quit
    skipper.type_line(line)
    assert skipper.quit


@pytest.mark.parametrize(
    ("line", "named"),
    [
        ("x", "'x' is no command"),
        ("steer 90", "'steer' is no command"),
        ("e north", "'north'"),
        ("e 361", "0 to 360"),
        ("e -1", "0 to 360"),
        ("e nan", "'nan'"),
        ("e inf", "'inf'"),
        ("r", "not a number of degrees"),
        ("r 31", "30 deg each side"),
        ("r nan", "'nan'"),
        ("+", "'+'"),
        ("+361", "-360 to 360"),
        ("-9999", "-360 to 360"),
        ("-x", "'-x'"),
    ],
)
def test_a_slip_of_the_fingers_is_answered_and_steers_nothing(skipper: Skipper, line: str, named: str) -> None:
    skipper.type_line("e 90")
    before = skipper(0.0, None)
    with pytest.raises(InputError) as caught:
        skipper.type_line(line)
    assert named in str(caught.value)
    assert skipper(0.0, None) == before


@given(st.text(max_size=12))
def test_no_line_gives_an_order_outside_what_is_allowed(line: str) -> None:
    skipper = Skipper(RUDDER_MAX, PlotterGuide(), Mission(TrackGuide()))
    try:
        answer = skipper.type_line(line)
    except InputError as error:
        answer = str(error)
    order = skipper(0.0, None)
    assert answer
    assert abs(order.rudder) <= RUDDER_MAX
    assert math.isnan(order.heading) or -math.pi <= order.heading <= math.pi


@given(st.floats(0.0, 360.0))
def test_every_heading_on_the_compass_may_be_typed(degrees: float) -> None:
    assert math.cos(heading_of(str(degrees)) - math.radians(degrees)) == pytest.approx(1.0)


def test_a_key_of_another_character_set_ends_no_steering(tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "autopilot", "run", "lanxin", "--link", "udpin:127.0.0.1:0", "--wait", "0"]
    run = subprocess.Popen(
        command,
        stdin=theirs,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        cwd=tmp_path,
        start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(theirs, termios.TIOCSCTTY, 0),
    )
    assert run.stdout is not None
    shown = b""
    while b"STANDBY" not in shown:  # it takes keys from its first tick on
        said = run.stdout.readline()
        assert said, shown
        shown += said
    os.close(theirs)
    os.write(ours, b"e \xff\xfe90\nr \xed\xa0\x80\n\x1b[31mx\n" + b"t " + b"9" * 3000 + b"\nq\n")
    out, _ = run.communicate(timeout=120)
    os.close(ours)
    out = shown + out
    assert b"Traceback" not in out and b"\x1b[31m" not in out, out
    assert out.count(b"is not a number of degrees") == 2 and b"give the number of a waypoint" in out


def failing(skipper: Skipper, now: float, north: float, east: float, mode: Mode = Mode.ENGAGED) -> Order:
    """The order a tick later, on a boat whose starboard thruster stands still, at a place [m] by its GPS."""
    where = PositionSample(now, 0.5 + north / 6.36e6, 0.2 + east / (6.385e6 * math.cos(0.5)))
    tick = ticked(skipper(now - 0.1, None), mode)
    return skipper(now, tick._replace(now=now, samples=(where,), alarms=(AlarmEvent("thruster_weak", "starboard"),)))


def test_a_boat_with_one_thruster_is_driven_by_swings_about_the_course_home(skipper: Skipper) -> None:
    with pytest.raises(InputError, match="no thruster has been found"):
        skipper.type_line("swing")
    skipper.engage(math.radians(60.0))
    held = failing(skipper, 1.0, 0.0, 0.0)
    assert skipper.type_line("swing").startswith("driving on one thruster")
    swung = failing(skipper, 2.0, 0.0, 0.0)
    assert (swung.kind, swung.rudder, swung.serial) == (OrderKind.ZIGZAG, RUDDER_MAX, held.serial)
    assert math.degrees(swung.heading) == pytest.approx(50.0), "it makes good a course to the side of the dead one"
    # 12 m made good towards 090, 30 deg to starboard of the course
    again = failing(skipper, 60.0, 0.0, 12.0)
    assert math.degrees(again.heading) == pytest.approx(35.0, abs=0.5)
    skipper.type_line("+10")
    assert math.degrees(failing(skipper, 61.0, 0.0, 12.0).heading) == pytest.approx(45.0, abs=0.5)
    skipper.type_line("e 70")
    assert failing(skipper, 62.0, 0.0, 12.0).kind is OrderKind.HEADING


@pytest.mark.parametrize("ended", [lambda skipper: skipper.stand_by(), lambda skipper: skipper.hand_to_track()])
def test_swings_end_with_another_order_and_for_good_with_an_override(
    skipper: Skipper, ended: Callable[[Skipper], None]
) -> None:
    skipper.engage(0.0)
    failing(skipper, 1.0, 0.0, 0.0)
    skipper.pattern(6, 1.0, ())
    assert failing(skipper, 2.0, 0.0, 0.0).kind is OrderKind.ZIGZAG
    assert failing(skipper, 3.0, 0.0, 0.0, Mode.OVERRIDE).kind is OrderKind.HEADING
    assert failing(skipper, 4.0, 0.0, 0.0).kind is OrderKind.HEADING
    skipper.swing()
    ended(skipper)
    assert failing(skipper, 5.0, 0.0, 0.0).kind is not OrderKind.ZIGZAG
    skipper.stand_by()
    failing(skipper, 6.0, 0.0, 0.0)
    with pytest.raises(InputError, match="hold the course home first"):
        skipper.swing()


@pytest.mark.parametrize(("turn", "held"), [(0.14, 1.14), (math.nan, 1.0)])
def test_another_compass_turns_what_is_gone_back_to(skipper: Skipper, turn: float, held: float) -> None:
    skipper.engage(1.0)
    tick = ticked(skipper(0.0, None))
    skipper(0.1, tick)
    skipper.turning(0.1, 20.0)
    order = skipper(0.2, tick._replace(samples=(CompassSample(0.2, turn),)))
    skipper(0.25, tick._replace(order=order))
    skipper.end_trial()
    assert skipper(0.3, tick).heading == pytest.approx(held)
