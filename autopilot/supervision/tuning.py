"""The tuned numbers of the monitors, in one table: everything that follows from no formula and no measurement.

They were chosen on the boats of the tests and of the fault matrix, in calm, in sea state 3 and in sea state 5: so that
healthy boats that differ from their files raise nothing (tests/closed_loop/test_false_alarms.py, test_mismatch.py), and
faults are found in time (test_fault_matrix.py, test_detection.py). Where a figure beside a number says how close it is,
that was seen there. What follows from others stands with its formula in the module that uses it; the envelope's
numbers stand in `autopilot.supervision.envelope`, which shares none with anybody.

"30 %" behind a number: the most that 30 % less or more of it changes of what `benchmarks/sensitivity.py` sails, healthy
boats and faults; nothing: no figure by 5 %.
"""

from __future__ import annotations

import math

# The rudder-response monitor

LEAST_SHARE = 0.75  # 30 %: nothing
LEAST = (0.5, 0.85)  # 30 %: faults noticed later: 2
"""A boat still answers whose answer is this share of what it usually is, and within these shares of the model's: a
model that is 40 % too lively is none the worse for it."""
USUAL = 0.75  # 30 %: nothing
USUAL_SURE = 60.0  # 30 %: nothing
SUSPECT = 2.0  # 30 %: faults noticed later: 1
USUAL_TIME = 900.0  # 30 %: nothing
"""What share of the model's answer the boat is supposed to have before it has shown any; how sure that is, as a sum of
squares of the answer over their variance; with so much evidence against it, by headings or by blocks, nothing is
learnt; and how long [s] what
it has shown is remembered."""
FADES_TIME = 20.0  # 30 %: faults noticed later: 1
"""Evidence is forgotten in this time [s]: a fault that matters shows more of it."""
FADES_SLOW = 8.0  # 30 %: nothing
"""Or, of the boat and its gear, in so many time constants if that is longer."""
SURE, SURE_TURNING = (14.0, 6.0, 3.0), (11.0, 10.4, 1.0)
"""So much more likely, as a natural logarithm, must it be that the boat does not answer: together, by headings in the
sea as it is estimated now, and by blocks in the sea as it was learnt; on a course, and in a turn. There the rudder
moves by the order and not against the sea, which then looks less like a rudder that does nothing; but with less than
SURE_OTHER by headings a slow boat that drifts sideways was accused in one."""
SURE_SINCE = 8.0
"""As much, since a turn began, that it has been stuck ever since: of 3,600 healthy boats that were engaged with their
first heading in seas not known to them, up to four times as large as supposed, the most had 6.7. With 10.4 in place
of it 79 % in place of 86 % of the rudders that were stuck before were found."""
LITTLE = 1.0
"""With less evidence in blocks no fault has begun: what was left since the last time is the sea's."""
SURE_OTHER = 10.4  # 30 %: nothing
"""As much evidence, heading by heading, makes a boat that is not its file's. Were headings independent and the model
true, false alarms would come no oftener than once in exp(SURE_OTHER) = 33 000 of them (Lorden 1971)."""
MOST_AT_ONCE = 0.8  # 30 %: faults noticed later: 3
"""What one heading may add to that: a verdict takes 8 of them at least."""
BLOCK_S = 0.5
"""What a sea does is learnt in blocks of this time [s]. With 0.25 s no fault more was found, with 1 s twice as many
healthy thrusters were accused in waves of 1.6 rad/s."""
MOST_OF_BLOCK = 5.0
"""What one block may add to the evidence."""
TAILS = 6.0
"""What is left is as Student's t with so many degrees of freedom: a gust is no normal deviate."""
SPECTRUM_TIME = 60.0
"""A sea is remembered for this time [s]; with 120 s nothing changed."""
SPECTRUM_FIRST, SPECTRUM_SURE = (20.0, 10.0, 5.0, 2.0, 1.0), 10.0
"""Until it is known a sea of twice the variance of the slight one is supposed, and slower, as if it had been seen in
so many blocks. With half of it twice as many boats were accused as they were engaged in waves, with twice of it fewer
faults were found after a minute."""
SPECTRUM_LEAST = 5.0
"""So many blocks of white noise are supposed beside what was seen."""
SEA_SLIGHT = math.radians(2.0) ** 2
"""The sea [rad^2 of rudder] that blocks are made with: the spectrum is learnt as it differs from this one's. With 1 deg
twice as many healthy boats were accused, with 2 deg a stuck rudder in calm water was found later."""
OUTLIER = 6.0  # 30 %: nothing
OUTLIERS_MOST = 4  # 30 %: nothing
"""A heading so many standard deviations away is left out, but no more than so many in a row."""
PUSH_CHANGE = math.radians(0.6) ** 2  # 30 %: nothing
"""Wind and trim wander by so much [rad^2 of rudder] in a second."""
ROUGH = math.radians(0.5) ** 2  # 30 %: nothing
"""So uncertain is the model itself: the square [rad^2 of rudder] of a push that lasts for `ROUGH_TIME` [s]."""
ROUGH_TIME = 0.2  # 30 %: nothing
CHANGED_TIME = 4.0
CHANGED_LEAST = 0.03
"""A speed that has changed by more than this share in about this time [s] is off by as much."""
OWN_UNKNOWN = 0.1
"""The moment by which a course-unstable boat turns away by itself is uncertain by this share, over that time."""
SEA_LEAST = math.radians(1.0) ** 2  # 30 %: nothing
SEA_SLOWEST = 0.5  # 30 %: nothing
"""A sea of at least this size [rad^2 of rudder] and pace [1/s] is always supposed."""
UNEXPLAINED_TIME = 0.25  # 30 %: nothing
UNEXPLAINED = 3.0  # 30 %: nothing
"""Where headings of this time [s] are so much further off, squared, than any answer explains, a gust has set in."""
GUST = math.radians(25.0) ** 2  # 30 %: nothing
"""What a gust adds to the push's variance, a second [rad^2/s]."""
HARDLY = 0.1  # 30 %: nothing
GUST_SIZE = math.radians(25.0)  # 30 %: nothing
GUST_IN = 4.0  # 30 %: nothing
GUST_OVER = 0.01  # 30 %: nothing
"""Where there is more evidence against the rudder than the first, a gust may have set in, worth about the second [rad
of rudder]. One that is likelier than none by the third, as a natural logarithm, is one. One that is as much less
likely, or adds by a heading less than the fourth, a share, to what it has shown, makes room for another. With 2 in
place of 4 reversed rudders were found up to 0.9 s later in a sea, with 0.2 in place of 0.1 a push that ended as the
rudder came off its stop was called one."""
DOUBTED = 7.0  # 30 %: nothing
"""Evidence that is a doubt in a trial, as a natural logarithm: its rudder rests, and a gust looks the same there. The
law's rudder moves, and tells them apart."""
PUSHED_SIGMAS = 2.0  # 30 %: nothing
"""A push counts beyond so many standard deviations: with only one of them healthy zigzags in sea state 5 ended."""
SEA_TURNED = math.radians(10.0)  # 30 %: nothing
"""So far [rad] from the headings of the last SEA_KNOWN_S the sea is not the one that is estimated there: a boat meets
the same waves slower, and from a side that turns it more."""
SEA_LASTS = 3600.0  # 30 %: nothing
"""A sea that was met is remembered for this time [s]: courses on which it turns no boat say nothing of it."""
WORKED_TIME = 30.0
"""What the rudder does against the waves is averaged for so long [s]: with 16 s a stuck rudder on a course is found
later."""
SEA_FIRST, SEA_FIRST_TIME = math.radians(3.0) ** 2, 10.0
"""From when the sea is estimated on it may be larger by so much [rad^2 of rudder], which fades in this time [s], and
evidence heading by heading counts as much less. Where the filter itself supposed that sea, with 2 deg 6 of 1,008
healthy boats that were engaged with their first heading were accused within 20 s, with 3 deg 2, without 13."""
SEA_UNMET = math.radians(1.0)  # 30 %: nothing
"""On a course that is new to the boat a sea is supposed that yaws it by this [rad]."""
SLIDE_SURE = 10.0  # 30 %: nothing
"""How sure it is that a boat which has shown no slide has none, as a sum of squares of the slide's answer over their
variance: a turn of 60 deg has 15 to 70, a course in a slight sea less than 1."""
ANSWERS_MOST = 1.6  # 30 %: nothing
"""Shares of the answer beyond which, the opposite one included, it is something else that turns the boat."""
REVERSED_SHARE = -0.7  # 30 %: nothing
"""What a boat answers at least whose rudder is wired the wrong way."""
LIVELY = (ANSWERS_MOST, 3.5)
QUICK = (2.4, 6.0)  # 30 %: nothing
"""Shares of the model's answer, the one against the other: more than their mean is a boat that turns better than the
model allows for, and one that is not the model's. A gust turns the boat to one side while the rudder may go there too;
an answer is to both sides, so the evidence must be there on each."""
MISFIT = 3.0  # 30 %: nothing
MISFIT_TIME = 2.0  # 30 %: nothing
"""Where headings of this time [s], or of a time constant, lie so much further off, squared, than such an answer
explains, it is not what turns the boat."""
COLOUR_TIME = 0.5  # 30 %: nothing
"""What the best share of the answer leaves over is white noise where it is a compass's. Where it lies to one side for
so long [s], a sea other than the one that is estimated turns the boat, and the rudder follows it at the sea's own pace:
one heading then tells little that those before it have not."""
COLOUR_KNOWN = 2.5  # 30 %: faults noticed later: 1
"""The square of what lies to one side, where the sea is the one that is estimated: 2.3 at most with each boat of the
tests in state 3. Where it has been so many times as much while nothing was suspect, the sea is another, and does what
looks like a fault of the rudder so much more often: as much more evidence is wanted."""

