"""The vehicle's clock mapped to ours: delay only ever makes a sample older."""

from __future__ import annotations

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.links.mavlink.vehicle_clock import WRAP_S, WRAPPED_S, Belongs, VehicleClock

WINDOW_S = 10.0


def test_the_quickest_message_sets_the_offset() -> None:
    clock = VehicleClock()
    rng = random.Random(1)
    worst = 0.0
    for step in range(400):
        boot = 50.0 + step * 0.05
        delay = 0.005 + rng.expovariate(1.0 / 0.03)
        local = clock.local(1000.0 + boot + delay, boot)
        if step > 40:
            worst = max(worst, abs(local - (1000.0 + boot + 0.005)))
    assert worst < 0.004, "a jitter of 30 ms leaves less than 4 ms"


@given(st.lists(st.tuples(st.floats(0.001, 1.0), st.floats(0.0, 2.0)), min_size=1, max_size=50))
def test_no_sample_comes_from_the_future(steps) -> None:
    clock = VehicleClock()
    boot, now = 10.0, 0.0
    for step, delay in steps:
        boot += step
        now = max(now, boot + delay)
        assert clock.local(now, boot) <= now + 1e-9


def test_a_vehicle_that_was_paused_is_followed_again() -> None:
    clock = VehicleClock()
    for step in range(100):
        clock.local(step * 0.1, step * 0.1)
    age = 0.0
    for step in range(300):
        now = 15.0 + step * 0.1
        age = now - clock.local(now, 10.0 + step * 0.1)
    assert age == pytest.approx(0.0, abs=1e-9)


def test_drift_is_followed() -> None:
    clock = VehicleClock()
    for step in range(20000):
        boot = step * 0.1
        now = boot * (1.0 + 100e-6)
        local = clock.local(now, boot)
    assert now - local <= 100e-6 * 2.0 * WINDOW_S + 1e-6


def test_a_reboot_is_distinguished_from_disorder_and_from_the_wrap() -> None:
    clock = VehicleClock()
    assert clock.judge(0.0, 5.0) is Belongs.OURS
    clock.local(0.0, 100.0)
    assert clock.judge(0.1, 99.5) is Belongs.OURS
    assert clock.judge(0.1, 98.0) is Belongs.STRANGE, "a vehicle that started anew is not 98 s old"
    assert clock.judge(0.1, 0.0) is clock.judge(0.1, 1.0) is Belongs.REBOOTED
    late = VehicleClock()
    late.local(0.0, WRAP_S - 1.0)
    assert late.judge(2.0, 1.0) is Belongs.OURS, "time_boot_ms begins again after 49.7 days"
    late.local(2.0, 1.0)
    assert late.judge(2.1, 1.1) is Belongs.OURS


@pytest.mark.parametrize(("up", "belongs"), [(5.5, Belongs.STRANGE), (6.0, Belongs.REBOOTED)])
def test_a_message_from_the_first_second_comes_late_or_is_of_a_new_start(up: float, belongs: Belongs) -> None:
    """A line holds none for longer than five seconds."""
    clock = VehicleClock()
    clock.local(100.0, up)
    assert clock.judge(100.1, 0.9) is belongs


def test_a_vehicle_that_started_after_it_was_last_heard_has_rebooted_however_late_its_clock() -> None:
    clock = VehicleClock()
    clock.local(20.0, 10.0)
    assert clock.judge(60.0, 25.0) is Belongs.REBOOTED, "up for 10 s when last heard 40 s ago, and now for 25 s only"
    assert clock.judge(60.0, 50.0) is Belongs.OURS, "the line was silent, the vehicle was not"
    assert clock.judge(60.0, 45.0) is Belongs.OURS, "a message that was held up on its way"


def test_the_wrap_does_not_shift_samples_into_the_future() -> None:
    clock = VehicleClock()
    clock.local(0.0, WRAP_S - 1.0)
    assert clock.local(2.0, 1.0) == pytest.approx(2.0, abs=1e-6)
    assert clock.local(2.5, 1.5) == pytest.approx(2.5, abs=1e-6)


@pytest.mark.parametrize("late", [0.3, 0.9])
def test_messages_overtaken_as_the_counter_begins_again_are_no_reboot(late: float) -> None:
    clock, made = VehicleClock(), [(step * 0.05, (step * 0.05 - 1.0) % WRAP_S) for step in range(80)]
    arrived = sorted((time + (late if number % 3 == 1 else 0.01), boot) for number, (time, boot) in enumerate(made))
    for now, boot in arrived:
        found = clock.judge(now, boot)
        assert found is not Belongs.REBOOTED
        if found is Belongs.OURS:
            assert clock.local(now, boot) == pytest.approx((boot + 1.0) % WRAP_S, abs=0.02)


def test_reset_forgets() -> None:
    clock = VehicleClock()
    clock.local(0.0, 100.0)
    clock.reset()
    assert clock.offset is None
    assert clock.local(7.0, 0.5) == pytest.approx(7.0)


