"""What drives a simulation: the recorded rudder, speed, propeller and wind on the steps of an integration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.identification.rudder_path import DIRECT, RudderTrain, behind_train, corners, with_corners
from autopilot.identification.runs import FloatArray, Segment
from autopilot.models.norrbin import Norrbin

BESIDE_RUDDER = ("speed", "propeller", "beam_wind", "quarter_wind")


IntArray = NDArray[np.intp]


class SamplePlaces(NamedTuple):
    """Where the N samples of a segment lie: after node `left` by `share` of the way to the next, shapes (N,)."""

    left: IntArray
    share: FloatArray


class Forcing(NamedTuple):
    """The integration steps of S segments, one segment after the other: M steps between M + S nodes in all.

    step [s], shape (M,); begin: the node at which each step begins, shape (M,), its end is the next node; first:
    the node at which each segment begins, shape (S,). rudder [rad] and speed [m/s], shape (3, M), at the beginning,
    middle and end of each step, as are propeller [1/s], beam_wind and quarter_wind [m^2/s^2], 0 where the recording
    has none. samples: per segment, at which nodes its samples lie. moments [s]: per segment its steps' beginnings,
    middles and ends, shape (3, its steps); paths: per segment time [s] and angle [rad] of the recorded rudder. scales:
    what a simulation has found of the scaling with speed, for the next one.
    """

    step: FloatArray
    begin: IntArray
    first: IntArray
    rudder: FloatArray
    speed: FloatArray
    propeller: FloatArray
    beam_wind: FloatArray
    quarter_wind: FloatArray
    samples: tuple[SamplePlaces, ...]
    moments: tuple[FloatArray, ...]
    paths: tuple[tuple[FloatArray, FloatArray], ...]
    scales: dict[tuple[float, int, int], Norrbin]


def forcing(segments: Sequence[Segment], longest_step: float, together: float | None = None) -> Forcing:
    """Return the segments' rudder and speed on steps of at most about `longest_step` [s].

    Samples further apart than that are subdivided; those that lie within `together` [s], by default the same, are
    stepped over in one. Between samples rudder and speed move linearly.
    """
    reach = longest_step if together is None else together
    turns = [corners(segment.time, segment.rudder) for segment in segments]
    knots = [
        _knots(np.union1d(segment.time, times), longest_step, reach)
        for segment, (times, _) in zip(segments, turns, strict=True)
    ]
    first = np.cumsum([0, *(times.size for times in knots[:-1])])
    begin = np.concatenate([start + np.arange(times.size - 1) for start, times in zip(first, knots, strict=True)])
    moments = tuple(np.stack([t[:-1], 0.5 * (t[:-1] + t[1:]), t[1:]]) for t in knots)
    paths = tuple(
        with_corners(segment.time, segment.rudder, turn) for segment, turn in zip(segments, turns, strict=True)
    )
    driven = {
        "rudder": np.concatenate([np.interp(m, *path) for m, path in zip(moments, paths, strict=True)], axis=1)
    } | {
        name: np.concatenate(
            [_recorded(segment, name, times) for segment, times in zip(segments, moments, strict=True)], axis=1
        )
        for name in BESIDE_RUDDER
    }
    samples = tuple(
        _places(segment.time, times, int(start)) for segment, times, start in zip(segments, knots, first, strict=True)
    )
    step = np.concatenate([np.diff(times) for times in knots])
    return Forcing(step, begin, first, **driven, samples=samples, moments=moments, paths=paths, scales={})


def rudder_behind(train: RudderTrain, forcing: Forcing) -> FloatArray:
    """Return what the recorded rudder [rad] has become behind `train`, shape (3, M) as in Forcing."""
    if train == DIRECT:
        return forcing.rudder
    parts = []
    for moments, (time, angle) in zip(forcing.moments, forcing.paths, strict=True):
        in_order = np.append(moments[:2].T.ravel(), moments[2, -1])
        there = behind_train(train, time, angle, in_order)
        parts.append(np.stack([there[:-1:2], there[1::2], there[2::2]]))
    return np.concatenate(parts, axis=1)


def _recorded(segment: Segment, name: str, moments: FloatArray) -> FloatArray:
    values = getattr(segment, name)
    return np.interp(moments, segment.time, values) if values.size else np.zeros_like(moments)


def _places(time: FloatArray, knots: FloatArray, start: int) -> SamplePlaces:
    right = np.clip(np.searchsorted(knots, time), 1, knots.size - 1)
    return SamplePlaces(start + right - 1, (time - knots[right - 1]) / (knots[right] - knots[right - 1]))


def _knots(time: FloatArray, longest_step: float, together: float) -> FloatArray:
    """Return the ends of the integration steps [s]: every few samples, or several within a sample spacing."""
    coarse = _thinned(time, together * (1.0 + 1.0e-9))
    pieces = np.maximum(np.ceil(np.diff(coarse) / longest_step - 1e-9), 1.0).astype(int)
    return np.interp(np.arange(pieces.sum() + 1), np.concatenate([[0], np.cumsum(pieces)]), coarse)


def _thinned(time: FloatArray, together: float) -> FloatArray:
    """Return `time` without what lies within `together` [s] of one that is kept; the last one always stays."""
    if time.size < 3 or float(np.min(time[2:] - time[:-2])) > together:
        return time
    within = np.searchsorted(time, time + together, side="right") - 1
    # the last sample within reach, and the next one where none is
    following = np.maximum(within, np.arange(1, time.size + 1)).tolist()
    chosen = [0]
    while chosen[-1] < time.size - 1:
        chosen.append(following[chosen[-1]])
    return time[chosen]


def at_samples(values: FloatArray, forcing: Forcing, s: int) -> FloatArray:
    """Return `values` at the nodes, shape (M+S,), at the N samples of segment `s`, linear between nodes."""
    left, share = forcing.samples[s]
    return np.asarray(values[left] * (1.0 - share) + values[left + 1] * share)
