"""What engages again without an order, and only where the vessel file allows it; what ends a fail-safe that steers."""

from __future__ import annotations

import math

import pytest
from alarm_texts import other
from watches import said_by

from autopilot.signals import (
    AlarmEvent,
    AlarmSample,
    HelmCause,
    HelmSample,
    Mode,
    NavState,
    Order,
    OrderKind,
    Reference,
    RudderCommand,
    SupervisorState,
    Tick,
)
from autopilot.supervision.envelope import Envelope
from autopilot.supervision.panel import sentence_of, sentences_of
from autopilot.supervision.supervisor import (
    ORDER_WAITS,
    REENGAGE_WITHIN,
    RESUME_AFTER,
    FailsafeAction,
    Supervisor,
    waits_to_engage,
)

COURSE = Order(OrderKind.HEADING, 1.0, serial=1)
DT = 0.1


def state(age: float = 0.0) -> NavState:
    return NavState(0.0, 0.3, 0.0, 4.0, 0.1, 0.0, age, math.isfinite(age))


def made(action: str = "amidships", *, resume: bool = False, reengage: bool = False, after: float = 5.0) -> Supervisor:
    tested = Supervisor(Envelope(0.5, 0.35), FailsafeAction(1.0, action, after, resume, reengage))
    assert tested.decide(0.0, COURSE, state()) is Mode.ENGAGED
    return tested


REBOOTED, SILENT = HelmCause.REBOOTED, HelmCause.SILENT


def helm(reason: str = "", cause: HelmCause = HelmCause.TAKEN) -> HelmSample:
    return HelmSample(0.0, not reason, reason, "link", cause)


@pytest.mark.parametrize("words", ["any words at all", "the vehicle has rebooted", "no heartbeat from the vehicle"])
@pytest.mark.parametrize(
    ("cause", "name"),
    [
        (HelmCause.TAKEN, "human_override"),
        (HelmCause.REBOOTED, "firmware_rebooted"),
        (HelmCause.SILENT, "link_silent"),
        (HelmCause.RADIO_LOST, "radio_lost"),
        (HelmCause.STOOD_STILL, "stood_still"),
    ],
)
def test_the_cause_says_which_alarm_it_is_whatever_the_words(cause: HelmCause, name: str, words: str) -> None:
    tested = made()
    tested.on_sample(helm(words, cause))
    assert tested.decide(10.0, COURSE, state()) is Mode.OVERRIDE
    assert tested.memory.alarm is not None
    assert (tested.memory.alarm.name, tested.memory.alarm.detail) == (name, words)


@pytest.mark.parametrize(
    ("cause", "mode"),
    [
        (HelmCause.UNPROVEN, Mode.FAILSAFE),
        (HelmCause.UNREADY, Mode.FAILSAFE),
        (HelmCause.TAKEN, Mode.OVERRIDE),
    ],
)
def test_a_helm_that_has_only_to_be_proved_again_does_not_hide_why_the_steering_ended(
    cause: HelmCause, mode: Mode
) -> None:
    tested = made()
    assert tested.decide(10.0, COURSE, state(5.0)) is Mode.FAILSAFE
    tested.on_sample(helm("checking the steering input", cause))
    assert tested.decide(10.1, COURSE, state(5.0)) is mode


def test_a_helm_is_proved_for_an_order_that_waits_for_nothing_else() -> None:
    tested, order = made(), COURSE._replace(serial=COURSE.serial + 1)
    assert tested.decide(10.0, COURSE, state(5.0)) is Mode.FAILSAFE
    tested.on_sample(helm("to be proved", HelmCause.UNPROVEN))
    tested.decide(11.0, order, state(5.0))
    assert "cannot_engage" not in {alarm.name for alarm in said_by(tested)}
    tested.decide(12.0, order, state())
    assert "cannot_engage" in {alarm.name for alarm in said_by(tested)}


