"""A companion's end of the line for tests: encodes with the dialect, decodes with it, on a manual clock."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.vessel.file import load_vessel
from sitl.px4 import firmware_of
from sitl.scenario import Scenario, load_scenario
from sitl.wire_mavlink import MavlinkVehicle
from sitl.world import World


class Bench:
    """A simulated vehicle in lockstep with a test: `send` at the present time, `run` moves time on."""

    def __init__(self, scenario: Scenario, system: int = 255, component: int = 191) -> None:
        self.world = World(load_vessel("lanxin"), scenario)
        self.firmware = firmware_of(self.world)
        self.vehicle = MavlinkVehicle(self.firmware)
        self.now = 0.0
        self.codec = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        self.messages: list[Any] = []
        self.packets: list[bytes] = []

    def send(self, message: Any, system: int | None = None) -> None:
        if system is not None:
            self.codec.srcSystem = system
        self.vehicle.receive(self.now, bytes(message.pack(self.codec)))

    def run(self, seconds: float, step: float = 0.05) -> None:
        for _ in range(round(seconds / step)):
            self.now = round(self.now + step, 9)
            self.vehicle.advance(self.now)
            for packet in self.vehicle.transmit(self.now):
                self.packets.append(packet)
                self.messages.extend(self.codec.parse_buffer(bytearray(packet)) or [])

    def of(self, kind: str) -> list[Any]:
        return [message for message in self.messages if message.get_type() == kind]

    def last(self, kind: str) -> Any:
        return self.of(kind)[-1]

    def forget(self) -> None:
        self.messages.clear()

    def command(self, command: int, *parameters: float) -> Any:
        padded = [*parameters, *[0.0] * (7 - len(parameters))]
        self.send(dialect.MAVLink_command_long_message(1, 1, command, 0, *padded))
        self.run(0.05)
        return self.last("COMMAND_ACK")

    def override(self, steering: int, others: int = 65535, system: int | None = None) -> None:
        channels = [steering, *[others] * 7]
        self.send(dialect.MAVLink_rc_channels_override_message(1, 1, *channels), system)

    def parameter_set(self, name: str, value: float, kind: int = 9) -> None:
        self.send(dialect.MAVLink_param_set_message(1, 1, name.encode(), value, kind))

    @property
    def steering_pulse(self) -> int:
        return self.firmware.servos[0]


@pytest.fixture
def bench() -> Callable[..., Bench]:
    """Builds a bench on the calm scenario with sections replaced: bench(vehicle={'receiver': False})."""

    def build(system: int = 255, **sections: dict[str, Any]) -> Bench:
        scenario = load_scenario("calm")
        changed = {
            name: dataclasses.replace(getattr(scenario, name), **values) if isinstance(values, dict) else values
            for name, values in sections.items()
        }
        return Bench(dataclasses.replace(scenario, **changed), system)

    return build