# The rudder watch

PATIENCE_S = 1.2  # 30 %: nothing
"""A rudder that is off its order and makes no progress for so long [s], and its delay, does not follow."""
PROGRESS_SHARE = 0.3  # 30 %: nothing
ASSUMED_RATE = math.radians(5.0)  # 30 %: nothing
"""Progress is this share of the filed rate, and of this rate [rad/s] at most: as much where no rate is filed."""
LONGEST_GAP_S = 1.0  # 30 %: rms x 0.90, travel x 0.90
"""Angles, or headings, further apart [s] prove nothing."""
SLOW_SHARE = 0.5  # 30 % more: 6 of 121 rudders of 0.7 to 1.0 of their rate are called slow, in place of none
SLOW_TIME_S = 2.0
"""A rudder that is off its order goes there at its filed rate: less than this share of it for so long is a slow one."""
STANDS = math.radians(0.5)
"""A rudder that has moved by less while it should have does not move at all."""
HELD_S = 3.0
"""A line that stalls may hold an order for so long [s]: RC_OVERRIDE_TIME, after which a vehicle follows none."""
CATCHES_UP = 0.3
"""A line that held something is late by so much less each second."""
UNSEEN_S, HELD_PERIODS = 0.5, 3.0
"""What may be held shows for longer than this [s], and than so many times as far apart as angles usually are."""
USUAL_SHARE = 0.2
"""What one interval adds to how far apart angles usually are."""
STILL = math.radians(1.0)
"""A rudder that has moved by no more [rad] stands, whatever its sensor's noise."""
REMEMBERED_S = 1.5
"""A report is of one of the orders of this time [s]: it comes at 5 to 10 Hz and is as old as the link."""
TOLERANCE = math.radians(3.0)
"""Dead zone and whole microseconds move an order by less [rad]."""
REPORT_FRESH_S = 1.0
"""A report that is older [s] proves nothing."""
LATE_S = 0.4
"""An answer that comes this much later [s] than the model's is one, too: links and gears are slow at times."""
LATE_LASTS = 1.0
"""So long [s] after a tick that came late nothing is evidence against the rudder: what was ordered then has left some
time between the two ticks, and what the boat did until then hangs after it. Nor does a rudder go the wrong way where a
motor whose speed is ordered ran on past its order until the next one came."""
SLOW = 4.0
"""A slow rudder is so many times slower than it should be: against one that is right on a boat that answers weakly, as
the model says, or strongly, and against one that is late."""
PUSHED_S = 0.3
"""A push that is heavier than the trial's rudder for this time [s] is one."""
TRIAL_SAID = 10.0
"""That a trial does not turn the boat is said for this time [s]: it is over by then."""
AT_THE_STOP_TIME = 15.0
"""A course held with the rudder at its stop for so long [s]: there is none left."""
PUSH_BEYOND = 1.5
"""A push of twice what the rudder holds is an alarm when it lasts so long [s] with the rudder at its stop, one that is
nearer after longer (`overpowered_step`). Gusts that set in at once and in 5 s, on boats with T = 0.3 to 100 s, reached
0.72 at most with 25 deg where the rudder holds 30, and 0.22 with 21."""
AGAINST_SHARE = 0.8
"""A boat that turns against a rudder hard over, as a rudder of this share to the other side would turn it."""
TAKES_HOLD, HOLDS, SETTLED = 1.0, 2.0, 3.0
"""Time constants after which a rudder hard over has begun to stop what it can stop, has stopped most of it, and what
was before it is forgotten."""
FAR = math.radians(20.0)
WAVES_REACH = 2.0
"""So far [rad], and so many standard deviations of what the waves turn it, has a boat turned against its rudder that is
pushed harder than it can hold."""