def rebooted(tested: Supervisor, at: float = 10.0) -> Supervisor:
    tested.on_sample(helm("the vehicle is disarmed; arm it", REBOOTED))
    assert tested.decide(at, COURSE, state()) is Mode.OVERRIDE
    assert tested.memory.alarm is not None and tested.memory.alarm.name == "firmware_rebooted"
    tested.on_sample(helm("the vehicle is disarmed; arm it"))
    return tested


def test_after_a_reboot_it_reengages_only_if_the_file_allows() -> None:
    tested = rebooted(made(reengage=True))
    assert tested.decide(12.0, COURSE, state()) is Mode.OVERRIDE
    assert tested.decide(15.0, COURSE, state()) is Mode.OVERRIDE
    assert sentences_of(said_by(tested)) == ("not engaged: the vehicle is disarmed; arm it",)
    assert tested.decide(15.0 + ORDER_WAITS, COURSE, state()) is Mode.OVERRIDE
    assert "not engaged" in sentences_of(said_by(tested))[0], "what comes back by itself is not dropped"
    tested.on_sample(helm())
    assert tested.decide(60.0, COURSE, state()) is Mode.ENGAGED
    assert said_by(tested) == ()


def test_elsewhere_a_reboot_ends_it_for_good() -> None:
    tested = rebooted(made(resume=True))
    tested.on_sample(helm())
    for now in (12.0, 15.0, 100.0):
        assert tested.decide(now, COURSE, state()) is Mode.OVERRIDE
        assert tested.memory.alarm is not None and tested.memory.alarm.name == "firmware_rebooted"


def test_two_minutes_after_a_reboot_people_have_seen_to_it() -> None:
    in_time, late = rebooted(made(reengage=True)), rebooted(made(reengage=True))
    for tested in (in_time, late):
        tested.on_sample(helm())
        assert tested.decide(10.1, COURSE, state(5.0)) is Mode.OVERRIDE
        tested.decide(20.0, COURSE, state(5.0))
    in_time.decide(10.0 + REENGAGE_WITHIN - RESUME_AFTER - 0.1, COURSE, state())
    assert in_time.decide(10.0 + REENGAGE_WITHIN - 0.1, COURSE, state()) is Mode.ENGAGED
    late.decide(10.0 + REENGAGE_WITHIN - RESUME_AFTER, COURSE, state())
    assert late.decide(10.0 + REENGAGE_WITHIN, COURSE, state()) is Mode.OVERRIDE


@pytest.mark.parametrize("first", ["heading", "silence"])
def test_the_silence_that_goes_with_a_reboot_is_part_of_it(first: str) -> None:
    tested = made(reengage=True)
    if first == "heading":
        assert tested.decide(9.0, COURSE, state(2.0)) is Mode.FAILSAFE
    else:
        tested.on_sample(helm("nothing heard for 4 s", SILENT))
        assert tested.decide(9.0, COURSE, state()) is Mode.OVERRIDE
        assert tested.memory.alarm is not None and tested.memory.alarm.name == "link_silent"
    tested.on_sample(helm("reading the vehicle's parameters", REBOOTED))
    tested.decide(10.0, COURSE, state())
    tested.on_sample(helm())
    tested.decide(11.0, COURSE, state())
    assert tested.decide(13.0, COURSE, state()) is Mode.ENGAGED


def test_a_reboot_after_a_human_s_override_gives_nothing_back() -> None:
    tested = made(reengage=True)
    tested.on_sample(helm("mode HOLD was chosen"))
    assert tested.decide(9.0, COURSE, state()) is Mode.OVERRIDE
    tested.on_sample(helm("arm it", REBOOTED))
    tested.decide(10.0, COURSE, state())
    tested.on_sample(helm())
    for now in (10.1, 13.0, 20.0):
        assert tested.decide(now, COURSE, state()) is Mode.OVERRIDE


