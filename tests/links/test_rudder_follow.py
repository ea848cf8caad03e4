"""A rudder that does not follow is noticed from the rudder sensor; one that does is never accused."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.errors import InputError
from autopilot.links.nmea import sentences as encoders
from autopilot.links.nmea.link import NmeaLink, NmeaSettings
from autopilot.links.rudder_order import FollowSettings, RudderFollow
from autopilot.links.transports import loopback_pair
from autopilot.links.url import parse_url
from autopilot.models.steering_gear import SteeringGear, gear_step
from autopilot.signals import HelmSample, RudderCommand

PERIOD = 0.2


def watch(
    orders: Callable[[float], float],
    gear: SteeringGear,
    seconds: float = 60.0,
    offset: float = 0.0,
    stuck: bool = False,
) -> str:
    """Return the sentence after a minute of a rudder that moves as `gear` says, seen every PERIOD."""
    follow = RudderFollow(FollowSettings(math.radians(5.0), gear.rate_max, gear.delay + gear.lag))
    angle = 0.0
    for step in range(round(60.0 / 0.02)):
        now = step * 0.02
        follow.ordered(now, orders(now))
        angle = 0.0 if stuck else gear_step(gear, angle, orders(now - gear.delay), 0.02)
        if step % round(PERIOD / 0.02) == 0:
            follow.measured(now, angle + offset, "IIRSA")
    return follow.reason(60.0)


def gear(rate_deg_s: float, lag: float = 0.1, delay: float = 0.1, stop_deg: float = 30.0) -> SteeringGear:
    return SteeringGear(math.radians(stop_deg), math.radians(rate_deg_s), lag, 0.0, delay)


@given(
    rate=st.floats(2.0, 40.0),
    lag=st.floats(0.0, 0.5),
    delay=st.floats(0.0, 0.3),
    period=st.floats(3.0, 40.0),
    amplitude=st.floats(0.0, 0.5),
)
def test_a_sound_rudder_is_never_accused(
    rate: float, lag: float, delay: float, period: float, amplitude: float
) -> None:
    # an order that the gear can follow: the law is limited to the gear's own rate
    amplitude = min(amplitude, math.radians(rate) * period / math.tau)
    assert watch(lambda now: amplitude * math.sin(math.tau * now / period), gear(rate, lag, delay)) == ""
    assert watch(lambda now: math.copysign(0.5, math.sin(math.tau * now / 40.0)), gear(rate, lag, delay)) == ""


@pytest.mark.parametrize("period", [1.5, 4.0, 20.0])
def test_a_stuck_rudder_is_found_under_a_swinging_order(period: float) -> None:
    reason = watch(lambda now: 0.3 * math.sin(math.tau * now / period), gear(20.0), stuck=True)
    assert reason.startswith("the rudder does not follow: IIRSA shows 0.0 deg while")
    assert "clutch" in reason


def test_a_stop_or_a_sensor_out_of_line_is_found() -> None:
    assert "shows 20.0 deg while 28.6 deg is ordered" in watch(lambda _: 0.5, gear(20.0, stop_deg=20.0))
    assert "shows 8.0 deg while 0.0 deg is ordered" in watch(lambda _: 0.0, gear(20.0), offset=math.radians(8.0))
    assert watch(lambda _: 0.0, gear(20.0), offset=math.radians(4.0)) == ""


def test_a_stuck_rudder_is_reported_within_seconds_and_forgiven_after_release() -> None:
    follow = RudderFollow(FollowSettings())
    said = math.inf
    for step in range(60):
        now = step * 0.1
        follow.ordered(now, 0.3)
        follow.measured(now, 0.0, "IIRSA")
        if follow.reason(now):
            said = min(said, now)
    assert 2.5 <= said <= 3.0
    follow.released()
    assert follow.reason(6.5)
    assert follow.reason(8.5) == ""


def test_a_silent_sensor_accuses_nobody() -> None:
    follow = RudderFollow()
    for second in range(0, 60, 3):
        follow.ordered(float(second), 0.3)
        follow.measured(float(second), 0.0, "IIRSA")
    assert follow.reason(60.0) == ""


def test_the_link_gives_the_helm_up_and_back_again() -> None:
    near, far = loopback_pair()
    link = NmeaLink(near, NmeaSettings(follow=FollowSettings()))
    helm: list[tuple[float, bool, str]] = []
    for step in range(120):
        now = step * 0.1
        far.send(encoders.encode_rsa(0.0))
        helm += [(now, s.available, s.reason) for s in link.receive(now) if isinstance(s, HelmSample)]
        link.send(now, RudderCommand(now, 0.4, now < 6.0))
        far.receive()
    assert [available for _, available, _ in helm] == [True, False, True]
    assert "the rudder does not follow: IIRSA" in helm[1][2]
    assert helm[2][0] > 7.5


def test_a_link_that_does_not_steer_still_sees_a_rudder_that_does_not_follow() -> None:
    near, far = loopback_pair()
    link = NmeaLink(near, NmeaSettings(steers=False))
    helm = []
    for step in range(40):
        far.send(encoders.encode_rsa(0.0))
        helm += [s.available for s in link.receive(step * 0.1) if isinstance(s, HelmSample)]
        link.send(step * 0.1, RudderCommand(step * 0.1, 0.4, True))
    assert helm == [False]
    assert far.receive() == [], "no order has left"


def test_options_of_a_link() -> None:
    link = parse_url("nmea-tcpin:0.0.0.0:10110?steer=no&send=HDT:5,RSA")
    assert (link.host, link.port, link.options.steers) == ("0.0.0.0", 10110, False)
    assert link.options.sends == (("HDT", 5.0), ("RSA", 1.0))
    assert parse_url("nmea:/dev/ttyUSB0:4800").options.steers


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("nmea:/dev/x:4800?speed=3", "option 'speed' behind the ? is unknown or repeated; allowed here"),
        ("nmea:/dev/x:4800?steer=no&steer=no", "option 'steer' behind the ? is unknown or repeated"),
        ("nmea:/dev/x:4800?steer=maybe", "write steer=yes or steer=no"),
        ("nmea:/dev/x:4800?send=GGA", "sentence 'GGA' cannot be sent"),
        ("nmea:/dev/x:4800?send=HDT:fast", "the rate 'fast' of HDT is not a number from 0.1 to 50 (Hz)"),
        ("nmea:/dev/x:4800?talker=ii", "write two capital letters"),
        ("nmea:/dev/x:4800?talker=I", "write two capital letters"),
        ("nmea:/dev/x:4800?talker=Ä1", "write two capital letters"),
        ("nmea:/dev/x:4800?", "option '' behind the ? is unknown"),
        ("udpout:127.0.0.1:14550?steer=no", "this kind of link takes none"),
    ],
)
def test_bad_options_are_one_sentence(url: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_url(url)
    assert words in str(caught.value)
    assert url in str(caught.value)


@pytest.mark.parametrize(("rate_deg_s", "follows"), [(1.6, True), (1.4, False)])
def test_a_gear_of_unknown_rate_makes_a_third_of_five_degrees_a_second_at_least(
    rate_deg_s: float, follows: bool
) -> None:
    follow = RudderFollow(FollowSettings(math.radians(5.0), math.inf))
    follow.ordered(0.0, 0.0)
    follow.ordered(0.0, math.radians(30.0))
    for step in range(80):
        follow.measured(0.1 * step, math.radians(0.1 * step * rate_deg_s), "IIRSA")
    assert (follow.reason(8.0) == "") is follows


def seen(samples: list[tuple[float, float]], order_deg: float = 20.0, **settings: float) -> RudderFollow:
    follow = RudderFollow(FollowSettings(math.radians(5.0), **settings))
    follow.ordered(0.0, math.radians(order_deg))
    for now, degrees in samples:
        follow.measured(now, math.radians(degrees), "IIRSA")
    return follow


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("delay", "steps"), [(0.0, 25), (0.5, 30)])
def test_patience_is_two_and_a_half_seconds_and_the_gear_s_delay(side: float, delay: float, steps: int) -> None:
    for count, is_given_up in ((steps, False), (steps + 1, True)):
        follow = seen([(0.1 * step + 1e-9, 0.0) for step in range(count + 1)], 20.0 * side, delay=delay)
        said = follow.reason(9.0)
        assert bool(said) is is_given_up
    wanted = f"the rudder does not follow: IIRSA shows 0.0 deg while {20.0 * side:.1f} deg is ordered; check drive"
    assert said.startswith(wanted)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("off", "is_right"), [(4.9, True), (5.1, False)])
def test_the_tolerance_holds_to_both_sides_of_the_order(side: float, off: float, is_right: bool) -> None:
    follow = seen([(0.1 * step, 20.0 + side * off) for step in range(60)])
    assert (follow.reason(6.0) == "") is is_right


@pytest.mark.parametrize(("rate", "degrees_s", "follows"), [
    (math.radians(2.0), 0.7, True), (math.radians(2.0), 0.5, False), (math.radians(50.0), 1.6, True),
    (math.radians(50.0), 1.4, False), (math.inf, -9.0, False),
])  # fmt: skip
def test_a_rudder_on_its_way_moves_at_three_tenths_of_its_rate(rate: float, degrees_s: float, follows: bool) -> None:
    follow = seen([(0.1 * step, -40.0 + 0.1 * step * degrees_s) for step in range(60)], rate=rate)
    assert (follow.reason(6.0) == "") is follows


def test_time_in_order_makes_good_time_out_of_it() -> None:
    samples = [(0.1 * step, 0.0 if step % 20 < 10 else 20.0) for step in range(400)]
    assert seen(samples).reason(40.0) == ""
    samples = [(0.1 * step, 0.0 if step % 20 < 14 else 20.0) for step in range(400)]
    assert seen(samples).reason(40.0) != ""


def test_reports_more_than_a_second_apart_say_nothing() -> None:
    assert seen([(1.01 * step, 0.0) for step in range(20)]).reason(20.0) == ""
    assert seen([(1.0 * step, 0.0) for step in range(20)]).reason(20.0) != ""


def test_a_burst_of_one_time_counts_once_and_its_last_angle_alone() -> None:
    burst = [(0.5 * step, angle) for step in range(20) for angle in (0.0, 0.0, 20.0)]
    assert seen(burst).reason(10.0) == ""
    stuck = [(0.1 * step, 0.0) for step in range(15) for _ in range(10)]
    assert seen(stuck).reason(10.0) == "", "1.4 s however many reports"


def test_a_released_rudder_is_forgiven_two_seconds_after_the_last_order() -> None:
    follow = seen([(0.1 * step, 0.0) for step in range(30)])
    assert follow.reason(3.0) != ""
    assert follow.reason(60.0) != "", "it is still ordered"
    follow.ordered(60.0, 0.0)
    follow.released()
    assert follow.reason(62.0) != ""
    assert follow.reason(62.01) == ""
    for step in range(60):
        follow.measured(70.0 + 0.1 * step, 0.5, "IIRSA")
    assert follow.reason(80.0) == "", "nothing is ordered"


def test_an_angle_is_held_against_the_last_two_orders() -> None:
    for earlier, follows in ((20.0, True), (-20.0, False)):
        follow = RudderFollow(FollowSettings(math.radians(5.0)))
        for step in range(60):
            now = 0.1 * step
            follow.ordered(now, math.radians(earlier if step % 2 else -20.0))
            follow.measured(now, math.radians(20.0), "IIRSA")
        assert (follow.reason(6.0) == "") is follows


def test_limits_of_the_rudder_s_following_to_the_bit() -> None:
    """Five degrees off is right, 2.5 s are patience, two reports may be a second apart, orders stay away for 2 s."""
    exact = RudderFollow(FollowSettings(math.radians(5.0)))
    exact.ordered(0.0, 0.0)
    for step in range(60):
        exact.measured(0.125 * step, math.radians(5.0), "IIRSA")
    assert exact.reason(8.0) == ""
    stuck = [(0.125 * step, 0.0) for step in range(22)]
    assert seen(stuck[:21]).reason(3.0) == "" and seen(stuck).reason(3.0) != ""
    left = RudderFollow(FollowSettings(patience=2.0))
    left.ordered(0.0, 0.0)
    assert left.reason(2.0) == "" and left.reason(2.125).startswith("this computer stood still for 2.1 s")
