"""The numbers of planned turns, all of them, in one table; what each changes: `benchmarks/results/sensitivity.md`.

*Derived*: an equation gives it. *Tuned*: chosen for turns in little more than the least time that lead past by little
with any noise, on the boats of `benchmarks/turns.py`; boats that nobody tuned for stand there beside them.
"""

from __future__ import annotations

import math

# how strong a rudder shows itself: tuned

WEAKEST, STRONGEST = 0.7, 1.0 / 0.7
"""q is looked for between these."""
SMOOTHED = 1.0
"""tau in units of T."""
DOUBT = 0.0011
"""The whole of a planned rudder, held over for so many time constants, counts for as much as the belief that q is 1."""
DOUBT_BIAS = 0.01
"""So many time constants count for as much as the belief that there is no b0."""
LEFT = 10.0
"""And so many times what the fit leaves over is doubt too: gusts, waves and noise are no constant push."""
FORGOTTEN = 4.0
"""Evidence fades in so many time constants."""

# turns of any boat: tuned

SHARPEST = 5.0
"""Deceleration is built up in no less than 1/SHARPEST [s], even by a rudder of unlimited rate."""
STABLE_STOP = (3.0, 2.0)
"""kappa in units of jerk/acceleration, and mu in units of kappa^2, of a course-stable boat: tuned on boats with T from
0.3 to 20 s for turns without overshoot in little more than the time-optimal time."""
ARRIVED = 1.0e-6
"""Heading [rad] and rate [rad/s] to go, and rudder [rad] off straight, together: below it the turn is over."""
BEGINS = 1.25
MOST_SHARE = 0.9
"""A turn is begun with this many times the rudder that it is planned to end with, but with no more than this share."""
PLANNED_SHARE = 0.8
"""The plan for the weakest of a course-unstable boat has this share of the rudder: the rest is the law's."""
NEAR = math.radians(1.0)
"""The last of a course-unstable boat's turn [rad] goes linearly: so close a turn is settled."""
DRAWN, DRAWN_RATE = 9.0, 1.5
"""At its fastest the plan is drawn to the real boat's heading and rate in so many parts of its time constant."""
CARRIED_OFF = 2.0
"""No plan turns at so many times the careful fastest rate, and its rudder may not stop the boat any more: the plan
keeps to the careful rate then, and the law takes all of the rudder to come back to it."""
BEHIND = math.radians(2.0)
"""The virtual boat turns no further [rad] ahead of the real one."""
AHEAD = math.radians(4.0)
"""A boat that is led back turns no further [rad] ahead of the virtual one."""
HARD_OVER = 0.98
"""A rudder commanded to this share of its angle is at its stop."""
TURNING_RUDDER = math.radians(1.0)
TURNING_SHARE = 0.1
"""A planned turn with more rudder [rad] or more of the boat's fastest turn than this shows how strong the rudder is,
and a rudder stronger or weaker than the model's must not be taken for wind."""
NO_TURN = math.radians(5.0)
TURNING_SLACK = 1.5
SETTLING_TIME_CONSTANTS = 5.0
"""A turn may take this much longer than planned, and this many time constants to settle, before it is off course."""
RESET_BEYOND = math.radians(20.0)
"""Carried off this far [rad] from the turn that was ordered, the boat is led on by a turn planned from where it is."""
RESET_BEYOND_EARLY = math.radians(8.0)
"""A course-unstable boat that swings further than its rudder's rate can follow is lost: the plan, which knows that
rate, takes over early. So it does where something holds any boat off its course."""
STOP_STEPS = 24
STOP_STEPS_MOST = 60
CROSSING_STEPS = 8
"""In so many steps a stop is looked ahead through: a course-stable boat's, and the way of an unstable one's rudder."""
