"""What stations and plotters order and set, written down: a skipper, a store of parameters, and a plotter's guide."""

from __future__ import annotations

from collections.abc import Collection

from autopilot.guidance.current import Overboard
from autopilot.guidance.plotter import PlotterGuide, PlotterMessage
from autopilot.links.base import LastStop


class Skipper:
    """Writes down what is ordered."""

    def __init__(self) -> None:
        self.orders: list[tuple[str, float | None]] = []
        self.overboard: Overboard | None = Overboard()
        self.last_stop = LastStop()

    @property
    def released(self) -> int:
        """How often the boat was to stand by."""
        return self.orders.count(("stand by", None))

    def engage(self, heading: float | None) -> None:
        self.orders.append(("engage", heading))

    def turn_to(self, heading: float) -> None:
        self.orders.append(("turn", heading))

    def stand_by(self) -> None:
        self.orders.append(("stand by", None))

    def follow(self) -> None:
        self.orders.append(("follow", None))


class Store:
    """Numbers by name; those named in `positive` take nothing below zero."""

    def __init__(self, values: dict[str, float] | None = None, positive: Collection[str] = ()) -> None:
        self.values = {"GAIN": 1.0} if values is None else values
        self.positive, self.written = positive, 0

    @property
    def revision(self) -> int:
        return self.written

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.values)

    def get(self, name: str) -> float:
        return self.values[name]

    def set(self, name: str, value: float) -> str:
        if name in self.positive and value < 0.0:
            return f"{name} not changed: allowed: at least 0."
        self.values[name] = value
        self.written += 1
        return ""


class Ear(PlotterGuide):
    """A guide that keeps what it gets."""

    def __init__(self) -> None:
        super().__init__()
        self.heard: list[PlotterMessage] = []

    def take(self, message: PlotterMessage) -> None:
        self.heard.append(message)
        super().take(message)