def test_a_reboot_heard_of_while_standing_by_means_nothing_later() -> None:
    tested = made(reengage=True)
    tested.decide(1.0, Order(), state())
    tested.on_sample(helm("arm it", REBOOTED))
    tested.decide(2.0, Order(), state())
    tested.on_sample(helm())
    again = COURSE._replace(serial=2)
    assert tested.decide(3.0, again, state()) is Mode.ENGAGED
    assert tested.decide(4.0, again, state(2.0)) is Mode.FAILSAFE
    tested.decide(5.0, again, state())
    assert tested.decide(8.0, again, state()) is Mode.FAILSAFE


def test_an_engagement_forgets_the_reboot_before_it() -> None:
    tested = rebooted(made(reengage=True))
    tested.on_sample(helm())
    again = COURSE._replace(serial=2)
    assert tested.decide(11.0, again, state()) is Mode.ENGAGED
    assert tested.decide(20.0, again, state(2.0)) is Mode.FAILSAFE
    tested.decide(21.0, again, state())
    assert tested.decide(24.0, again, state()) is Mode.FAILSAFE


@pytest.mark.parametrize(("trouble", "mode"), [("rudder_stuck", Mode.FAILSAFE), ("heading_frozen", Mode.FAILSAFE)])
def test_a_rudder_trouble_ends_a_fail_safe_that_moves_the_rudder(trouble: str, mode: Mode) -> None:
    tested = made()
    assert tested.decide(1.0, COURSE, state(2.0)) is Mode.FAILSAFE
    assert tested.check(1.0, 0.2, 0.0, 0.0, DT).engaged
    assert tested.decide(2.0, COURSE, state(3.0), {trouble: AlarmEvent(trouble)}) is mode
    assert tested.check(2.0, 0.2, 0.0, 0.0, DT).engaged is (trouble != "rudder_stuck")


def test_a_state_that_is_not_a_number_turns_a_steering_fail_safe_into_a_fault() -> None:
    tested = made()
    tested.decide(1.0, COURSE, state(2.0))
    assert tested.decide(2.0, COURSE, state()._replace(rate=math.nan)) is Mode.FAULT
    released = made("release")
    released.decide(1.0, COURSE, state(2.0))
    assert released.decide(2.0, COURSE, state()._replace(heading=math.nan)) is Mode.FAILSAFE


def test_what_is_worst_counts() -> None:
    found = {name: AlarmEvent(name) for name in ("heading_frozen", "rudder_stuck", "not_finite")}
    for name, mode in (("not_finite", Mode.FAULT), ("rudder_stuck", Mode.FAILSAFE), ("heading_frozen", Mode.FAILSAFE)):
        tested = made()
        assert tested.decide(1.0, COURSE, state(), found) is mode
        assert tested.memory.alarm is not None and tested.memory.alarm.name == name
        del found[name]


@pytest.mark.parametrize("action", ["dead_reckoning", "windward"])
def test_a_steering_fail_safe_sends_the_law_s_command_until_its_time_is_up(action: str) -> None:
    tested = made(action)
    assert tested.decide(1.0, COURSE, state(2.0)) is Mode.FAILSAFE
    assert tested.law_steers
    assert tested.check(1.0, 0.1, 0.3, 0.12, DT) == RudderCommand(1.0, 0.12, True)
    assert tested.check(5.9, 0.12, 0.3, 0.13, DT) == RudderCommand(5.9, 0.13, True)
    assert not tested.check(6.0, 0.12, 0.3, 0.13, DT).engaged
    assert not tested.law_steers
    unfit = made(action)
    unfit.decide(1.0, COURSE, state(2.0))
    assert unfit.check(1.0, 0.1, 0.3, 0.4, DT) == RudderCommand(1.0, 0.1, True)
    assert unfit.mode is Mode.FAULT
    assert not unfit.law_steers


