"""The numbers of a vessel file as MAVLink parameters: one name, range, unit and meaning for file and ground station.

The table follows from the typed schema: each number, switch and choice that the vessel has a value for, in the order
of the file. Names are the section's prefix and the key without its unit, shortened to MAVLink's 16 characters.

What runs and what is stored are two values: a field that counts after a restart differs between them until then.
"""

from __future__ import annotations

import dataclasses
import math
import struct
import types
import typing
from collections.abc import Iterator, Mapping
from typing import Any, Literal, NamedTuple, TypeVar, Union

from autopilot.control.registry import LAWS
from autopilot.files.typed import UNIT_SUFFIXES, Bounds, hints_of
from autopilot.vessel.file import problems
from autopilot.vessel.schema import NOW, Counts, Vessel

NAME_LENGTH_MAX = 16


def _of_laws() -> dict[str, tuple[str, str]]:
    """Return prefix and title of the laws' sections; a section within one adds its first letter and its name."""
    found = {}
    for name, law in LAWS.items():
        if law.section is None:
            continue
        found[f"control.{name}"] = law.prefix, law.title
        for key, hint in hints_of(law.section).items():
            if dataclasses.is_dataclass(hint):
                found[f"control.{name}.{key}"] = law.prefix + key[0].upper(), f"{law.title}: {key}"
    return found


SECTIONS = {
    "model": ("MDL", "Model"),
    "rudder": ("RUD", "Rudder"),
    "sensors": ("SNS", "Sensors"),
    "control": ("CTL", "Control"),
    **_of_laws(),
    "guidance": ("GUI", "Guidance"),
    "estimator": ("EST", "Estimator"),
    "limits": ("LIM", "Limits"),
    "failsafe": ("FS", "Fail-safe"),
    "helm": ("HELM", "Helm"),
    "drive": ("DRV", "Drive"),
}
"""Sections that are parameters, each with the beginning of their names and the title of their group. Those that are
not here, such as the model's standard errors, are none."""

NAMES = {
    "model.reference_speed_m_s": "MDL_REF_SPEED",
    "model.speed_exponent": "MDL_SPEED_EXP",
    "model.throttle_exponent": "MDL_THR_EXP",
    "model.damping_share": "MDL_DAMP_SHARE",
    "model.way_exponent": "MDL_WAY_EXP",
    "model.slowest_m_s": "MDL_SLOWEST",
    "model.fastest_m_s": "MDL_FASTEST",
    "model.reference_throttle": "MDL_REF_THR",
    "drive.thrust_exponent": "DRV_THRUST_EXP",
    "drive.astern_share": "DRV_ASTERN",
    "rudder.follow_tolerance_deg": "RUD_FOLLOW_TOL",
    "sensors.heading_noise_deg": "SNS_HDG_NOISE",
    "sensors.heading_latency_s": "SNS_HDG_LATENCY",
    "guidance.waypoint_radius_m": "GUI_WP_RADIUS",
    "guidance.off_track_alarm_m": "GUI_XTRACK_ALARM",
    "guidance.gybe_wind_max_m_s": "GUI_GYBE_WIND",
    "failsafe.heading_timeout_s": "FS_HDG_TIMEOUT",
    "failsafe.reengage_after_reboot": "FS_REENGAGE",
    "failsafe.reengage_after_restart_s": "FS_RESTART_HOLD",
    "helm.guided_speed_share": "HELM_GUIDED_SPD",
}
"""Names that the rule would break."""


