"""A serial line's pace: ten bits a byte, one byte after the other, and what has to wait waits."""

from __future__ import annotations

from collections import deque

BITS_PER_BYTE = 10
"""Start bit, eight data bits, stop bit."""


class UartLine:
    """One direction of a line. Bytes put in come out when their last bit has passed."""

    def __init__(self, baud: int) -> None:
        if baud <= 0:
            raise ValueError(f"baud rate must be above 0, got {baud}")
        self.byte_time = BITS_PER_BYTE / baud
        self._waiting: deque[tuple[float, bytes]] = deque()
        self._free_at = 0.0

    def put(self, time: float, data: bytes) -> None:
        """Begin to send `data` at `time` [s], or as soon as what is before it has gone."""
        if not data:
            return
        start = max(time, self._free_at)
        self._waiting.append((start, data))
        self._free_at = start + len(data) * self.byte_time

    def backlog(self, time: float) -> float:
        """Return the seconds of sending that still wait at `time` [s]."""
        return max(self._free_at - time, 0.0)

    def take(self, time: float) -> bytes:
        """Return the bytes that have passed whole by `time` [s] and have not been taken yet."""
        passed = bytearray()
        while self._waiting:
            start, data = self._waiting[0]
            count = min(int((time - start) / self.byte_time + 1.0e-6), len(data))
            if count <= 0:
                break
            passed += data[:count]
            if count < len(data):
                self._waiting[0] = (start + count * self.byte_time, data[count:])
                break
            self._waiting.popleft()
        return bytes(passed)
