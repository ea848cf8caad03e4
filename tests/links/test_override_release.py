"""How reports show that an override is gone: what may still be shown, how many must differ, and the mark."""

from __future__ import annotations

import pytest

from autopilot.links.mavlink.overrides import OverrideRelease
from autopilot.links.rudder_order import Release, ReleaseState, UnshownRelease, release_sentence


def asked(*pulses: int) -> OverrideRelease:
    """A release at 10 s, after one order each tenth of a second, the last at 10 s."""
    release = OverrideRelease()
    for number, pulse in enumerate(pulses):
        release.ordered(10.0 - 0.1 * (len(pulses) - 1 - number), pulse)
    release.asked(10.0)
    return release


def test_two_reports_in_a_row_that_differ_show_it() -> None:
    release = asked(1600)
    for now, pulse, shown in ((10.1, 1500, ""), (10.2, 1600, ""), (10.3, 1500, ""), (10.4, 1700, "RC_CHANNELS")):
        release.report(now, pulse, "RC_CHANNELS")
        assert release.shown_by == shown
    release.report(10.5, 1600, "another")
    assert release.shown_by == "RC_CHANNELS"


@pytest.mark.parametrize("sign", [1, -1])
def test_a_report_within_three_microseconds_of_an_order_is_that_order(sign: int) -> None:
    for away, shown in ((3, False), (4, True)):
        release = asked(1600)
        for now in (10.1, 10.2, 10.3):
            release.report(now, 1600 + sign * away, "RC_CHANNELS")
        assert bool(release.shown_by) is shown


def test_a_report_may_show_any_order_of_the_last_second_but_none_before() -> None:
    release = OverrideRelease()
    for now, pulse in ((0.0, 1400), (8.9, 1450), (9.1, 1500), (10.0, 1600)):
        release.ordered(now, pulse)
    release.asked(10.0)
    for now, pulse in ((10.1, 1500), (10.2, 1500), (10.3, 1600), (10.4, 1450)):
        release.report(now, pulse, "x")
        assert not release.shown_by
    release.report(10.5, 1450, "x")
    assert release.shown_by == "x"


def test_a_repeated_order_counts_from_its_last_sending() -> None:
    release = OverrideRelease()
    for now, pulse in ((8.8, 1400), (8.9, 1500), (9.5, 1500), (9.6, 1600), (9.9, 1600)):
        release.ordered(now, pulse)
    release.asked(10.0)
    for now, pulse in ((10.1, 1500), (10.2, 1600), (10.3, 1500), (10.4, 1500)):
        release.report(now, pulse, "x")
        assert not release.shown_by
    for now in (10.5, 10.6):
        release.report(now, 1400, "x")
    assert release.shown_by == "x", "too old"


def test_reports_from_before_the_release_or_without_one_say_nothing() -> None:
    release = OverrideRelease()
    release.report(0.0, 1500, "x")
    assert (release.has_ordered, release.is_asked) == (False, False)
    release.ordered(1.0, 1600)
    for now in (1.1, 1.2, 1.3):
        release.report(now, 1500, "x")
    assert (release.shown_by, release.has_ordered, release.is_asked) == ("", True, False)
    release.asked(2.0)
    for _ in range(3):
        release.report(2.0, 1500, "x")
    assert release.shown_by == ""
    release.report(2.1, 1500, "x")
    release.asked(2.15)
    release.report(2.2, 1500, "x")
    assert release.shown_by == "x", "a release sent again begins nothing anew"
    release.ordered(3.0, 1600)
    assert (release.shown_by, release.is_asked) == ("", False)


def test_a_servo_is_compared_with_where_the_orders_put_it() -> None:
    release = asked(1600)
    for now in (10.1, 10.2, 10.3):
        release.report(now, 1400, "SERVO", {sent: 3000 - sent for sent in range(1000, 2001)})
    assert release.shown_by == ""
    assert release.wants_mark(20.0) is None, "a servo shows no input"
    for now in (10.4, 10.5):
        release.report(now, 1600, "SERVO", {sent: 3000 - sent for sent in range(1000, 2001)})
    assert release.shown_by == "SERVO"


def test_a_mark_is_wanted_after_0_4_s_where_the_reports_still_show_the_order() -> None:
    release = asked(1600)
    release.report(10.1, 1601, "x")
    assert release.wants_mark(10.39) is None
    assert release.wants_mark(10.41) == 1601
    release.mark(10.41, 1604)
    assert release.wants_mark(12.0) is None, "once"
    assert asked(1600).wants_mark(10.5) is None, "nothing was shown"
    moved = asked(1600)
    moved.report(10.1, 1600, "x")
    moved.report(10.2, 1500, "x")
    assert moved.wants_mark(10.5) is None


