"""The skipper who can hand the course to a chart plotter: `f` follows it, any other order takes the course back."""

from __future__ import annotations

from autopilot.cli.skipper import Skipper
from autopilot.guidance.plotter import PlotterGuide
from autopilot.signals import Mode, Order, OrderKind, Tick

FOLLOW_HELP = "f: follow the chart plotter"


class PlotterSkipper(Skipper):
    """A `Skipper` whose heading orders come from `guide` while it follows."""

    def __init__(self, rudder_max: float, guide: PlotterGuide) -> None:
        super().__init__(rudder_max)
        self._guide = guide

    def __call__(self, now: float, tick: Tick | None) -> Order:
        """Return the order at `now`; while following, its heading is the course that leads along the track."""
        order = super().__call__(now, tick)
        if not self._guide.following or tick is None or order.kind is not OrderKind.HEADING:
            return order
        if tick.mode is not Mode.ENGAGED or self._adopt:
            return order
        # the same serial: a plotter must not engage the pilot anew after an override
        course = self._guide.course(now, tick.state.heading, tick.state.speed)
        self._order = order._replace(heading=course, is_led=True)
        return self._order

    def engage(self, heading: float | None) -> None:
        """Order a heading [rad] or the present one; the plotter no longer leads."""
        self._guide.leave()
        super().engage(heading)

    def turn_to(self, heading: float) -> None:
        """Change the heading [rad] ordered; the plotter no longer leads."""
        self._guide.leave()
        super().turn_to(heading)

    def stand_by(self) -> None:
        """Order the rudder to be given back; the plotter no longer leads."""
        self._guide.leave()
        super().stand_by()

    def follow(self) -> None:
        """Follow the plotter, engaging on the present heading where nothing is steered yet."""
        if self._order.kind is not OrderKind.HEADING:
            self.engage(None)
        self._guide.follow()

    def type_line(self, line: str) -> str:
        """Act on a typed line and return what to answer. Raises InputError."""
        if line.strip() == "f":
            self.follow()
            return "following the chart plotter"
        answer = super().type_line(line)
        if line.strip()[:1] in ("e", "s", "r", "+", "-"):
            self._guide.leave()
        return answer
