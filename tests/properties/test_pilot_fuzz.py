"""Whatever comes in, what leaves Pilot.step is finite, inside the limits, and legal."""

from __future__ import annotations

import math

from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.build import build_pilot
from autopilot.params.vessel_file import load_vessel
from autopilot.signals import (
    AlarmSample,
    HeadingSample,
    HelmSample,
    Mode,
    Order,
    OrderKind,
    RateSample,
    RollSample,
    RudderSample,
    SpeedSample,
)

VESSEL = load_vessel("lanxin")
ANGLE_MAX, RATE_MAX = math.radians(30.0), math.radians(20.0)

wild = st.floats(allow_nan=True, allow_infinity=True)
value = st.one_of(st.floats(-4.0, 4.0), wild)
moment = st.one_of(st.floats(0.0, 30.0), wild)
sample = st.one_of(
    st.builds(HeadingSample, moment, value, st.one_of(st.none(), value)),
    st.builds(RateSample, moment, value),
    st.builds(RudderSample, moment, value, st.booleans()),
    st.builds(SpeedSample, moment, value),
    st.builds(RollSample, moment, value),
    st.builds(HelmSample, moment, st.booleans(), st.just("x"), st.just("link")),
    st.builds(AlarmSample, moment, st.sampled_from(["", "a", "b"]), st.sampled_from(["x", "y"])),
)
order = st.builds(Order, st.sampled_from(OrderKind), value, value, value, st.integers(0, 4))
step = st.tuples(st.floats(-0.2, 0.7), st.lists(sample, max_size=4), order)


@settings(max_examples=150, deadline=None)
@given(st.lists(step, max_size=25), st.sampled_from(["backstepping", "pid", "trial"]))
def test_no_command_leaves_its_limits(steps: list[tuple[float, list[object], Order]], law: str) -> None:
    pilot = build_pilot(VESSEL, law)
    now, before = 0.0, None
    for dt, samples, wanted in steps:
        previous_now = now
        now += dt
        tick = pilot.step(now, (*samples, HeadingSample(now, 0.1, 0.0)), wanted)
        assert tick.mode in Mode
        assert tick.command.engaged or tick.command.angle == 0.0
        assert math.isfinite(tick.command.angle)
        assert abs(tick.command.angle) <= ANGLE_MAX + 1e-9
        assert math.isfinite(tick.state.heading)
        assert math.isfinite(tick.state.rate)
        assert tick.mode is not Mode.STANDBY or not tick.command.engaged
        if before is not None and before.command.engaged and tick.command.engaged:
            allowed = RATE_MAX * min(max(now - previous_now, 0.0), 0.5)
            assert abs(tick.command.angle - before.command.angle) <= allowed + 1e-9
        before = tick
