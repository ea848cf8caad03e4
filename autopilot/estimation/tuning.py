"""The filter's numbers, all of them: how big disturbances are, what is believed, and for how long.

Three kinds stand here, and which a number is stands beside it. *Derived*: an equation gives it. *Physical*: a property
of water, boats or instruments. *Tuned*: chosen over the boats of the closed-loop tests and an earlier study; beside it
what goes wrong where it is another.

"30 %" behind a number: the most that 30 % less or more of it changes of what `benchmarks/sensitivity.py` sails, healthy
boats and faults; nothing: no figure by 5 %.
"""

from __future__ import annotations

import math

# disturbances: what moves the boat beside its rudder, tuned

SEA = math.radians(2.0)  # 30 %: nothing
GUST = math.radians(0.2)  # 30 %: travel x 0.93
DISTURBANCE_TIME = 0.5  # 30 %: nothing
"""What moves the boat like a rudder of this size [rad], correlated over this time [s]: the whole sea, or all but it."""
MODEL_ERROR = 0.16  # 30 %: rms x 1.16, travel x 1.19, overshoot x 1.11, faults noticed later: 1
"""The rudder's effect is uncertain by this share of it over the boat's time constant, as white noise. Where much less
is supposed, a boat that turns 40 % better than its model swings about its course after a push: what its rudder does too
much is taken for wind. Where more is supposed, a quick boat's filter trusts its model too little to follow the boat."""
MODEL_ERROR_UNSTABLE = 0.6  # 30 %: nothing
"""The same of a course-unstable boat, whose rudder and own moment nearly cancel, whatever its time constant [s^(1/2)].
With 0.1 a boat with 30 % less rudder than the model's swings by 12 deg on a straight course in calm water, with 0.6 by
0.3 deg."""
SLIDE_LASTS = 4.0  # 30 %: nothing
SLIDE_UNKNOWN = 0.7  # 30 %: nothing
"""What a hull's slide does to a boat that turns outlasts the turn by so many time constants. It is, before the boat has
shown any, none give or take so many times the own damping."""
GUST_TIME_LEAST = 6.0  # 30 %: nothing
GUST_TIME_SHARE = 0.2  # 30 %: nothing
"""Gusts are what the bias does over so long [s], or over this share of the time in which it changes if that is longer:
the wind on a boat that turns slowly shows slowly, and waves on it show in the bias."""
BIAS_CHANGE = math.radians(2.0)  # 30 %: nothing
BIAS_CHANGE_IN_WAVES = math.radians(0.15)  # 30 %: travel x 0.91, at 0.3
BIAS_CHANGE_PUSHED = math.radians(5.0)  # 30 %: nothing
BIAS_CHANGE_STOPPED = math.radians(9.0)  # 30 %: nothing
BIAS_TIME = 10.0  # 30 %: travel x 1.06
"""Wind and trim change by this much rudder [rad] in this time [s], or in two time constants if that is longer, where
the file says nothing. Where waves are filtered it may be slow: how much it is in gusts is learnt, up to what it is
without the filter, and what is sudden is noticed as more than a wave, and then it is quick. With the rudder at its stop
it is in BIAS_TIME by any boat: what held the boat there may let go at once, however slow it is, and nothing wears
by it (docs/gains.md)."""

# the heading filter: what nothing is known of

BIAS_UNKNOWN = math.radians(3.0) ** 2  # 30 %: rms x 0.90
RATE_UNKNOWN = 0.2**2  # 30 %: nothing
"""Variances of a bias [rad^2] and of a rate [(rad/s)^2] of which nothing is known, not even how the boat turns."""
STEEPEST_GROWTH = 20.0  # 30 %: nothing
"""A step in which a course-unstable boat would grow by more than exp of this is cut there."""

# a rate sensor's standing error: physical