@pytest.mark.parametrize(("action", "after"), [("firmware", 5.0), ("release", 5.0), ("hold", 0.0), ("amidships", 0.0)])
def test_who_lets_go_lets_go_in_a_fault_too(action: str, after: float) -> None:
    for tested in (made(action, after=after), made(action, after=after)):
        assert not tested.law_steers or tested.mode is Mode.ENGAGED
    failed, faulty = made(action, after=after), made(action, after=after)
    failed.decide(1.0, COURSE, state(2.0))
    assert not failed.check(1.0, 0.2, 0.0, 0.0, DT).engaged
    assert faulty.check(1.0, 0.2, math.nan, 0.2, DT) == RudderCommand(1.0, 0.0, False)
    assert faulty.mode is Mode.FAULT


def test_a_held_rudder_stays_inside_its_limits_whatever_was_reported() -> None:
    for previous, held in ((0.7, 0.5), (-0.7, -0.5), (math.nan, 0.0), (0.3, 0.3)):
        tested = made("hold")
        tested.decide(1.0, COURSE, state(2.0))
        assert tested.check(1.0, previous, 0.0, 0.0, DT) == RudderCommand(1.0, held, True)


def test_amidships_is_reached_from_both_sides_at_the_rudder_s_rate() -> None:
    for side in (1.0, -1.0):
        tested = made("amidships")
        tested.decide(1.0, COURSE, state(2.0))
        assert tested.check(1.0, side * 0.2, 0.0, 0.0, DT).angle == pytest.approx(side * 0.165)
        assert tested.check(1.1, side * 0.02, 0.0, 0.0, DT).angle == 0.0


def test_the_wait_of_an_order_begins_anew_with_another_and_not_before_a_first_heading() -> None:
    tested = Supervisor(Envelope(0.5, 0.35), FailsafeAction(1.0, "hold", 5.0, False))
    assert tested.decide(0.0, COURSE, state(math.inf)) is Mode.STANDBY
    assert tested.decide(100.0, COURSE, state(math.inf)) is Mode.STANDBY
    assert "waiting for a heading" in sentences_of(said_by(tested))[0]
    tested.on_sample(helm("disarmed; arm it"))
    tested.decide(101.0, COURSE, state())
    tested.decide(130.9, COURSE, state())
    assert sentences_of(said_by(tested)) == ("not engaged: disarmed; arm it",)
    tested.decide(131.0, COURSE, state())
    assert "dropped" in sentences_of(said_by(tested))[0]
    again = COURSE._replace(serial=2)
    tested.decide(140.0, again, state())
    tested.decide(169.9, again, state())
    assert sentences_of(said_by(tested)) == ("not engaged: disarmed; arm it",)


def test_a_trouble_that_keeps_an_order_waiting_is_said_and_the_order_dropped_in_the_end() -> None:
    tested = Supervisor(Envelope(0.5, 0.35), FailsafeAction(1.0, "hold", 5.0, False))
    found = {"heading_frozen": AlarmEvent("heading_frozen")}
    stands = sentence_of(found["heading_frozen"])
    tested.decide(0.0, COURSE, state(), found)
    assert sentences_of(said_by(tested)) == (stands,)
    assert tested.memory.alarm is not None and tested.memory.alarm.name == "heading_frozen"
    tested.decide(30.0, COURSE, state(), found)
    assert sentences_of(said_by(tested)) == (f"the order to engage was dropped: {stands}; order again",)
    assert tested.decide(31.0, COURSE, state()) is Mode.STANDBY


def test_a_doubt_alone_keeps_nobody_from_engaging() -> None:
    rate, low = ({name: AlarmEvent(name)} for name in ("rate_disagrees", "battery_low"))
    tested = Supervisor(Envelope(0.5, 0.35), FailsafeAction(1.0, "hold", 5.0, False))
    assert tested.decide(0.0, COURSE, state(), {**rate, **low}) is Mode.ENGAGED
    tested.decide(0.1, COURSE, state(), low)
    assert tested.memory.state is SupervisorState.HEADING


