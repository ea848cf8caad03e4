"""The packets of a .tlog from any program: what is no packet is skipped and counted, unknown messages are stepped over.

A .tlog is a row of (8-byte big-endian time in microseconds since 1970, MAVLink packet); Mission Planner, MAVProxy and
QGroundControl write it alike.
"""

from __future__ import annotations

from collections.abc import Iterator

from autopilot.links.mavlink_codec import MAGIC_V1, next_magic
from autopilot.links.signing import MAGIC_V2, SIGNED

STAMP = 8
YEARS_US = (315_532_800_000_000, 4_102_444_800_000_000)
"""Stamps from 1980 to 2100 are believed; a vehicle's own clock without a date counts too, from zero on."""
WITHOUT_DATE_US = 40_000_000_000_000


class TlogPackets:
    """Iterates over (stamp [s], message id, packet). Attribute `skipped`: bytes that belonged to no packet."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.skipped = 0
        self.torn = 0

    def __iter__(self) -> Iterator[tuple[float, int, bytes]]:
        data, place, end = self._data, 0, len(self._data)
        while place + STAMP + 2 <= end:
            length = packet_length(data, place + STAMP)
            follows = place + STAMP + length
            if length == 0 or (follows > end and not self._goes_on(place)):
                self.torn = end - place
                return
            if length < 0 or not self._is_start(follows):
                follows = self._next_start(place + 1)
                self.skipped += follows - place
            else:
                packet = data[place + STAMP : follows]
                yield int.from_bytes(data[place : place + STAMP], "big") * 1.0e-6, packet_id(packet), packet
            place = follows
        self.torn = end - place

    def _is_start(self, place: int) -> bool:
        """Return whether a record begins at `place`, or the file ends before that can be told."""
        data = self._data
        if place + STAMP >= len(data):
            return place <= len(data)
        stamp = int.from_bytes(data[place : place + STAMP], "big")
        likely = YEARS_US[0] < stamp < YEARS_US[1] or stamp < WITHOUT_DATE_US
        return likely and data[place + STAMP] in (MAGIC_V1, MAGIC_V2)

    def _goes_on(self, place: int) -> bool:
        """Return whether another record begins behind `place`: then a length that leaves the file was a lie."""
        return self._next_start(place + 1) < len(self._data)

    def _next_start(self, place: int) -> int:
        data, end = self._data, len(self._data)
        magic = place + STAMP
        while True:
            magic = next_magic(data, magic)
            if magic >= end:
                return end
            start = magic - STAMP
            length = packet_length(data, magic)
            if self._is_start(start) and length > 0 and magic + length < end and self._is_start(magic + length):
                return start
            magic += 1


def packet_length(data: bytes, start: int) -> int:
    """Return the length of the packet, known or not, that begins at `start`; 0: cut off in its header; -1: none."""
    magic, waiting = data[start], len(data) - start
    if magic == MAGIC_V2:
        if waiting < 10:
            return 0
        flags = data[start + 2]
        return -1 if flags & ~SIGNED else data[start + 1] + 12 + 13 * flags
    if magic == MAGIC_V1:
        return data[start + 1] + 8 if waiting >= 6 else 0
    return -1


def packet_id(packet: bytes) -> int:
    """Return the message id in a whole packet."""
    return packet[7] | packet[8] << 8 | packet[9] << 16 if packet[0] == MAGIC_V2 else packet[5]
