"""Who steers better: our law over the rudder, or the firmware's controller over heading targets (`--steer guided`).

    python benchmarks/guided_steering.py

Lanxin behind the simulated ArduRover, in lockstep: a turn of 60 deg in calm water, then 120 s on that heading in the
scenario sea-state-5. The firmware steers once with ArduRover's default gains and once with gains worked out for this
boat: feed-forward so that the steady turn needs no feedback, FF = U/(MOT_SPD_SCA_BASE K rudder at full).
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.control.registry import TRIAL_LAW
from autopilot.links.mavlink.companion import CompanionLink
from autopilot.links.mavlink.vehicle import CompanionSettings
from autopilot.links.transports import loopback_pair
from autopilot.runtime.app import App, Plan
from autopilot.signals import Mode, Order, OrderKind
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import Vessel
from sitl.firmware import Firmware
from sitl.scenario import load_scenario
from sitl.wire_mavlink import MavlinkVehicle
from sitl.world import World

TURN = math.radians(60.0)
STEP = 0.01


class Sailed(NamedTuple):
    """time, heading error to the order, rudder [s, rad, rad] at each step."""

    rows: list[tuple[float, float, float]]


GUIDED, GUIDED_AT = 15, 1.5


class _Clock:
    time = 0.0

    def now(self) -> float:
        return self.time

    def wait(self, descriptors: object, until: float) -> None:
        """Never called in lockstep."""


def sail(vessel: Vessel, scenario_name: str, gains: dict[str, float], seconds: float) -> Sailed:
    """Sail `seconds` on an order of 60 deg from heading 0; times count from engaging, under way from MANUAL."""
    guided = vessel.helm.method == "guided"
    world = World(vessel, load_scenario(scenario_name))
    firmware = Firmware(world)
    for name, value in gains.items():
        firmware.parameters.set(name, value)
    vehicle = MavlinkVehicle(firmware)
    near, far = loopback_pair()
    full = math.radians(vessel.helm.rudder_at_full_pwm_deg or vessel.rudder.angle_max_deg)
    link = CompanionLink(near, CompanionSettings(full, method=vessel.helm.method, as_gcs=True))
    clock, order = _Clock(), Order(OrderKind.HEADING, TURN, serial=1)
    plan = Plan(vessel, lambda _, __: order, law=TRIAL_LAW if guided else None, links=(link,))
    session = App(plan, clock).session
    rows, engaged_at = [], math.inf
    for number in range(1, round(seconds / STEP) + 1):
        clock.time = now = round(number * STEP, 9)
        for data in far.receive():
            vehicle.receive(now, data)
        vehicle.advance(now)
        for data in vehicle.transmit(now):
            far.send(data)
        session.poll(now)
        if guided and now == GUIDED_AT:
            firmware.set_mode(GUIDED)
        if engaged_at == math.inf and session.tick is not None and session.tick.mode is Mode.ENGAGED:
            engaged_at = now
        rows.append((now - engaged_at, wrap(TURN - world.boat.state.heading), world.boat.state.rudder))
    return Sailed(rows)


def main() -> None:
    """Print the table."""
    rudder = load_vessel("lanxin")
    guided = dataclasses.replace(rudder, helm=dataclasses.replace(rudder.helm, method="guided"))
    model = rudder.model
    forward = model.reference_speed_m_s / (model.K_1_s * math.radians(rudder.rudder.angle_max_deg))
    fitted = {"ATC_STR_RAT_FF": forward, "ATC_STR_RAT_P": 1.0, "ATC_STR_RAT_I": 1.0, "ATC_STR_ANG_P": 1.0}
    print("| steered by | turn: within 2 deg after | overshoot | sea state 5: error, rms | rudder, rms |")
    print("|---|---|---|---|---|")
    for name, vessel, gains in (
        ("our law, rudder commands", rudder, {}),
        ("firmware, default gains", guided, {}),
        (f"firmware, fitted gains (FF {forward:.1f})", guided, fitted),
    ):
        turn = sail(vessel, "calm", gains, 120.0).rows
        late = [time for time, error, _ in turn if abs(error) > math.radians(2.0)]
        over = max(-error for _, error, _ in turn)
        sea = sail(vessel, "sea-state-5", gains, 180.0).rows[-round(120.0 / STEP) :]
        error = math.sqrt(sum(error * error for _, error, _ in sea) / len(sea))
        used = math.sqrt(sum(angle * angle for _, _, angle in sea) / len(sea))
        figures = (f"{late[-1]:.1f} s", *(f"{math.degrees(value):.1f} deg" for value in (over, error, used)))
        print(f"| {name} | {' | '.join(figures)} |")


if __name__ == "__main__":
    main()