RATE_BIAS_UNKNOWN = math.radians(0.3) ** 2
"""Variance of the standing error of a rate sensor of which nothing is known [(rad/s)^2]: what is left of the zero-rate
offset of a micromechanical gyro that was calibrated at rest."""
RATE_BIAS_CHANGE = math.radians(0.02) ** 2 / 300.0
"""It drifts, with its temperature, by 0.02 deg/s in 300 s [(rad/s)^2/s]."""
RATE_BIAS_FELT = 0.1
"""A doubt of it that is less than this share of the rate's own variance is left out."""
RATE_COMPASS_LAG = 1.0
"""A compass lags by so long, or is read so much later than the gyro [s]: a damped fluxgate's time."""
RATE_MEAN_TIME = 5.0
RATE_BIAS_APART = math.radians(1.0) ** 2
"""Compass and gyro that are further apart on average over this time [s] than by this angle [rad^2] and by what a lag
makes in the turns of that time are begun anew: a wave's deviation of the compass goes by in it."""
RATE_BEYOND = 2.0
"""No boat turns at so many times the rate that its rudder makes hard over by the model, unless its heading shows it."""
RATE_HELD = 2.0
"""A rate holds for so long [s]."""

# the noise of compass and rate sensor: tuned

NOISE_MEMORY = 60.0
"""Time [s] over which it is averaged."""
NOISE_MOST = 5.0
"""It is at most so many times the file's deviation: beyond, it is no noise, and the monitors have a word."""
NOISE_GAP = 1.5
"""Measurements that lie further apart [s], or by more than the boat's time constant, differ by what the boat did."""

# the delay of the path to the steering gear: tuned

PATH_STEP, PATH_GRID = 0.1, 13
"""Delays are tried this far apart [s], so many of them. The last is longer than any that is steered with: orders that
are not obeyed within a second end the steering."""
PATH_MOST = PATH_STEP * (PATH_GRID - 2)
"""No longer delay [s] is believed: the grid must show that it is worse beyond."""
PATH_MOVED = math.radians(0.5)
"""An echo that has moved by less [rad] since the last that counted tells nothing."""
PATH_GRAIN = math.radians(0.1)
"""The grain of an echo [rad]: a microsecond of a servo's pulse is 0.07 deg of a usual rudder."""
PATH_LASTS = 0.5
"""A sensor must show the rudder so often [s]: what it does meanwhile goes by one order."""
PATH_SENSED = 0.1
"""By a sensor, which shows the rudder late itself, a delay is as filed where it is longer by less [s]."""
PATH_PART = 0.06
"""Between two angles that a sensor shows the gear is reckoned in parts of at most this [s]: a tick of a usual loop."""
PATH_REACH = 2.0
PATH_SLOWEST, PATH_QUICKEST = 0.125, 2.0
"""A rudder goes at so many times its filed rate at least and at most."""
PATH_LEAST = 10.0
PATH_WENT = math.radians(0.5)
"""It is held to go at its filed rate as if it had gone so far [rad] at it."""
PATH_MEMORY = 60.0
"""Echoes that moved are remembered for about so many more."""
UNLEARNT_TIME = 2.0
"""What pushes the boat and is not learnt as bias is averaged over so many time constants; see `unlearnt_step`."""
PATH_EXPLAINS = 0.3
"""The best delay must leave less than this share of what the worst leaves."""
PATH_RIVAL = 2.0 * math.log(1000.0)
"""The least J of a delay that is not beside the best exceeds the best's by so many times the noise, of normal errors
where it is a thousand times less likely. Derived; with 100 or 10,000 times the delay is known at most 0.1 s sooner or
later."""
PATH_ECHOES = 4
PATH_TELLS, PATH_FEW = 0.5 * PATH_RIVAL / PATH_ECHOES, PATH_ECHOES - 0.5
"""So many echoes at the least tell of a delay, or that it is another now: a stall of 0.3 s holds up two or three. What
one of them tells at most, as a logarithm, and the weight that so many exceed."""
PATH_ERROR_MOST = 0.02
"""A delay is certain where its standard error is less [s]."""
PATH_LATER, PATH_FOLLOWS = 0.05, 0.02
"""A delay that is longer than filed by less [s] is as filed: a tick of a usual loop. One that is gone by is followed
where it changes by more than the second."""

# what is taken in: gates are derived from the normal distribution, the rest is tuned