def test_the_offset_is_the_least_of_the_last_ten_to_twenty_seconds() -> None:
    """Delays come at 0, 9.9 and 10 s; what came quickest counts until the window after its own ends."""
    clock = VehicleClock()
    assert clock.offset is None
    delays = {0.0: 0.3, 5.0: 0.1, 9.9: 0.2, 10.0: 0.4, 19.9: 0.25, 20.0: 0.5, 29.9: 0.6, 30.0: 0.7}
    least = {0.0: 0.3, 5.0: 0.1, 9.9: 0.1, 10.0: 0.1, 19.9: 0.1, 20.0: 0.25, 29.9: 0.25, 30.0: 0.5}
    for now, delay in delays.items():
        boot = now - delay
        assert clock.local(now, boot) == pytest.approx(boot + least[now])
        assert clock.offset == pytest.approx(least[now])
        assert clock.offset is not None
    # after more than a window of silence nothing old counts
    assert clock.local(50.1, 49.0) == pytest.approx(50.1)
    assert clock.offset == pytest.approx(1.1)


@pytest.mark.parametrize(("silence", "least"), [(19.875, 0.125), (20.0, 1.0)])
def test_a_silence_of_two_windows_to_the_bit_leaves_nothing_old(silence: float, least: float) -> None:
    clock = VehicleClock()
    clock.local(0.0, -0.125)
    clock.local(silence, silence - 1.0)
    assert clock.offset == least


@pytest.mark.parametrize(("behind", "is_ours"), [(0.0, True), (1.0, True), (1.01, False), (2.0e6, False)])
def test_a_boot_time_more_than_a_second_behind_is_of_no_use(behind: float, is_ours: bool) -> None:
    clock = VehicleClock()
    clock.local(2.0e6 + 10.0, 2.0e6 + 10.0)
    assert (clock.judge(2.0e6 + 10.1, 2.0e6 + 10.0 - behind) is Belongs.OURS) is is_ours


@pytest.mark.parametrize(("apart", "count"), [(0.1, 5), (0.5, 5), (0.51, None), (3.0, None)])
@pytest.mark.parametrize("off", [-2.0, -300.0, 11.0, 3600.0])
def test_single_messages_of_another_clock_change_nothing_and_many_are_the_vehicle_s(
    off: float, apart: float, count: int | None
) -> None:
    """Doubles by a slower way, a wild time; or the vehicle's clock has been set."""
    clock = VehicleClock()
    clock.local(500.0, 500.0)
    found = None
    for number in range(1, 21):
        now = 500.0 + number * apart
        assert clock.judge(now, now) is Belongs.OURS and clock.local(now, now) == now, "ours come between"
        if clock.judge(now, now + off) is Belongs.REBOOTED:
            found = number
            break
    assert found == count


def disordered(rng: random.Random, begun: float, until: float, started: float) -> list[tuple[float, float]]:
    """Return when 50 messages a second arrive, with their boot time [s]: a tenth up to 2.5 s late, a fifth twice."""
    made = [begun + 0.02 * step for step in range(round((until - begun) / 0.02))]
    ways = [(time, rng.uniform(0.2, 2.5) if rng.random() < 0.1 else 0.01) for time in made]
    ways += [(time, rng.random()) for time in made if rng.random() < 0.2]
    return sorted((time + late, time - started) for time, late in ways)


@pytest.mark.parametrize("seed", range(6))
def test_a_line_that_holds_many_messages_for_seconds_is_no_reboot_and_hides_none(seed: int) -> None:
    rng, clock = random.Random(seed), VehicleClock()
    for now, boot in disordered(rng, 0.0, 300.0, -10.0):
        found = clock.judge(now, boot)
        assert found is not Belongs.REBOOTED, now
        if found is Belongs.OURS:
            clock.local(now, boot)
    anew = disordered(rng, 304.0, 320.0, 304.0)
    assert next(now for now, boot in anew if clock.judge(now, boot) is Belongs.REBOOTED) == anew[0][0]


@pytest.mark.parametrize("seed", range(3))
def test_a_vehicle_that_started_anew_while_nobody_listened_is_found_on_such_a_line(seed: int) -> None:
    rng, clock = random.Random(seed), VehicleClock()
    clock.local(300.0, 300.0)
    clock.silence()
    anew = disordered(rng, 304.0, 330.0, 304.0)
    assert next(now for now, boot in anew if boot > 6.0 and clock.judge(now, boot) is Belongs.REBOOTED) < 312.0


@pytest.mark.parametrize(("rate_hz", "burst_s"), [(10.0, 0.5), (30.0, 0.5), (30.0, 1.0)])
def test_a_vehicle_that_started_anew_unheard_is_found_behind_bursts(rate_hz: float, burst_s: float) -> None:
    clock = VehicleClock()
    clock.local(300.0, 300.0)
    clock.silence()
    made = [304.0 + step / rate_hz for step in range(round(10.0 * rate_hz))]
    arrived = [(burst_s * math.floor(time / burst_s + 1.0), time - 297.5) for time in made]
    assert (
        next((now for now, boot in arrived if clock.judge(now, boot) is Belongs.REBOOTED), math.inf)
        <= 307.0 + 2.0 * burst_s
    )


@pytest.mark.parametrize(("behind", "is_wrap"), [(3.0e6, False), (WRAPPED_S - 1.0, False), (WRAPPED_S + 1.0, True)])
def test_a_counter_begins_again_from_its_end_alone(behind: float, is_wrap: bool) -> None:
    clock = VehicleClock()
    clock.local(behind, behind)
    assert clock.judge(behind + 0.1, 0.0) is (Belongs.OURS if is_wrap else Belongs.REBOOTED)
    assert clock.local(behind + 2.0, 0.0) == (behind + 2.0 if is_wrap else 0.0)
