"""What a log format says of itself: how it is known by its content, and how it is read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

from autopilot.logs.series import FloatArray, Recording
from autopilot.logs.table import Servo, ServoScale
from autopilot.models.drives import PLAIN, Mixing


class ReadOptions(NamedTuple):
    """columns: what a CSV table calls its columns. system: MAVLink system id to read.

    servo: the steering servo, or only its scale.
    variation [rad], east positive: of magnetic compasses in NMEA sentences. thrusters: what two of them do, beside
    what the firmware's parameters say.
    """

    columns: Mapping[str, str] | None = None
    system: int | None = None
    servo: Servo | ServoScale | None = None
    variation: float | None = None
    thrusters: Mixing = PLAIN


class LogFormat(NamedTuple):
    """A format, as `autopilot.logs.reading` knows it.

    example: one of its files, as a sentence names it; "": another format's says enough.
    is_it: says of a file's bytes whether they are of this format. read: the recording in a file, of its path, its bytes
    and the options; InputError where it cannot be used.
    ending, broken: of the file names that promise it, and what is said where the content is another.
    is_text: it is looked for after all that is not.
    packets: it is a row of MAVLink packets; ticks: of the pilot's own ticks, too.
    run: the columns of a run, and notes, where they stand in the file as they are; None: they are made of the series.
    """

    example: str
    is_it: Callable[[bytes], bool]
    read: Callable[[str, bytes, ReadOptions], Recording]
    ending: str = ""
    broken: str = ""
    is_text: bool = False
    packets: bool = False
    ticks: bool = False
    run: Callable[[str, ReadOptions], tuple[Mapping[str, FloatArray], tuple[str, ...]]] | None = None
