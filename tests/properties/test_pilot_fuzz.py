"""Whatever comes in, what leaves Pilot.step is finite, inside the limits, and legal."""

from __future__ import annotations

import dataclasses
import math

from alarm_texts import other
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.runtime.build import build_pilot
from autopilot.signals import (
    AcknowledgeSample,
    AlarmSample,
    ConditionSample,
    HeadingSample,
    HelmSample,
    Mode,
    Order,
    OrderKind,
    RateSample,
    RollSample,
    RudderSample,
    SpeedSample,
    SupervisorState,
    WindSample,
)
from autopilot.vessel.file import load_vessel

VESSEL, ROLLING = load_vessel("lanxin"), build_pilot(load_vessel("naval_vessel"))
ANGLE_MAX, RATE_MAX = math.radians(30.0), math.radians(20.0)

wild = st.floats(allow_nan=True, allow_infinity=True)
value = st.one_of(st.floats(-4.0, 4.0), wild)
moment = st.one_of(st.floats(0.0, 30.0), wild)
sample = st.one_of(
    st.builds(HeadingSample, moment, value, st.one_of(st.none(), value)),
    st.builds(RateSample, moment, value),
    st.builds(RudderSample, moment, value, st.booleans()),
    st.builds(SpeedSample, moment, value),
    st.builds(RollSample, moment, value, st.one_of(st.none(), value)),
    st.builds(HelmSample, moment, st.booleans(), st.just("x"), st.just("link")),
    st.builds(ConditionSample, moment, st.sampled_from(["battery_low", "link_flooded", "none"]), st.booleans()),
    st.builds(AcknowledgeSample, moment, st.sampled_from(["", "off_course"])),
    st.builds(WindSample, moment, value, value),
    st.builds(AlarmSample, moment, st.sampled_from([None, other("a"), other("b")]), st.sampled_from(["x", "y"])),
)
order = st.builds(Order, st.sampled_from(OrderKind), value, value, value, st.integers(0, 4))
step = st.tuples(st.floats(-0.2, 0.7), st.lists(sample, max_size=4), order)


@settings(max_examples=150, deadline=None)
@given(st.lists(step, max_size=25), st.sampled_from(["backstepping", "pid", "trial", "sliding_roll"]))
def test_no_command_leaves_its_limits(steps: list[tuple[float, list[object], Order]], law: str) -> None:
    pilot = ROLLING if law == "sliding_roll" else build_pilot(VESSEL, law)
    pilot.reset()
    most = pilot.config.limits.angle_max
    now, before = 0.0, None
    for dt, samples, wanted in steps:
        previous_now = now
        now += dt
        tick = pilot.step(now, (*samples, HeadingSample(now, 0.1, 0.0)), wanted)
        assert tick.mode in Mode
        assert tick.command.engaged or tick.command.angle == 0.0
        assert math.isfinite(tick.command.angle)
        assert abs(tick.command.angle) <= most + 1e-9
        assert math.isfinite(tick.state.heading)
        assert math.isfinite(tick.state.rate)
        assert tick.mode is not Mode.STANDBY or not tick.command.engaged
        if before is not None and before.command.engaged and tick.command.engaged:
            allowed = RATE_MAX * min(max(now - previous_now, 0.0), 0.5)
            assert abs(tick.command.angle - before.command.angle) <= allowed + 1e-9
        before = tick


ACTIONS = ["release", "amidships", "hold", "dead_reckoning", "windward", "firmware"]


@settings(max_examples=40, deadline=None)
@given(st.lists(step, min_size=8, max_size=30), st.sampled_from(ACTIONS), st.integers(2, 6))
def test_no_command_leaves_its_limits_in_any_fail_safe(
    steps: list[tuple[float, list[object], Order]], action: str, lost: int
) -> None:
    """The heading is there for some ticks of one order, and then only what else comes in."""
    failsafe = dataclasses.replace(VESSEL.failsafe, action=action)  # type: ignore[arg-type]
    pilot = build_pilot(dataclasses.replace(VESSEL, failsafe=failsafe))
    now, before = 0.0, None
    for number, (dt, samples, _) in enumerate(steps):
        previous_now = now
        now += abs(dt)
        seen = (HeadingSample(now, 0.01 * number, 0.1),) if number < lost else ()
        without_helm = tuple(sample for sample in samples if not isinstance(sample, HelmSample))
        tick = pilot.step(now, (*without_helm, *seen), Order(OrderKind.HEADING, 0.5, serial=1))
        assert tick.supervisor in SupervisorState
        assert math.isfinite(tick.command.angle)
        assert abs(tick.command.angle) <= ANGLE_MAX + 1e-9
        assert tick.command.engaged or tick.command.angle == 0.0
        if before is not None and before.command.engaged and tick.command.engaged:
            assert abs(tick.command.angle - before.command.angle) <= RATE_MAX * min(now - previous_now, 0.5) + 1e-9
        before = tick
