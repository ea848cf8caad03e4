"""The pilot as one object: a config, a state, and `step`, which carries the state from tick to tick."""

from __future__ import annotations

from typing import TYPE_CHECKING

from autopilot.control.law import LawInForce
from autopilot.pilot_state import PilotConfig, configured, first_state, reconfigured
from autopilot.signals import Mode, Order, RudderCommand, Sample, Tick
from autopilot.supervision.states import MODES
from autopilot.supervision.supervisor import against_engaging
from autopilot.tick import step

if TYPE_CHECKING:
    # learning brings numpy along, which a pilot that does not learn need not load
    from autopilot.identification.learning import Learner


class Pilot:
    """`state` is all that is remembered. A learner, where there is one, learns from ticks in the slack after them."""

    def __init__(self, config: PilotConfig, law: LawInForce, learner: Learner | None = None) -> None:
        self._config, self.learner = configured(config, law), learner
        self.reset()

    def reset(self) -> None:
        """Forget everything since power-on."""
        self.state = first_state(self._config)

    @property
    def config(self) -> PilotConfig:
        """What is known of the boat."""
        return self._config.boat

    @property
    def law(self) -> LawInForce:
        """The law that steers, with its gains."""
        return self._config.law

    @property
    def mode(self) -> Mode:
        """Who has the rudder."""
        return MODES[self.state.supervisor.state]

    @property
    def last_command(self) -> RudderCommand:
        """The last command."""
        return self.state.rudder.command

    def reconfigure(self, config: PilotConfig, law: LawInForce) -> None:
        """Go on with other numbers from the next tick: memory is kept, the law starts at the rudder that was commanded.

        ValueError where that lies outside the new limits: it would have to jump.
        """
        # who moves the rudder is settled when the links are opened
        after = configured(config._replace(rudder_is_ours=self.config.rudder_is_ours), law)
        self.state = reconfigured(self._config, after, self.state)
        self._config = after
        if self.learner is not None and config.model != self.learner.present:
            self.learner.begin(config.model)

    def step(self, now: float, samples: tuple[Sample, ...], order: Order) -> Tick:
        """Return the tick at `now` [s]: what the samples say, what the order asks, what the rudder is given."""
        self.state, tick = step(self._config, self.state, (now, samples, order))
        return tick

    def against_engaging(self, tick: Tick) -> str:
        """Return what would keep an order to engage waiting after `tick`, the last: no heading, or who has the helm."""
        return against_engaging(self.state.supervisor, self.config.failsafe, tick.state)

    def learn(self, tick: Tick) -> None:
        """Learn from a tick. No command ever depends on it: what a learner proposes counts when it is adopted, by
        `reconfigure`. Nor does steering end with it: one whose numbers come to nothing begins anew."""
        if self.learner is not None:
            try:
                self.learner.learn(tick, steered=tick.command.engaged and self.config.rudder_is_ours)
            except (ArithmeticError, ValueError):
                self.learner.begin(self.config.model)
