"""A few of the many SIGKILLs of benchmarks/kills.py, at moments that a seed draws."""

from __future__ import annotations

from pathlib import Path

from two_processes import free_port
from wired_vehicle import OVERRIDE_TIME_S, KillingField


def test_a_killed_process_leaves_a_whole_log_a_free_rudder_and_the_next_one_steers(tmp_path: Path) -> None:
    field = KillingField(tmp_path, free_port(), seed=5)
    try:
        left = [killed for _ in range(3) if (killed := field.kill_one()) is not None]
    finally:
        field.close()
    # what must hold of each is asserted where it is looked into; one that stood still for long had let go before
    assert len(left) == 3 or any(each.starved for each in left)
    assert all(each.had_engaged or each.starved for each in left)
    engaged = [each for each in left if each.had_engaged]
    assert engaged and (len(engaged) < 3 or any(each.resumed for each in engaged))
    assert all(each.replays and each.ticks > 10 for each in engaged)
    assert all(0.0 < each.released_s <= OVERRIDE_TIME_S + 0.5 for each in engaged)