GATE_SIGMAS = 6.0  # 30 %: nothing
GATE_LEAST = math.radians(10.0)  # 30 %: nothing
GATE_PATIENCE = 5  # 30 %: nothing
GATE_LASTS = 0.55
"""A heading this far off is a spike; more than this many in a row that agree among themselves are the truth, or fewer,
two at least, behind the last that was fused by so long [s], which is the same at 10 Hz: a slow compass would be silent
until the fail-safe takes it for lost."""
INNOVATION_MEAN_TIME = 3.0  # 30 %: nothing
INNOVATION_MOST = 5.0  # 30 %: nothing
INNOVATION_LASTING = 1.5  # 30 %: nothing
"""White innovations average to less than this [standard deviations] over this time [s]; where they lie to one side for
longer, wind has changed or the model is wrong, and neither is a wave."""
LEAN_SIGMAS = 4.0  # 30 %: rms x 0.64, travel x 1.09, overshoot x 1.06
LEARNT = 2.0
"""White innovations of headings average over the time of gusts to less than so many of what they deviate by; a push
that makes them do so is learnt in so many of these times."""
LEAN_GROWTH = 2.0
"""While they lean so, the density of gusts grows by exp of this in the time of gusts. With 1.25 a slow boat holds gusts
4 % better by it, with 2 by 10 %; opened at once to its most, the rudder works on for minutes after they are over."""
BIAS_MOST = 0.5  # 30 %: nothing
"""Largest bias [rad] handed to the law."""
PREDICT_LONGEST = 2.0  # 30 %: nothing
"""The boat is not carried forward further than this [s] from its newest measurement."""
LONGEST_SHARE = 0.5  # 30 %: nothing
"""A step of the filter is at most this share of the boat's time constant."""
GRAIN_SHARE = 0.1  # 30 %: nothing
"""Rudder movements inside this share of the time constant act on the boat as their mean."""

# waves: the spectrum is physical, memory and limits of belief are tuned

WAVE_DAMPING = 0.15  # 30 %: rms x 0.90, travel x 0.88, overshoot x 1.05
"""xi: the width of the spectrum of encounter, as a share of its frequency. A narrower one learns a stern sea
better and lets Lanxin swing back too far after a long push (benchmarks/results/wave_filter.md)."""
WAVE_CORNER = 0.4  # 30 %: nothing
"""kappa: below this share of its peak's frequency the spectrum falls off to nothing."""
WAVE_STIFFENING = 1.0 + 2.0 * WAVE_DAMPING * WAVE_CORNER
WAVE_MEMORY = 40.0  # 30 %: nothing
WAVE_MEMORY_FIRST = 4.0  # 30 %: rms x 1.24, travel x 0.95
"""Time [s] over which the sea is averaged, and at the very start."""
WAVE_FREQUENCY_LEAST = 0.4  # 30 %: nothing
WAVE_FREQUENCY_MOST = 4.0  # 30 %: nothing
"""Frequencies of encounter [rad/s] that are taken for waves; slower is wind and current, faster is noise."""
WAVE_DEVIATION_FIRST = math.radians(0.5)  # 30 %: rms x 0.84, travel x 0.85
WAVE_FREQUENCY_FIRST = 1.0  # 30 %: rms x 0.87, travel x 1.39
"""What is supposed of the sea before anything is known of it: deviation [rad], frequency [rad/s]."""
WAVE_VARIANCE_LEAST = math.radians(0.02) ** 2  # 30 %: nothing
"""The oscillator never falls quite asleep: it must notice a rising sea. Deviation squared [rad^2]."""
WAVE_EXTREME = 3.0  # 30 %: rms x 1.47, travel x 2.15
WAVE_EXTREME_LEAST = math.radians(0.3)  # 30 %: nothing
"""A wave heading beyond so many deviations, and beyond this angle [rad], is no wave: something pushes the boat."""
WAVE_SHARPNESS = 8  # 30 %: travel x 1.06
"""How sharply waves that are steered against are parted from waves that are filtered."""

# gusts: the spread is derived, the rest is tuned

