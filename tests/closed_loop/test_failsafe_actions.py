"""What each fail-safe of the vessel file does with the boat, to its end; and the links that cannot do it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import pytest
from alarm_texts import words_of
from lockstep import Lockstep
from plant import Plant

from autopilot.angles import wrap
from autopilot.errors import RefusedError
from autopilot.links.mavlink.requests import MODES
from autopilot.runtime.build import build_pilot, gear_of, model_of
from autopilot.runtime.build_links import build_links
from autopilot.signals import HeadingSample, Mode, Order, OrderKind, RateSample, Sample, Tick, WindSample
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import Vessel
from sitl.faults import Fault
from sitl.firmware import FirmwareMode

DT = 0.05
LOST = 30.0
HOLDS = 12.0
"""failsafe.release_after_s of these tests."""


def vessel(action: str, **changed: Any) -> Vessel:
    boat = load_vessel("lanxin")
    failsafe = dataclasses.replace(boat.failsafe, action=action, release_after_s=HOLDS, **changed)  # type: ignore[arg-type]
    return dataclasses.replace(boat, failsafe=failsafe)


def push(now: float) -> float:
    return math.radians(4.0)


def sail(
    action: str,
    lost: Callable[[Sample], Sample | None] = lambda _: None,
    wind_from: float | None = None,
    seconds: float = 20.0,
    heard: Callable[[Sample], Sample] = lambda sample: sample,
    **changed: Any,
) -> tuple[list[Tick], list[float]]:
    """Sail 045 with some wind until the heading is lost; return the ticks since, and the true headings [rad]."""
    boat = vessel(action, **changed)
    pilot = build_pilot(boat)
    noise = math.radians(0.2)
    plant = Plant(model_of(boat), gear_of(boat), disturbance=push, heading_noise=noise, rate_noise=noise)
    ticks, headings = [], []
    order = Order(OrderKind.HEADING, math.radians(45.0), serial=1)
    while plant.time < LOST + seconds:
        samples = [heard(sample) for sample in plant.sense()]
        if plant.time >= LOST:
            samples = [kept for sample in samples if (kept := lost(sample)) is not None]
        if wind_from is not None:
            samples.append(WindSample(plant.time, wrap(wind_from - plant.heading), 8.0, "IIMWV"))
        tick = pilot.step(plant.time, tuple(samples), order)
        if plant.time >= LOST:
            ticks.append(tick)
            headings.append(plant.heading)
        plant.step(tick.command.angle if tick.command.engaged else 0.0, DT)
    return ticks, headings


def failing(ticks: list[Tick]) -> list[Tick]:
    """The ticks in which the fail-safe moves the rudder, which last as long as the file says and are all of its end."""
    failed = [tick for tick in ticks if tick.mode is Mode.FAILSAFE]
    assert failed == [tick for tick in ticks if tick.now >= failed[0].now], "it ends by nothing but an order"
    engaged = [tick for tick in failed if tick.command.engaged]
    if engaged:
        assert engaged[-1].now - failed[0].now == pytest.approx(HOLDS, abs=2 * DT)
    return engaged


def test_release_lets_go_at_once() -> None:
    assert not failing(sail("release")[0])


def test_amidships_puts_the_rudder_there_and_lets_go() -> None:
    ticks = failing(sail("amidships")[0])
    assert all(tick.command.angle == 0.0 for tick in ticks[10:])


def test_hold_keeps_the_rudder_where_it_was() -> None:
    ticks = failing(sail("hold")[0])
    assert len({tick.command.angle for tick in ticks}) == 1
    assert ticks[0].command.angle == pytest.approx(-push(0.0), abs=math.radians(2.0))


def test_by_dead_reckoning_the_last_heading_is_held_without_a_compass() -> None:
    ticks, headings = sail("dead_reckoning")
    engaged = failing(ticks)
    off = [abs(math.degrees(wrap(heading - math.radians(45.0)))) for heading in headings[: len(engaged) + 20]]
    assert max(off) < 5.0
    amidships, drifting = sail("amidships")
    assert failing(amidships)
    assert abs(math.degrees(wrap(drifting[len(engaged)] - math.radians(45.0)))) > 20.0, "the wind is felt"


def frozen_with_rate(sample: Sample) -> Sample:
    assert isinstance(sample, HeadingSample)
    return sample._replace(heading=math.radians(48.0))


def gyro_alone(sample: Sample) -> Sample:
    assert isinstance(sample, HeadingSample)
    assert sample.rate is not None
    return RateSample(sample.time, sample.rate, "gyro")


@pytest.mark.parametrize("lost", [frozen_with_rate, gyro_alone])
def test_dead_reckoning_uses_the_gyro_and_not_a_bad_compass(
    lost: Callable[[Sample], Sample],
) -> None:
    ticks, headings = sail("dead_reckoning", lost, seconds=40.0)
    engaged = failing(ticks)
    assert engaged
    began = ticks.index(engaged[0])
    turned = wrap(headings[began + len(engaged) - 1] - headings[began])
    assert abs(math.degrees(turned)) < 8.0


def test_dead_reckoning_uses_the_model_if_the_gyro_is_reversed() -> None:
    def reversed_of_late(sample: Sample) -> Sample:
        assert isinstance(sample, HeadingSample)
        assert sample.rate is not None
        return sample._replace(rate=-sample.rate) if sample.time > LOST - 20.0 else sample

    ticks, headings = sail("dead_reckoning", gyro_alone, heard=reversed_of_late)
    engaged = failing(ticks)
    assert engaged
    off = [abs(math.degrees(wrap(heading - math.radians(45.0)))) for heading in headings[: len(engaged)]]
    assert max(off) < 10.0


@pytest.mark.parametrize("wind_from", [0.0, 80.0, 110.0, -20.0])
def test_windward_turns_slowly_into_the_wind_without_a_compass(wind_from: float) -> None:
    ticks, headings = sail("windward", wind_from=math.radians(wind_from), windward_rudder_deg=12.0)
    engaged = failing(ticks)
    at_the_end = headings[ticks.index(engaged[-1])]
    assert abs(math.degrees(wrap(math.radians(wind_from) - at_the_end))) < 25.0
    bias = max(abs(tick.state.bias) for tick in engaged)
    assert max(abs(tick.command.angle) for tick in engaged[20:]) <= math.radians(12.0) + bias + 1.0e-9


def test_windward_without_wind_is_amidships_and_that_is_said_beforehand() -> None:
    ticks, _ = sail("windward")
    assert any("the wind is not known" in alarm for alarm in words_of(ticks[0]))
    assert all(tick.command.angle == 0.0 for tick in failing(ticks)[20:])


def afloat(mode: str) -> Lockstep:
    boat = Lockstep(vessel("firmware", firmware_mode=mode), settings={"handover_mode": MODES[mode]})
    boat.engage(40.0)
    assert boat.run(20.0, until=boat.engaged)
    boat.run(3.0)
    boat.world.faults.add(Fault("heading_dropout", boat.now, math.inf, 1.0))
    assert boat.run(3.0, until=lambda tick: tick.mode is Mode.FAILSAFE)
    assert not boat.tick.command.engaged, "the rudder is the firmware's now"
    return boat


def test_the_flight_controller_is_ordered_to_hold_and_takes_over() -> None:
    boat = afloat("HOLD")
    assert boat.run(3.0, until=lambda tick: tick.mode is Mode.OVERRIDE)
    assert boat.firmware.mode is FirmwareMode.HOLD
    boat.run(5.0)
    assert any("HOLD" in alarm for alarm in words_of(boat.tick))
    assert not any("did not take over" in alarm for alarm in words_of(boat.tick))
    # the skipper takes it out of that mode again: nobody orders it back
    assert boat.firmware.set_mode(FirmwareMode.MANUAL)
    boat.run(5.0)
    assert boat.firmware.mode is FirmwareMode.MANUAL
    assert boat.tick.mode is Mode.OVERRIDE


def test_a_flight_controller_that_refuses_is_reported() -> None:
    boat = afloat("RTL")
    boat.run(5.0)
    assert boat.tick.mode is Mode.FAILSAFE
    assert any(alarm.startswith("the vehicle did not take over") for alarm in words_of(boat.tick))


def test_a_vessel_whose_links_cannot_do_its_fail_safe_is_refused() -> None:
    with pytest.raises(RefusedError, match=r"failsafe\.action firmware needs a flight controller"):
        build_links(vessel("firmware"), ["nmea:/dev/ttyUSB1:4800"])
    with pytest.raises(RefusedError, match=r"failsafe\.action windward needs a wind vane"):
        build_links(vessel("windward"), ["udpin:127.0.0.1:0"])
    reckoned = vessel("dead_reckoning")
    guided = dataclasses.replace(reckoned, helm=dataclasses.replace(reckoned.helm, method="guided"))
    with pytest.raises(RefusedError, match="a rudder that is ours"):
        build_links(guided, ["udpin:127.0.0.1:0"])
    handed = vessel("firmware")
    offboard = dataclasses.replace(handed, helm=dataclasses.replace(handed.helm, method="offboard"))
    with pytest.raises(RefusedError, match="PX4's mode is a human's to change"):
        build_links(offboard, ["udpin:127.0.0.1:0"])
