"""The vehicle of `parameter_vehicle` on a real UDP socket, in a thread."""

from __future__ import annotations

import contextlib
import socket
import threading

from parameter_vehicle import ParameterVehicle
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.codec import MavlinkCodec


class ServedVehicle(threading.Thread):
    """Answers on UDP until stopped; `autopilot` is its MAV_AUTOPILOT."""

    def __init__(self, port: int, autopilot: int = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA) -> None:
        super().__init__(daemon=True)
        self.vehicle = ParameterVehicle({"FRAME_CLASS": (1, 2), "RC_OVERRIDE_TIME": (3.0, 9), "X": (7, 6)})
        self.address = ("127.0.0.1", port)
        self.autopilot = autopilot
        self.base_mode = 81
        self.stop = threading.Event()

    def run(self) -> None:
        codec = MavlinkCodec(1, 1)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
            line.settimeout(0.002)
            while not self.stop.is_set():
                heartbeat = dialect.MAVLink_heartbeat_message(
                    dialect.MAV_TYPE_SURFACE_BOAT, self.autopilot, self.base_mode, 0, 4, 3
                )
                with contextlib.suppress(ConnectionRefusedError):
                    line.sendto(codec.encode(heartbeat), self.address)
                    with contextlib.suppress(TimeoutError):
                        for message in codec.decode(line.recv(2000)):
                            self.vehicle.handle(message)
                    for packet in self.vehicle.transmit(40):
                        line.sendto(packet, self.address)