GUST_LONGER = 5.0  # 30 %: nothing
GUST_SPREAD = (
    GUST_LONGER**2 * (1.0 + 2.0 * GUST_LONGER) / (2.0 * ((1.0 + 2.0 * GUST_LONGER) * (2.0 + GUST_LONGER) - GUST_LONGER))
)
GUST_BIAS_FOUND = 2.0  # 30 %: nothing
"""While its variance falls by more than a part in e in so many t, the bias is being found: its changes are no gusts."""
GUST_BIAS_UNKNOWN = math.radians(1.8) ** 2  # 30 %: nothing
"""Nor are they where its variance [rad^2] is more than this, as with the rudder at its stop, where it may be quick."""
GUST_MEMORY = 40.0  # 30 %: nothing
"""Time [s] over which q is averaged, or twice the longer mean's if that is longer."""
DOUBT_SHARE = 0.3  # 30 %: nothing
"""Of the variance of b so much is doubt of y - z: the rest is forgotten on the way. With 1, gusts of slow boats take
minutes to be forgotten in a calm."""
STRENGTH_ERROR = 0.4  # 30 %: nothing
"""A rudder may be so much stronger or weaker than the model's. With 0 a coaster that turns 40 % better than its model
swings for ever after a push: the bias goes with the rudder, is taken for gusts, and follows the sooner."""
GUST_SURGE = 10.0  # 30 %: nothing
"""What lies further apart than so many times what is expected is a push, not a gust: it counts as that."""

# speeds and samples: physical limits, and tuned times

SPEED_SMOOTHING = 2.0  # 30 %: overshoot x 0.93
SPEED_FRESH = 10.0  # 30 %: nothing
"""A speed is smoothed over the first time [s]; one that nobody confirms for the second is no reason to go on steering a
slow boat's gains."""
STREAM_LEAST = 1.0 / 3.0  # 30 %: nothing
SPEEDS_APART = 2.0  # 30 %: nothing
STREAM_MOST = 2.5  # 30 %: nothing
"""No stream that is sailed in makes this difference [m/s, 5 kn] between log and ground: one of the two is wrong."""
SAMPLES_KEPT = 24  # 30 %: nothing
SPEED_MOST = 100.0  # 30 %: nothing
RATE_MOST = 10.0  # 30 %: nothing
RUDDER_MOST = 0.5 * math.pi  # 30 %: nothing
"""Faster [m/s], turning faster [rad/s], a rudder further over [rad]: these are broken instruments, not boats."""
SPEED_RATIO_MOST = 3.0  # 30 %: nothing
"""The model is not scaled beyond this many times the speed it was identified at."""

# the rudder: memory

TICKS_KEPT = 256
ORDERS_KEPT = 2048
"""So many ticks are remembered, and so many orders: 200 a second for a dead time of 10 s."""
FEEDBACK_FRESH = 2.0  # 30 %: nothing
"""Feedback older than this [s] is not believed any more."""

# how quick the rudder is: tuned

GEAR_LIKELIER, GEAR_SURE = 4.0, 10.0
"""So much more likely, as a natural logarithm, must another steering gear be to be gone by, or to be said."""
GEAR_EXPLAINS = 0.4
"""What a gear leaves unexplained must be less than this share of what the one that is gone by leaves. With 0.45 gusts
on a boat that turns 40 % better than its file are called a slow rudder, with 0.32 a slow boat's at a quarter of its
rate is not found in the turn."""
GEAR_NOISE = 0.05
"""What no steering gear explains, as a share of the rudder hard over. With 0.033 the container ship in waves and gusts
is said to have a slow rudder in two of three runs with turns."""
GEAR_SEA = 4.0
"""What is left over is a sea's, correlated over this time [s]."""
GUSTY = 0.25
"""On a course where gusts wander by this share of what they may, or waves are felt, the rudder answers what pushes."""
GEAR_PASSED = 0.3
"""t in units of the time constant."""
GEAR_SIGMA_SHARE = 0.3
GEAR_SIGMA_BIAS = math.radians(10.0)
"""Standard deviations of the rudder's effectiveness about 1, and of a push that is not learnt [rad of rudder]."""
GEAR_FADES = 6.0
"""What was seen fades in so many time constants."""
GEAR_PLAY = math.radians(2.0)
"""Where the gears lie apart by less [rad], nothing tells them apart."""