class VesselParameter(NamedTuple):
    """One parameter: its name, the key it stands for (`control.pid.kp`), what is allowed, its meaning, and from when
    on a change counts.

    `choices` are the words that the whole numbers from 0 stand for, empty for plain numbers.
    """

    name: str
    path: str
    low: float | None
    high: float | None
    unit: str
    doc: str
    counts: Counts
    is_whole: bool = False
    choices: tuple[str, ...] = ()

    @property
    def group(self) -> str:
        """The title of the section that it belongs to."""
        return SECTIONS[self.path.rpartition(".")[0]][1]

    @property
    def allowed(self) -> str:
        """What may be set, in words."""
        if self.choices:
            return ", ".join(f"{number} ({word})" for number, word in enumerate(self.choices))
        low, high = (None if bound is None else f"{bound:g}" for bound in (self.low, self.high))
        if low and high:
            return f"{low} to {high} {self.unit}".rstrip()
        return f"at least {low} {self.unit}".rstrip() if low else "any number"


def parameters_of(vessel: Vessel) -> list[VesselParameter]:
    """Return the parameters of a vessel: all that it has a value for; what is null in its file is not among them."""
    return list(_of_section(vessel, ""))


def value_of(vessel: Vessel, parameter: VesselParameter) -> float:
    """Return the value of a parameter as the 32-bit float that travels."""
    value: Any = vessel
    for key in parameter.path.split("."):
        value = getattr(value, key)
    number = parameter.choices.index(value) if parameter.choices and not isinstance(value, bool) else value
    return _single(float(number))


def with_value(vessel: Vessel, parameter: VesselParameter, value: float) -> Vessel:
    """Return the vessel with a parameter set; ValueError with one sentence where that is not allowed.

    A value is taken with the fewest digits that give its 32-bit float, so that a file gets 0.7, not 0.69999998807.
    """
    if not math.isfinite(value) or not _is_allowed(parameter, value):
        raise ValueError(f"{parameter.name} is {value:.7g}, allowed: {parameter.allowed}.")
    section, _, key = parameter.path.rpartition(".")
    changed: Any = _replaced(vessel, section.split("."), key, _typed(parameter, value))
    for _, sentence in problems(changed):
        raise ValueError(sentence)
    return typing.cast(Vessel, changed)


def _is_allowed(parameter: VesselParameter, value: float) -> bool:
    if (parameter.is_whole or parameter.choices) and value != int(value):
        return False
    low, high = (None if bound is None else _single(bound) for bound in (parameter.low, parameter.high))
    return (low is None or _single(value) >= low) and (high is None or _single(value) <= high)


def _typed(parameter: VesselParameter, value: float) -> bool | int | float | str:
    if parameter.choices == ("false", "true"):
        return bool(value)
    if parameter.choices:
        return parameter.choices[int(value)]
    if parameter.is_whole:
        return int(value)
    near = _shortest(value)
    low, high = parameter.low, parameter.high
    return min(max(near, -math.inf if low is None else low), math.inf if high is None else high)


def _shortest(value: float) -> float:
    wanted = _single(value)
    return next(near for digits in (6, 7, 8, 9) if _single(near := float(f"{wanted:.{digits}g}")) == wanted)