# The compass watch

APART_TIME = 5.0
"""Turns by heading and by rate are compared over about this time [s]."""
SENSE_TIME = 2.0
"""Which way the boat turns is taken from its turns over about this time [s]."""
SENSE_LASTS = 4.0
SENSE_LEAST = math.radians(2.0) ** 2
SENSE_SHARE = 4.0
"""They go opposite ways where the mean square of their difference, over this time [s], is this many times that of
their sum and by so much [rad^2] more: a compass that lags by less than 120 deg of a wave is right yet, and so is
a gyro that is off by a degree a second."""
RATE_LAG = 0.5
"""A rate that no rudder makes, and that the heading does not show for so long [s] and by the file's limit, is none: it
is in other units."""
WILD_RATES = 2
"""So many such rates within `APART_TIME` are wanted, each a measurement of its own: a single one is a spike."""
DISAGREES_LASTS = 1.0
"""Turns by heading and by rate must differ for so long [s]."""
RATE_OFF, RATE_RIGHT = math.radians(0.75), math.radians(0.5)
RATE_OFF_KNOWN = (0.2 * RATE_OFF) ** 2
"""A rate sensor that is off by the first [rad/s], known to that variance [(rad/s)^2], is reported until it is off by
less than the second: beyond what is left of a gyro's calibration, or the heading drifts."""
DISAGREES_SAID = 20.0
"""That they differed is said for this time [s]: a boat that does not turn for a while tells nothing of its gyro."""
FROZEN_SAMPLES = 10
"""So many headings that are the same to the last digit are worth a second look."""
FROZEN_REPEATED, FROZEN_BEFORE = 1.2, 1.0 / 3.0  # 30 % of the first: frozen 0.3 s later, of the other 0.1 s
"""A heading that is repeated, sent on once a second and a fifth of that late, hides what the boat turns in so long [s]:
either turn must be more than that and this share of its limit together, or than all of that for as long."""
FROZEN_BY_RATE = math.radians(5.0)
FROZEN_BY_RUDDER = math.radians(15.0)
"""The turn that an instrument measured, or that the rudder must have made, spans this while the heading stood; or the
heading went so much further than the rate while that stood."""
FROZEN_RATES = 4
"""So many rates that are the same to the last digit while it did are none of a sensor that works: it would follow."""
RATE_FORGOTTEN = 10.0
"""A rate sensor's bias would add up over longer than this [s]."""
NOUGHT_FORGOTTEN = 30.0
"""While the rate of turn is nought as well, the learnt disturbance's error would add up over longer than this [s]."""
SEA_FELT = math.radians(0.7)
SEA_DIGITS = 5.0
SEA_STOOD = 3.0
"""In a sea that moved the heading by this standard deviation [rad], and by so many of the compass's own digits, no
heading stands for so long [s], between two wave groups neither."""
SEA_PROVEN = 20.0
"""A sea is one that has been felt for so long [s] on a course that is held: a turn in flat water looks like a wave."""
TREMBLES_DIGITS, TREMBLES_SAME = 1.5, 0.2
TREMBLES_LEAST, TREMBLES_TIME = 0.25, 20.0
TREMBLES_KNOWN = -math.expm1(-0.5)
"""A compass whose own noise is a deviation of so many of its digits says the same twice with a probability of 0.19, and
for SEA_STOOD, in headings no further apart than the third [s], with 0.19^12 at most, whatever the water is: where no
more than the second of them are the same as the one before, means over the fourth [s], of which the fifth, ten seconds'
share, has been seen: 40 headings or more, of which a share is known to 0.06."""
TREMBLES_SIGMAS = 2.0  # 30 %: frozen within 5 s 26 or 21 of 30 in place of 23
"""Noise may end with an engine: such a compass then shows the boat's heading, to a digit and so many standard
deviations of what is known of that."""
FINE_DIGIT, FINE_DIGITS, FINE_SAME = math.radians(0.002), 20.0, 0.02
"""A compass whose digit is no more than the first [rad] (a float has 1e-5 deg, the finest sentence 0.006 deg), of whose
headings no more than the third are the same as the one before, and that moved by so many digits from one to the next,
does not come to rest to the last of them at once: what swings out, without noise, does by ever smaller steps."""
HELD_LEAST = math.radians(6.0)  # 30 %: of jumps of 8 deg 31 % less are found in a deviation of 5 deg, with more
HELD_SIGMAS = 5.0  # 30 %: of jumps of 8 deg 33 % less are found at 1 Hz, with more
"""A heading that is off by the first [rad] from the one that the rate of turn carries on, and by so many times the root
mean square of what usually lies between them, was not turned there by the boat."""
HELD_USUAL_TIME = 30.0  # 30 %: nothing
"""That mean is of this time [s]: some wave groups."""
HELD_LAG = 1.0  # 30 %: of jumps of 8 deg 5 % less are found at 1 Hz, with more
"""A compass lags by so long, or is read so much later than the gyro [s]: a damped fluxgate's time."""
HELD_SETTLES = 1.5  # 30 %: nothing
"""A jump is over in this time [s], a damped compass's too; what moves on is a turn."""
TURN_GAINED = 0.5
"""A boat gains the quickest turn that it is thought capable of, twice its model's, in this time [s] at least, as the
quickest boat known does where its rudder is hard over at once: Lanxin, T = 0.33 s, 33 deg/s at 63 deg/s^2."""
HELD_RESTS = 2.0 / 3.0  # 30 %: nothing
"""It has come to rest where it moves by no more than this share of what it must jump by."""
HELD_STAYS = 0.5  # 30 %: of jumps of 20 deg 24 % less are found behind noise of 2 deg, with less
"""Beside no gyro a heading has jumped that stays as near to where it jumped to as this share of its jump."""
HELD_FOLLOWS = math.radians(0.25)  # 30 %: 2.2 deg more off course 60 s after a jump of 12 deg, with more
"""By so much each second [rad/s] a compass is followed whose jump nobody has acknowledged by taking the helm."""
HELD_SAID = 20.0  # 30 %: of jumps every 25 s 11 changes of the alarm in place of 7, with less
"""A jump is said for this time [s] at least, and jumps that come sooner belong together."""
JUMPS = 3
JUMPS_WITHIN = 10.0
"""So many jumps within this time [s] are no spikes any more."""
JUMP_SETTLED = 0.5
JUMP_SAMPLES = 3
"""A heading that stays where it jumped to for so long [s], and so many samples, has jumped for good."""
JUMP_UNSHOWN = 0.45
"""A rate that is made of the headings shows half of a jump at most, by the mean of before and after; one that leaves
less than this share unshown is a gyro's. Between the two lies a noise of 1 deg. Of waves at 1 Hz it leaves as much at a
period of 2.8 s."""
JUMP_SAID = 5.0
"""A jump is reported for this time [s] after it was found."""
HEADINGS_APART_S = 2.0
"""Headings further apart [s] are not compared, nor is a rate that is older than its heading by more."""
INNOVATION_TIME = 20.0
"""The innovation's mean must be off for so long [s]."""

