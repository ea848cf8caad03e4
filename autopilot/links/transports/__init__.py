"""Transports: UDP, TCP, serial, and the two that need no hardware (loopback and replay). None of them blocks."""

from __future__ import annotations

from autopilot.links.transports.memory import LoopbackTransport, ReplayTransport, loopback_pair
from autopilot.links.transports.serial_line import SerialTransport
from autopilot.links.transports.sockets import TcpClientTransport, TcpServerTransport, UdpInTransport, UdpOutTransport

__all__ = [
    "LoopbackTransport",
    "ReplayTransport",
    "SerialTransport",
    "TcpClientTransport",
    "TcpServerTransport",
    "UdpInTransport",
    "UdpOutTransport",
    "loopback_pair",
]