def _single(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def _replaced(section: Any, keys: list[str], key: str, value: Any) -> Any:
    if not keys:
        return dataclasses.replace(section, **{key: value})
    inner = _replaced(getattr(section, keys[0]), keys[1:], key, value)
    return dataclasses.replace(section, **{keys[0]: inner})


def _of_section(section: Any, path: str) -> typing.Iterator[VesselParameter]:
    hints = hints_of(type(section))
    for key, counts in counts_of(type(section)).items():
        value, where = getattr(section, key), f"{path}.{key}" if path else key
        if value is None:
            continue
        if counts is None:
            if where in SECTIONS:
                yield from _of_section(value, where)
        elif path in SECTIONS:
            yield from _of_field(path, key, hints[key], counts)


def _of_field(path: str, key: str, hint: Any, counts: Counts) -> typing.Iterator[VesselParameter]:
    kind, bounds = _kind_and_bounds(hint)
    where = f"{path}.{key}"
    name, unit = _name(path, key), _unit(key)
    low, high, doc, _ = bounds or Bounds(None, None, key.replace("_", " "))
    words: tuple[str, ...] = ("false", "true") if kind is bool else ()
    if typing.get_origin(kind) is Literal:
        words = tuple(str(word) for word in typing.get_args(kind))
    if words:
        yield VesselParameter(name, where, 0.0, len(words) - 1.0, "", doc, counts, choices=words)
    elif kind in (int, float):
        yield VesselParameter(name, where, low, high, unit, doc, counts, is_whole=kind is int)


def _kind_and_bounds(hint: Any) -> tuple[Any, Bounds | None]:
    if typing.get_origin(hint) in (Union, types.UnionType):
        hint = next(member for member in typing.get_args(hint) if member is not type(None))
    if typing.get_origin(hint) is typing.Annotated:
        kind, *extras = typing.get_args(hint)
        return kind, next((extra for extra in extras if isinstance(extra, Bounds)), None)
    return hint, None


def _suffix(key: str) -> str:
    found = [suffix for suffix in UNIT_SUFFIXES if key.casefold().endswith(suffix) and len(key) > len(suffix)]
    return max(found, key=len, default="")


def _name(path: str, key: str) -> str:
    if chosen := NAMES.get(f"{path}.{key}"):
        return chosen
    words = key.removesuffix(key[len(key) - len(_suffix(key)) :] or "\0").upper().split("_")
    name = "_".join([SECTIONS[path][0], *words])
    if len(name) > NAME_LENGTH_MAX:
        name = "_".join([SECTIONS[path][0], *(word[:4] for word in words)])
    return name[:NAME_LENGTH_MAX]


def _unit(key: str) -> str:
    top, _, bottom = _suffix(key).removeprefix("_").partition("_")
    return f"{top}/{bottom.replace('_', ' ')}" if bottom else top


Section = TypeVar("Section")


class Vessels(NamedTuple):
    """`running`: what pilot and links work with; `stored`: what the next start reads.

    They are alike in every field that counts NOW.
    """

    running: Vessel
    stored: Vessel

    def storing(self, stored: Vessel) -> Vessels:
        """Return both with `stored` for the next start; what of it counts at once runs."""
        return Vessels(_running(self.running, stored), stored)

    @property
    def waiting(self) -> tuple[str, ...]:
        """The keys (`control.rate_hz`) that are stored otherwise than they run: they wait for a restart."""
        return tuple(_differing(self.running, self.stored, ""))


def counts_of(section: type[Any]) -> Mapping[str, Counts | None]:
    """Return from when on a change of each field of a section counts; None: it is a section, whose own fields say."""
    hints = hints_of(section)
    return {field.name: _counts(hints[field.name]) for field in dataclasses.fields(section)}


def _counts(hint: Any) -> Counts | None:
    """Return the mark in a type hint, be it that of an optional value's."""
    members = typing.get_args(hint)
    return next((each for each in members if isinstance(each, Counts)), None) or next(
        (found for each in members if typing.get_origin(each) is typing.Annotated and (found := _counts(each))), None
    )


def _running(running: Section, stored: Section) -> Section:
    """Return `running` with what of `stored` counts at once; an optional section comes and goes at once."""
    if running == stored or running is None or stored is None:
        return stored
    values: dict[str, Any] = {}
    for name, counts in counts_of(type(running)).items():
        runs, is_stored = getattr(running, name), getattr(stored, name)
        if counts is None:
            values[name] = _running(runs, is_stored)
        else:
            values[name] = is_stored if counts is NOW else runs
    return dataclasses.replace(running, **values)  # type: ignore[type-var]


def _differing(running: Any, stored: Any, path: str) -> Iterator[str]:
    for name, counts in counts_of(type(running)).items():
        runs, is_stored = getattr(running, name), getattr(stored, name)
        if runs == is_stored:
            continue
        if counts is None and runs is not None and is_stored is not None:
            yield from _differing(runs, is_stored, f"{path}{name}.")
        else:
            yield f"{path}{name}"