# The course watch

LED_PAST = 2.0
"""A turn that has led past its course by as much as would be off it is said after this time [s]: a wave is over."""
BACK_ON_COURSE = 0.7
"""An off-course alarm ends when the error is back within this share of its limit."""
SOFTER = 4.0
"""The law orders as for a boat that answers so many times as much, and once more where that is not enough."""
SPEED_SWINGS, SUSPECT_SWINGS, HALF_SWINGS = 3, 4, 6
ALIKE, GROWS = 1.6, 3.0
LEAST_TIME = 0.25
"""So many sweeps of the rudder from side to side in a row, each with a swing of the heading, or from stop to stop
whatever the swing, show a speed that reads too low where the boat answers as at a higher one, may be a limit cycle, or
are one: a turn and its counter-rudder are two, and the third is an overshoot. From stop to stop and of a right speed,
in seas of up to 8 deg of rudder, 1 of 40 runs of a course-unstable model boat answered so. They last as long as each
other, and the swings are as far, within this factor, or farther while the cycle grows (GROWS); a sea's are not. Sweeps
that last less than this many time constants are not the boat's, nor those of one that is sixteen times as quick."""
BY_RUDDER, BY_RUDDER_LATER = 0.98, 0.995
"""So much of the rate's variance is the rudder's where steering makes the swings. Of boats that differ from their file
0.995 and more (5 to 40 times as lively); 0.89 to 0.96 in a sea of 6 deg of rudder, which shows them some sweeps later.
Of boats that are theirs, in gusts and seas that their rudder is too slow for, 0.978 at most. By orders of before:
0.996 to 1.000 of a BlueBoat whose thrust comes 0.25 to 0.5 s later than filed (0.92 to 0.97 at once), 0.994 at most of
boats that are their file's, in gusts and seas that their rudder is too small for."""
BEYOND = 3.0
"""A swing so many times as far as the rudder from stop to stop makes by the model counts for two, where it lasts longer
than a sea's: seas turn small boats as far beside their rudder."""
SWEEP = 0.5
"""Each of them, from turning point to turning point, in units of the rudder's limit to one side."""
SWING = math.radians(10.0)
"""And each of the heading's [rad], as far: less is a quick boat in a sea."""
PAUSE = (10.0, 15.0)
"""A sweep that comes later than this [s] and so many time constants after the one before begins the count anew."""
NEW_COURSE = math.radians(5.0)
"""An order that differs by this [rad] begins a turn: what came before is forgotten."""
CIRCLES, CIRCLES_DOUBTED, BEHIND = math.radians(390.0), math.radians(300.0), math.radians(150.0)
"""Turned this far [rad] away from the heading ordered, on balance; less where the speed has been doubted, but for a
heading that is ordered further behind than the third [rad]: it may be reached the other way round."""
ON_COURSE = math.radians(10.0)
ON_COURSE_TIME = 4.0
"""A boat within this [rad] of its course for this time [s], or for so many time constants if that is longer, has not
gone round: the turns that brought it there are over."""
OUTRUNS, OUTRUNS_UNSTABLE, RUSH, SPIN = 1.5, 1.25, 2.0, 3.0
"""So many times the quickest turn that the model knows is more than goes with the speed, of a course-stable boat and of
an unstable one; makes the law soft; and is another boat's."""
WAY_KEPT = 2.0
"""So many time constants a boat turns on as at the speed that it had."""
SPIN_TIME = (1.0, 0.3)
"""The rate of turn is taken over this time [s], or over so many time constants if that is longer."""

# All monitors

ROLL_SECONDS = 2.0
"""Heel must last for so long [s]."""
LATE_PERIODS = 3.0
"""A tick this many control periods after the one before it is late: a heading that is waited for may take half that."""
NEWS = math.radians(10.0)
"""An alarm is said anew when its angle has changed by more than this [rad]: each degree would be a new text."""
AT_THE_STOP = 0.9
"""A rudder commanded beyond this share of its limit stands at its stop."""
SPEED_DOUBT = 1.25
"""A speed further than this from the trial's may be what is wrong where the boat does not answer as it should."""
