"""A boat that is not its file: it keeps its course with a word said, or it is given back. It never circles for good."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest
from boats import BOATS, vessel_of
from plant import Plant

from autopilot.angles import wrap
from autopilot.build import build_pilot
from autopilot.build_laws import gear_of, model_of
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear
from autopilot.params.vessel import Vessel
from autopilot.signals import Mode, Order, OrderKind, Sample, SpeedSample, Tick

VESSELS = {name: vessel_of(boat) for name, boat in BOATS.items()}
STABLE = ("lanxin", "middle", "slow")


@dataclass
class Sailing(Plant):
    """A plant with a log or a satellite receiver: `speeds` makes what they show [m/s], over ground or not, of time."""

    speeds: dict[bool, Callable[[float], float]] = field(default_factory=dict)

    def sense(self) -> list[Sample]:
        shown = [SpeedSample(self.time, speed(self.time), ground, str(ground)) for ground, speed in self.speeds.items()]
        return [*super().sense(), *shown]


@dataclass
class Outcome:
    """How a run went: how far the boat turned in all, and its swings over the last third [deg], and who steered."""

    ticks: list[Tick] = field(default_factory=list)
    headings: list[float] = field(default_factory=list)
    turned: float = 0.0
    begins: float = 0.0
    """When the turn was ordered [s]."""

    @property
    def swing(self) -> float:
        late = self.headings[-len(self.headings) // 4 :]
        return math.degrees(max(abs(heading) for heading in late))

    @property
    def gave_back(self) -> float:
        """When steering ended after the turn was ordered [s]; inf: never."""
        last = self.ticks[-1]
        return math.inf if last.mode is Mode.ENGAGED else last.now - self.begins

    def said(self, words: str) -> bool:
        return any(words in alarm for tick in self.ticks for alarm in tick.alarms)


def run(
    vessel: Vessel,
    *,
    boat: Norrbin | None = None,
    gear: SteeringGear | None = None,
    turn_deg: float = 90.0,
    gyro: bool = True,
    speeds: dict[bool, Callable[[float], float]] | None = None,
) -> Outcome:
    """Hold a course for a while, then turn; the plant is `boat` with `gear`, the pilot knows the `vessel` alone."""
    model = model_of(vessel)
    slow = model.time_constant
    plant = Sailing(
        boat or model,
        gear or gear_of(vessel),
        heading_noise=math.radians(0.3),
        rate_noise=math.radians(0.2) if gyro else None,
        speeds=speeds or {},
    )
    outcome = Outcome(begins=10.0 + 4.0 * slow)
    pilot, dt = build_pilot(vessel), 0.05 if slow < 3.0 else 0.1
    while plant.time < outcome.begins + 100.0 + 25.0 * slow:
        course = math.radians(turn_deg) if plant.time >= outcome.begins else 0.0
        tick = pilot.step(plant.time, tuple(plant.sense()), Order(OrderKind.HEADING, course, serial=1))
        outcome.ticks.append(tick)
        if outcome.gave_back < math.inf:
            break
        before = plant.heading
        plant.step(tick.command.angle, dt)
        outcome.turned += math.degrees(wrap(plant.heading - before))
        outcome.headings.append(wrap(plant.heading - course))
    return outcome


def constant(speed: float) -> Callable[[float], float]:
    return lambda _: speed


@pytest.mark.parametrize("name", STABLE)
@pytest.mark.parametrize("share", [0.0, 0.15, 0.3, 0.5, 0.7, 1.3, 1.7])
def test_speed_over_the_ground_in_a_stream_does_not_make_the_boat_swing(name: str, share: float) -> None:
    """The boat goes at its trial's speed through the water; over the ground it makes good this share of that."""
    vessel = VESSELS[name]
    outcome = run(vessel, speeds={True: constant(share * vessel.model.reference_speed_m_s)})
    assert outcome.gave_back == math.inf
    assert outcome.swing < 1.0
    assert outcome.turned == pytest.approx(90.0, abs=1.0)


@pytest.mark.parametrize("share", [0.15, 0.2, 0.25, 0.33, 0.5])
def test_a_log_that_reads_too_low_does_not_send_the_boat_round_in_circles(share: float) -> None:
    """The damping is cancelled no further than the rudder reaches: more of it is nothing that a trial has shown."""
    outcome = run(VESSELS["lanxin"], speeds={False: constant(share * 4.63)})
    assert outcome.turned < 140.0
    assert outcome.swing < 20.0