@pytest.mark.parametrize(
    ("order", "expected"),
    [
        (COURSE, SupervisorState.HEADING),
        (COURSE._replace(is_led=True), SupervisorState.TRACK),
        (COURSE._replace(kind=OrderKind.RUDDER), SupervisorState.TRIAL),
        (COURSE._replace(kind=OrderKind.ZIGZAG, is_led=True), SupervisorState.TRIAL),
    ],
)
def test_the_state_is_what_was_ordered(order: Order, expected: SupervisorState) -> None:
    tested = Supervisor(Envelope(0.5, 0.35), FailsafeAction(1.0, "hold", 5.0, True))
    tested.decide(0.0, order, state())
    assert tested.memory.state is expected
    tested.decide(1.0, order, state(2.0))
    tested.decide(2.0, order, state())
    tested.decide(2.0 + RESUME_AFTER, order, state())
    assert tested.memory.state is expected, "resumed, too"


def test_reconfigured_it_goes_by_the_new_limits_at_once() -> None:
    tested = Supervisor(Envelope(0.2, 0.35), FailsafeAction(3.0, "release", 5.0, False), made().memory)
    assert tested.decide(1.0, COURSE, state(2.0)) is Mode.ENGAGED
    assert tested.decide(2.0, COURSE, state(3.1)) is Mode.FAILSAFE
    assert not tested.check(2.0, 0.1, 0.0, 0.0, DT).engaged
    wide = Supervisor(Envelope(0.2, 0.35), FailsafeAction(3.0, "hold", 5.0, False), made().memory)
    assert wide.check(1.0, 0.21, 0.21, 0.21, DT).angle == 0.2
    assert wide.mode is Mode.FAULT


def test_an_order_waits_for_the_helm_alone_while_it_says_so() -> None:
    def tick(mode: Mode, *alarms: AlarmEvent) -> Tick:
        return Tick(0, 0.0, (), COURSE, state(), Reference(0.0), 0.0, RudderCommand(0.0, 0.0, False), mode, alarms)

    waits = AlarmEvent("cannot_engage", "disarmed")
    assert waits_to_engage(tick(Mode.STANDBY, AlarmEvent("battery_low"), waits))
    assert waits_to_engage(tick(Mode.OVERRIDE, waits))
    assert not waits_to_engage(tick(Mode.ENGAGED, waits))
    assert not waits_to_engage(tick(Mode.STANDBY, AlarmEvent("waiting_heading")))


def test_the_numbers_are_those_of_the_documents() -> None:
    assert (RESUME_AFTER, REENGAGE_WITHIN, ORDER_WAITS) == (2.0, 120.0, 30.0)
    assert FailsafeAction(1.0, "hold", 5.0, False) == FailsafeAction(1.0, "hold", 5.0, False, False, 0.0)


def test_serial_0_is_no_order_that_anybody_gave() -> None:
    tested = Supervisor(Envelope(0.5, 0.35), FailsafeAction(1.0, "hold", 5.0, False))
    assert tested.decide(0.0, COURSE._replace(serial=0), state()) is Mode.STANDBY
    assert said_by(tested) == ()


def test_a_short_fail_safe_is_held_for_its_time() -> None:
    tested = made("hold", after=0.5)
    tested.decide(1.0, COURSE, state(2.0))
    assert tested.check(1.4, 0.1, 0.0, 0.0, DT) == RudderCommand(1.4, 0.1, True)
    assert not tested.check(1.5, 0.1, 0.0, 0.0, DT).engaged


def test_notes_are_known_by_who_says_them() -> None:
    tested = made()
    tested.note(AlarmSample(1.0, other("9 A"), "drive"))
    assert tested.memory.notes == {"note of drive": other("9 A")}
    tested.note(AlarmSample(2.0, None, "nobody"))
    tested.note(AlarmSample(2.0, None, "drive"))
    assert tested.memory.notes == {}


def test_a_tick_that_comes_long_after_the_time_was_up_counts_too() -> None:
    tested = made("hold")
    tested.decide(1.0, COURSE, state(2.0))
    assert not tested.check(30.0, 0.1, 0.0, 0.0, DT).engaged
    waiting = Supervisor(Envelope(0.5, 0.35), FailsafeAction(1.0, "hold", 5.0, False))
    waiting.on_sample(helm("disarmed; arm it"))
    waiting.decide(0.0, COURSE, state())
    waiting.decide(100.0, COURSE, state())
    assert "dropped" in sentences_of(said_by(waiting))[0]