def test_the_release_marker_repeats_at_10_hz_until_seen_or_0_6_s() -> None:
    release = asked(1600)
    assert not release.mark_due(10.4) and not release.is_marking(10.4)
    release.mark(10.4, 1610)
    due = [step for step in range(100) if release.mark_due(10.4 + 0.01 * step + 1e-6)]
    assert due == pytest.approx([0, 10, 20, 30, 40, 50], abs=1)
    assert release.is_marking(10.99) and not release.is_marking(11.01)
    again = asked(1600)
    again.mark(10.4, 1610)
    again.mark_due(10.4)
    again.report(10.45, 1600, "x")
    assert again.is_marking(10.46)
    again.report(10.5, 1607, "x")
    assert not again.is_marking(10.51) and not again.mark_due(10.51)
    again.report(10.55, 1613, "x")
    assert again.shown_by == "", "still the mark"
    again.report(10.6, 1600, "x")
    assert again.shown_by == "x"


def test_a_mark_that_was_never_seen_shows_nothing() -> None:
    release = asked(1600)
    release.mark(10.4, 1610)
    for step in range(30):
        release.report(10.5 + 0.1 * step, 1600, "x")
    assert release.shown_by == ""


def test_an_override_lasts_its_time_and_half_a_second() -> None:
    release = OverrideRelease()
    assert not release.is_held(0.0, -1.0)
    release.ordered(10.0, 1600)
    assert release.is_held(13.5, 3.0) and not release.is_held(13.51, 3.0)
    assert release.is_held(10.5, 0.0) and not release.is_held(10.51, 0.0)
    assert release.is_held(1e6, -1.0), "for ever"
    release.asked(11.0)
    for now in (11.1, 11.2):
        release.report(now, 1500, "x")
    assert not release.is_held(11.3, -1.0)
    marked = asked(1600)
    marked.mark(12.0, 1610)
    assert marked.mark_due(12.0)
    assert marked.is_held(15.4, 3.0), "a mark is an override too"


@pytest.mark.parametrize(("period", "patience"), [(0.1, 1.5), (0.2, 2.0), (0.5, 3.5), (4.0, 3.5)])
def test_it_waits_for_five_reports_and_a_second(period: float, patience: float) -> None:
    release = OverrideRelease()
    assert release.patience == pytest.approx(1.5)
    for step in range(60):
        release.report(period * step, 1500, "x")
    assert release.patience == pytest.approx(patience, abs=0.01)
    quick = OverrideRelease()
    quick.report(0.0, 1500, "x")
    quick.report(0.2, 1500, "x")
    assert quick.patience == pytest.approx(1.0 + 5 * 0.12), "a fifth of the way to each new period"


def test_what_nothing_shows_has_left_after_0_3_s() -> None:
    release = UnshownRelease("nmea:x", "it ends by itself")
    assert release.result(0.0) == Release("nmea:x", ReleaseState.NOT_HELD)
    release.has_ordered = True
    release.asked(5.0, False)
    assert release.result(5.29) is None
    assert release.result(5.31) == Release("nmea:x", ReleaseState.UNSHOWN, lapse="it ends by itself")
    release.asked(6.0, True)
    assert release.result(6.0) == Release("nmea:x", ReleaseState.LOST, lapse="it ends by itself")


@pytest.mark.parametrize(
    ("release", "sentence"),
    [
        (Release("a", ReleaseState.NOT_HELD, lapse="x"), "rudder not held"),
        (Release("a", ReleaseState.CONFIRMED, "RC", lapse="x"), "rudder released, confirmed by RC"),
        (Release("a", ReleaseState.UNCONFIRMED, waited=1.53), "rudder released, not confirmed in 1.5 s"),
        (
            Release("a", ReleaseState.UNCONFIRMED, waited=2.0, lapse="wait"),
            "rudder released, not confirmed in 2.0 s: wait",
        ),
        (Release("a", ReleaseState.UNSHOWN, lapse="wait"), "rudder released: wait"),
        (Release("a", ReleaseState.UNSHOWN), "rudder released"),
        (Release("a", ReleaseState.LOST, lapse="wait"), "rudder not released, the line is gone: wait"),
    ],
)
def test_each_state_has_its_sentence(release: Release, sentence: str) -> None:
    assert release.sentence == sentence
    nothing = Release("b", ReleaseState.NOT_HELD)
    assert release_sentence([nothing, release]) == sentence
    assert release_sentence([]) == "rudder not held"
    held = Release("c", ReleaseState.UNSHOWN)
    both = release_sentence([held, nothing, release])
    assert both == ("rudder released" if "not held" in sentence else f"c: rudder released; a: {sentence}")
