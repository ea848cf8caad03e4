"""A rudder known by its orders alone: its rate as the boat's turning shows it, and none where it is merely late."""

from __future__ import annotations

import math

import numpy as np
import pytest
from boat_recordings import zigzag_boat

from autopilot.identification.ordered_rudder import rate_limited, slower_rudder, with_rudder_of
from autopilot.identification.runs import Run, Segment

FILED = math.radians(20.0)


def ordered(
    rate_deg_s: float, late: float = 0.0, lag: float = 0.0, noise_deg: float = 0.0, gyro: bool = True, seed: int = 1
) -> Run:
    """Return a zigzag as a log has it: orders through a gear of the filed rate, ten a second."""
    boat = zigzag_boat(seconds=120.0, rudder_rate=math.radians(rate_deg_s))
    random, dt = np.random.default_rng(seed), 0.02
    heading, rate = boat.heading, boat.rate
    if late > 0.0 or lag > 0.0:
        seen = boat.time - late
        heading, rate = np.interp(seen, boat.time, heading), np.interp(seen, boat.time, rate)
        share, lagging = -math.expm1(-dt / lag) if lag > 0.0 else 1.0, np.empty_like(rate)
        slow = 0.0
        for index, value in enumerate(rate):
            slow += share * (value - slow)
            lagging[index] = slow
        heading, rate = heading[0] + np.cumsum(lagging) * dt, lagging
    rudder = rate_limited(boat.time, boat.order, FILED)
    heading = heading + math.radians(noise_deg) * random.standard_normal(heading.size)
    rate = rate + math.radians(noise_deg) * random.standard_normal(rate.size)
    if not gyro:
        rate = np.full_like(rate, math.nan)
    rows = slice(None, None, 5)
    columns = (boat.time, heading, rate, rudder, boat.speed)
    return Run("zigzag", (Segment(*(each[rows] for each in columns)),), rudder="ordered")


@pytest.mark.parametrize(
    ("rate_deg_s", "noise_deg", "gyro"),
    [(2.3, 0.0, True), (10.0, 0.0, True), (2.3, 0.2, True), (10.0, 0.2, True), (2.3, 0.2, False), (5.0, 0.2, False)],
)
def test_a_rudder_slower_than_filed_is_found_by_how_the_boat_turns(
    rate_deg_s: float, noise_deg: float, gyro: bool
) -> None:
    found = slower_rudder([ordered(rate_deg_s, noise_deg=noise_deg, gyro=gyro)], FILED)
    assert found is not None
    off = abs(math.degrees(found.rate) - rate_deg_s)
    assert off < max(0.05 * rate_deg_s, 3.0 * math.degrees(found.standard_error))
    assert off < 0.2 * rate_deg_s


@pytest.mark.parametrize(("late", "lag"), [(0.0, 0.0), (0.3, 0.0), (0.0, 0.4), (0.2, 0.3)])
@pytest.mark.parametrize("noise_deg", [0.05])
def test_a_rudder_that_is_merely_late_is_not_called_slow(late: float, lag: float, noise_deg: float) -> None:
    assert slower_rudder([ordered(20.0, late, lag, noise_deg)], FILED) is None


def test_the_rudder_of_a_run_goes_no_faster_than_found_and_comes_where_it_was_ordered() -> None:
    run = ordered(5.0)
    found = slower_rudder([run], FILED)
    assert found is not None
    segment = with_rudder_of(run, found).segments[0]
    slew = np.diff(segment.rudder) / np.diff(segment.time)
    assert np.max(np.abs(slew)) <= found.rate * (1.0 + 1.0e-9)
    assert np.max(segment.rudder) == pytest.approx(np.max(run.segments[0].rudder))


def test_orders_that_never_move_show_no_rate() -> None:
    run = ordered(5.0)
    still = run.segments[0]._replace(rudder=np.zeros_like(run.segments[0].rudder))
    assert slower_rudder([run._replace(segments=(still,))], FILED) is None