def test_the_times_are_those_of_the_page() -> None:
    """Two minutes after a reboot people have seen to it; headings are back after 2 s, an order waits for 30 s."""
    for later, mode in ((119.9, Mode.ENGAGED), (120.0, Mode.OVERRIDE)):
        tested = rebooted(made(reengage=True))
        tested.on_sample(helm())
        assert tested.decide(10.1, COURSE, state(5.0)) is Mode.OVERRIDE
        tested.decide(20.0, COURSE, state())
        tested.decide(21.9, COURSE, state(5.0))
        tested.decide(100.0, COURSE, state())
        assert tested.decide(101.9, COURSE, state(5.0)) is Mode.OVERRIDE
        tested.decide(8.0 + later, COURSE, state())
        assert tested.decide(10.0 + later, COURSE, state()) is mode
    for seconds, mode in ((1.9, Mode.FAILSAFE), (2.0, Mode.ENGAGED)):
        tested = made(resume=True)
        assert tested.decide(1.0, COURSE, state(2.0)) is Mode.FAILSAFE
        tested.decide(5.0, COURSE, state())
        assert tested.decide(5.0 + seconds, COURSE, state()) is mode
    for seconds, said in ((29.9, "cannot_engage"), (30.0, "order_dropped")):
        tested = Supervisor(Envelope(0.5, 0.35), FailsafeAction(1.0, "amidships", 5.0, False))
        tested.on_sample(helm("arm it"))
        for now in (7.0, 7.0 + seconds):
            assert tested.decide(now, COURSE, state()) is Mode.STANDBY
        assert tested.memory.alarm is not None and tested.memory.alarm.name == said


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("nobodys", [HelmCause.UNPROVEN, HelmCause.UNREADY])
def test_of_two_links_the_one_whose_helm_was_taken_says_so(order: int, nobodys: HelmCause) -> None:
    away = [
        HelmSample(0.0, False, "to be proved", "a", nobodys),
        HelmSample(0.0, False, "a hand at the wheel", "b", HelmCause.TAKEN),
    ]
    tested = made()
    for sample in away[::order]:
        tested.on_sample(sample)
    assert tested.decide(1.0, COURSE, state()) is Mode.OVERRIDE
    assert tested.memory.alarm is not None and tested.memory.alarm.detail == "a hand at the wheel"


@pytest.mark.parametrize(
    ("other", "is_silent"),
    [
        (HelmSample(0.0, False, "to be proved", "other", HelmCause.UNPROVEN), False),
        (HelmSample(0.0, True, "", "other", SILENT), False),
        (HelmSample(0.0, False, "nothing heard", "other", SILENT), True),
    ],
)
def test_a_silence_is_over_two_seconds_after_the_last_link_was_heard(other: HelmSample, is_silent: bool) -> None:
    tested = made()
    tested.on_sample(helm("nothing heard for 4 s", SILENT))
    tested.decide(20.0, COURSE, state())
    assert tested.memory.alarm is not None and tested.memory.alarm.name == "link_silent"
    tested.on_sample(helm())
    tested.on_sample(other)
    for now, is_over in ((21.0, False), (22.9, False), (23.0, True)):
        tested.decide(now, COURSE, state())
        assert tested.memory.is_over is (is_over and not is_silent)


@pytest.mark.parametrize("cause", [HelmCause.TAKEN, HelmCause.RADIO_LOST, HelmCause.STOOD_STILL])
def test_who_took_the_helm_may_have_it_for_long(cause: HelmCause) -> None:
    tested = made()
    tested.on_sample(helm("away", cause))
    for now in (1.0, 2.0, 30.0):
        tested.decide(now, COURSE, state())
        assert not tested.memory.is_over
