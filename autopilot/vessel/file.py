"""Vessel files: found by path or shipped name, read strictly, checked across fields, written back, edited in place.

In a file that is edited, comments, order and everything else stay as they were. This needs ruamel.yaml (the extra
`edit`). Where a file is exactly what Norrbin writes, nothing would be lost, and it is simply written anew.

The real and published boats among the shipped files say what is expected of a boat before it has sailed.
"""

from __future__ import annotations

import dataclasses
import importlib
import io
import math
import re
import typing
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from functools import cache
from ipaddress import ip_network
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from autopilot.control.registry import LAWS
from autopilot.errors import InputError, SeveralInputError
from autopilot.files import typed
from autopilot.files.strict_yaml import Node, check_version, parse_document, plain, resolve_plain, text_of
from autopilot.files.typed import Bounds, Shipped, hints_of
from autopilot.models.drives import DRIVES, Needs
from autopilot.models.norrbin import Norrbin, folds
from autopilot.vessel.schema import SCHEMA_VERSION, Model, StandardErrors, Vessel, model_of

if TYPE_CHECKING:
    from autopilot.identification.boat_prior import BoatPrior, KnownBoat
    from autopilot.identification.runs import Run

VESSELS = Shipped("firmware_params", "vessels", "shipped")

_BARE_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")


def load_vessel(path_or_name: str | Path) -> Vessel:
    """Return the vessel of a YAML file, or of the shipped file of that name (`lanxin`).

    Anything with a folder or a suffix in it is a path, and so is what exists. Raises InputError.
    """
    return vessel_from(vessel_document(path_or_name))


def vessel_document(path_or_name: str | Path, also_shipped: tuple[str, ...] = ()) -> Node:
    """Return the root node of a file, or of the shipped vessel of that name. Raises InputError.

    `also_shipped` are names that the sentence about an unknown name offers too.
    """
    return VESSELS.document(path_or_name, also_shipped)


def refuse_bare_name(out: str | Path) -> None:
    """Raise InputError where a vessel file would be written under the mere name by which a shipped one is called."""
    path = Path(out)
    if path.suffix not in (".yaml", ".yml") and path.name == str(out):
        raise InputError(
            f"{out}: a mere name is that of a shipped vessel; write {path.stem}.yaml, or ./{out} for a file without "
            "the suffix"
        )


def parse_vessel(text: str, file: str = "<text>") -> Vessel:
    """Return the vessel described by YAML `text`; `file` is the name used in messages. Raises InputError."""
    return vessel_from(parse_document(text, file))


def recorded_vessel(runs: Iterable[Run]) -> Vessel | None:
    """Return the boat of the first run whose log holds the file of the pilot that wrote it; None where none does."""
    run = next((run for run in runs if run.vessel), None)
    return None if run is None else parse_vessel(run.vessel, f"{run.source} (header)")


def shipped_vessels() -> list[str]:
    """Return the names of the vessel files that come with the product."""
    return VESSELS.names()


def vessel_from(root: Node) -> Vessel:
    """Return the vessel that a document holds, checked across its fields. Raises InputError."""
    check_version(root, SCHEMA_VERSION, "vessel file")
    vessel = typed.read(root, Vessel)
    faults = [root.at(*path.split(".")).fault(sentence) for path, sentence in problems(vessel)]
    if faults:
        raise faults[0] if len(faults) == 1 else SeveralInputError(faults)
    return vessel


def problems(vessel: Vessel) -> Iterator[tuple[str, str]]:
    """Yield (path of the key, sentence) for every value that fits its own range but not the others."""
    if not vessel.name.strip():
        yield "name", "name is empty; give the boat a name."
    yield from _model_problems(vessel)
    yield from _limit_problems(vessel)
    yield from _thruster_problems(vessel)
    if LAWS[vessel.control.law].takes_roll and vessel.control.roll is not None:
        yield (
            "control.roll",
            f"control.roll stands beside control.law {vessel.control.law}, which damps roll itself; leave one of them "
            "out.",
        )
    if vessel.failsafe.heading_timeout_s <= vessel.sensors.heading_latency_s:
        yield (
            "failsafe.heading_timeout_s",
            f"failsafe.heading_timeout_s is {vessel.failsafe.heading_timeout_s:g}, it must be larger than "
            f"sensors.heading_latency_s ({vessel.sensors.heading_latency_s:g}), or every heading is stale on arrival.",
        )
    pulses = vessel.helm.servo_us
    if pulses is not None and not pulses[0] < pulses[1] < pulses[2]:
        yield (
            "helm.servo_us",
            f"helm.servo_us is [{pulses[0]:g}, {pulses[1]:g}, {pulses[2]:g}]; the three pulses must rise, such as "
            "[1000, 1500, 2000]; a servo that is mounted the other way round is set so at the flight controller "
            "(SERVOn_REVERSED).",
        )
    yield from _deviation_problems(vessel.sensors.deviation_deg)
    yield from _address_problems(vessel.security.allow_addresses)
    for pattern, stale_s in vessel.sensors.priority:
        if not pattern.strip() or not 0.1 <= stale_s <= 60.0:
            yield (
                "sensors.priority",
                f"sensors.priority has [{pattern}, {stale_s:g}]; needed are the name of an instrument, "
                'such as HEHDT or "HC*", and the age from 0.1 to 60 s at which it is stale.',
            )


USUAL_BY_LENGTH = {"K'": (0.1, 30.0), "T'": (0.05, 60.0)}
"""K L/U and T U/L, which are alike for boats of all sizes: the boats of PUBLISHED have 1.1 to 4.5 and 0.3 to
5, and near course stability both grow together. A number in another unit (degrees, minutes) is far outside."""


def doubts(vessel: Vessel) -> Iterator[tuple[str, str]]:
    """Yield (path of the key, sentence) for every value that is allowed and that hardly any boat has."""
    yield from _unusual(vessel, ())
    if vessel.length_m is None:
        return
    model, seconds = vessel.model, vessel.length_m / vessel.model.reference_speed_m_s
    for path, symbol, value, share in (
        ("model.K_1_s", "K'", model.K_1_s, model.K_1_s * seconds),
        ("model.T_s", "T'", model.T_s, model.T_s / seconds),
    ):
        low, high = USUAL_BY_LENGTH[symbol]
        if not low <= share <= high:
            scale = value / share
            yield (
                path,
                f"{path} is {value:g}, usual for {vessel.length_m:g} m at {model.reference_speed_m_s:g} m/s are "
                f"{low * scale:.3g} to {high * scale:.3g} ({symbol} {low:g} to {high:g}): is it of this boat, and in "
                "this unit?",
            )


def doubted(path: str | Path, vessel: Vessel) -> list[str]:
    """Return what is to be doubted of `vessel`, as it was read from `path`: sentences with file, line and column."""
    found = list(doubts(vessel))
    if not found:
        return []
    root = vessel_document(path)
    return [f"{root.at(*key.split('.')).fault(sentence)}" for key, sentence in found]


def _unusual(section: Any, above: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    hints = hints_of(type(section))
    for field in dataclasses.fields(section):
        value, path = getattr(section, field.name), (*above, field.name)
        if dataclasses.is_dataclass(value):
            yield from _unusual(value, path)
        elif isinstance(value, float | int) and (bounds := _bounds(hints[field.name])) and bounds.usual:
            low, high = bounds.usual
            if not low <= value <= high:
                name = ".".join(path)
                yield (
                    name,
                    f"{name} is {value:g}, usual are {low:g} to {high:g} and allowed {bounds.low:g} to "
                    f"{bounds.high:g} ({bounds.doc}): is it of this boat, and in this unit?",
                )


def _address_problems(addresses: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    for text in addresses:
        try:
            ip_network(text)
        except ValueError as error:
            yield (
                "security.allow_addresses",
                f"security.allow_addresses has '{text}', which is no network ({error}); write 192.168.1.20 or "
                "10.0.0.0/24.",
            )


OF_THRUST = (
    "speed_exponent",
    "throttle_exponent",
    "damping_share",
    "reference_throttle",
    "way_exponent",
    "slowest_m_s",
    "fastest_m_s",
)
"""Keys of the model that have a say where thrust steers."""


def _model_problems(vessel: Vessel) -> Iterator[tuple[str, str]]:
    model = vessel.model
    for name in OF_THRUST if vessel.drive.kind == "rudder" else ():
        if getattr(model, name) is not None:
            yield (
                f"model.{name}",
                f"model.{name} has no say where drive.kind is rudder, for there K ~ U and T ~ 1/U; leave it out, or "
                "set drive.kind to what steers the boat.",
            )
    if model.n1 not in (-1.0, 1.0):
        yield "model.n1", f"model.n1 is {model.n1:g}, allowed are 1 (course-stable) and -1 (course-unstable)."
    if model.n1 == -1.0 and model.n3_s2_rad2 <= 0.0:
        yield (
            "model.n1",
            "model.n1 is -1 with model.n3_s2_rad2 0: a course-unstable boat needs n3 above 0, or its turns never end.",
        )
    if folds(Norrbin(1.0, 1.0, n3=model.n3_s2_rad2, n2=model.n2_s_rad, n1=model.n1)):
        least = model.n2_s_rad**2 / 3.0
        yield (
            "model.n2_s_rad",
            f"model.n2_s_rad is {model.n2_s_rad:g} with model.n3_s2_rad2 {model.n3_s2_rad2:g}: the boat would turn "
            f"without end to one side; n2 0, or n3 above n2^2/3 ({least:.3g}), is allowed.",
        )


def _thruster_problems(vessel: Vessel) -> Iterator[tuple[str, str]]:
    if vessel.drive.bow_thruster is None:
        return
    if vessel.helm.method != "rc_override":
        yield (
            "drive.bow_thruster",
            f"drive.bow_thruster needs helm.method rc_override, and it is {vessel.helm.method}: the channel that its "
            "output passes on is reached by RC_CHANNELS_OVERRIDE alone.",
        )
    if vessel.control.steerage_m_s is None and DRIVES[vessel.drive.kind].needs is Needs.WAY:
        yield (
            "control.steerage_m_s",
            "control.steerage_m_s is null, and drive.bow_thruster steers below it: give the speed in m/s below which "
            "the rudder does not turn the boat. A flight controller's speed over the ground counts for a number alone.",
        )
    if DRIVES[vessel.drive.kind].needs is Needs.NOTHING:
        yield (
            "drive.bow_thruster",
            f"drive.bow_thruster has no say where drive.kind is {vessel.drive.kind}, which turns the boat where it "
            "lies; leave it out.",
        )


def _limit_problems(vessel: Vessel) -> Iterator[tuple[str, str]]:
    limits, rudder, valves = vessel.limits, vessel.rudder, vessel.drive.valve
    if rudder.rate_max_deg_s is None and rudder.rate_port_deg_s is not None:
        yield (
            "rudder.rate_port_deg_s",
            "rudder.rate_port_deg_s is given and rudder.rate_max_deg_s, the rate to starboard, is null: give both.",
        )
    if valves is not None and valves.least_pulse_s <= valves.opening_s:
        yield (
            "drive.valve.least_pulse_s",
            f"drive.valve.least_pulse_s is {valves.least_pulse_s:g} and drive.valve.opening_s {valves.opening_s:g}: a "
            "pulse that is over before the rudder moves turns nothing; make it longer.",
        )
    if limits.angle_max_deg is not None and limits.angle_max_deg > rudder.angle_max_deg:
        yield (
            "limits.angle_max_deg",
            f"limits.angle_max_deg is {limits.angle_max_deg:g}, allowed is at most rudder.angle_max_deg "
            f"({rudder.angle_max_deg:g}).",
        )
    if limits.rate_max_deg_s is None or rudder.rate_max_deg_s is None:
        return
    if limits.rate_max_deg_s > rudder.rate_max_deg_s:
        yield (
            "limits.rate_max_deg_s",
            f"limits.rate_max_deg_s is {limits.rate_max_deg_s:g}, allowed is at most rudder.rate_max_deg_s "
            f"({rudder.rate_max_deg_s:g}).",
        )


def _deviation_problems(table: tuple[tuple[float, float], ...]) -> Iterator[tuple[str, str]]:
    previous = -1.0
    for heading, deviation in table:
        if not 0.0 <= heading < 360.0 or heading <= previous:
            yield (
                "sensors.deviation_deg",
                f"sensors.deviation_deg has the compass heading {heading:g} after {previous:g}; headings rise "
                "from 0 to below 360.",
            )
        if abs(deviation) > 90.0:
            yield (
                "sensors.deviation_deg",
                f"sensors.deviation_deg has a deviation of {deviation:g} at {heading:g}, allowed are -90 to 90.",
            )
        previous = heading


def dump_vessel(vessel: Vessel, comment: str = "") -> str:
    """Return the vessel as YAML text with the meaning of each number beside it; reading it gives `vessel` again.

    `comment` becomes the head of the file. Values that are absent (null by default) are left out.
    """
    head = [f"# {line}".rstrip() for line in comment.splitlines()]
    return "\n".join([*head, *_section_lines(vessel, 0)]) + "\n"


def _section_lines(section: Any, depth: int) -> list[str]:
    hints = hints_of(type(section))
    lines: list[str] = []
    for field in dataclasses.fields(section):
        value = getattr(section, field.name)
        start = f"{'  ' * depth}{field.name}:"
        if dataclasses.is_dataclass(value):
            inner = _section_lines(value, depth + 1)
            lines += [start, *inner] if inner else []
        elif value != field.default or value not in (None, "", ()):
            bounds = _bounds(hints[field.name])
            lines.append(f"{start} {_value_text(value)}{f'  # {bounds.doc}' if bounds else ''}")
    return lines


def _bounds(hint: Any) -> Bounds | None:
    if typing.get_origin(hint) is typing.Annotated:
        return next((extra for extra in typing.get_args(hint) if isinstance(extra, Bounds)), None)
    return next((found for member in typing.get_args(hint) if (found := _bounds(member))), None)


def _value_text(value: Any) -> str:
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return number_text(value)
    if isinstance(value, tuple):
        return f"[{', '.join(_value_text(item) for item in value)}]"
    if isinstance(value, str):
        return string_text(value)
    return str(value)


def number_text(value: float) -> str:
    """Return the shortest text that reads back as `value`, with a point where YAML 1.1 readers need one."""
    text = repr(value)
    mantissa, exponent, power = text.partition("e")
    return f"{mantissa}.0e{power}" if exponent and "." not in mantissa else text


def string_text(value: str) -> str:
    """Return `value` as a bare word where that is safe, else in double quotes on one line."""
    if _BARE_WORD.fullmatch(value) and isinstance(resolve_plain(value), str):
        return value
    return yaml.safe_dump(value, default_style='"', allow_unicode=True, width=10**9).removesuffix("\n")


def rounded(value: float) -> float:
    """Return `value` as a vessel file states it: six digits."""
    return float(f"{value:.6g}")


def model_section(
    model: Norrbin, errors: Mapping[str, float | None], source: str, date: str, log: tuple[str, ...] = ()
) -> Model:
    """Return the section of an identified model; standard `errors` by the model's own names, None: not determined."""
    found = (errors.get(name) for name in ("gain", "time_constant", "n3", "n0"))
    return Model(
        K_1_s=rounded(model.gain),
        T_s=rounded(model.time_constant),
        reference_speed_m_s=rounded(model.reference_speed),
        n1=model.n1,
        n2_s_rad=rounded(model.n2),
        n3_s2_rad2=rounded(model.n3),
        n0_rad_s=rounded(model.n0),
        standard_errors=StandardErrors(*(None if each is None else float(f"{each:.3g}") for each in found)),
        source=source,
        date=date,
        log=log,
    )


NULL_TAG = "tag:yaml.org,2002:null"
EXTRA = "pip install '.[edit]'"


def updated_vessel_text(text: str, vessel: Vessel, file: str) -> str:
    """Return the vessel file `text` with the values of `vessel`; comments and order stay.

    A file whose only comments are those that Norrbin writes beside its values is written anew. Raises InputError where
    the text cannot be read, or where it has comments of its own and ruamel.yaml is not installed.
    """
    before = parse_vessel(text, file)
    if not _comments(text) - _comments(dump_vessel(before)):
        return dump_vessel(vessel)
    old, new = (plain(parse_document(dump_vessel(each))) for each in (before, vessel))
    return _checked(edited_text(text, old, new, file), vessel, file)


def text_for(path: str | Path, vessel: Vessel, *, in_place: bool = True) -> str:
    """Return the text with which the file at `path` holds `vessel`; of one that is there and is written `in_place`
    comments and order stay. Raises InputError where no command could read it."""
    place = Path(path)
    before = text_of(place) if in_place and place.is_file() else ""
    text = updated_vessel_text(before, vessel, str(path)) if before else dump_vessel(vessel)
    try:
        parse_vessel(text, str(path))
    except InputError as error:
        raise InputError(f"{path} is not written, for no command could read it: {error}") from None
    return text


def _comments(text: str) -> Counter[str]:
    """Return what stands behind a # on each line: comments, and at worst some quoted text, which is kept as well."""
    return Counter(line.partition("#")[2].strip() for line in text.splitlines() if "#" in line)


def _checked(text: str, vessel: Vessel, file: str) -> str:
    if parse_vessel(text, file) != vessel:
        raise InputError(
            f"{file}: cannot be changed in place without losing something; give another name for the result."
        )
    return text


def edited_text(text: str, old: Mapping[str, Any], new: Mapping[str, Any], file: str) -> str:
    """Return `text` with every value changed that differs between `old` and `new`. Raises InputError."""
    if old == new:
        return text
    try:
        ruamel = importlib.import_module("ruamel.yaml")
    except ModuleNotFoundError:
        raise InputError(
            f"{file}: has comments of its own, and keeping them needs ruamel.yaml; install it with "
            f"{EXTRA}, or give another name for the result."
        ) from None
    yaml = ruamel.YAML()  # round trip
    yaml.preserve_quotes = True
    yaml.width = 10**6
    # a null that was written out is not left out
    yaml.representer.add_representer(type(None), lambda dumper, _: dumper.represent_scalar(NULL_TAG, "null"))
    document = yaml.load(text)
    _apply(document, old, new)
    result = io.StringIO()
    yaml.dump(document, result)
    return result.getvalue()


def _apply(document: Any, old: Mapping[str, Any], new: Mapping[str, Any]) -> None:
    for key, value in new.items():
        before = old.get(key)
        if isinstance(value, dict) and isinstance(before, dict) and key in document:
            _apply(document[key], before, value)
        elif key not in old or before != value:
            document[key] = value
    for key in old:
        if key not in new and key in document:
            del document[key]


PUBLISHED = (
    "container_ship",
    "esso_osaka",
    "esso_tanker",
    "frigate",
    "mariner",
    "mmg_tanker",
    "naval_vessel",
    "small_craft",
    "twin_thruster",
    "zeefakkel",
)
"""Lanxin is none of them, for nothing that is published here says how long it is; the outboard is a construction of the
simulator, and roll_ship is naval_vessel once more."""


def published_boats() -> tuple[KnownBoat, ...]:
    """Return the boats by name, each with its length and model."""
    return tuple(_known(name) for name in PUBLISHED)


def boats_prior(length: float, without: Collection[str] = ()) -> BoatPrior:
    """Return what the published boats say of one of `length` [m]; those called `without`, by file or by name, are left
    out, so that no boat is its own witness."""
    from autopilot.identification.boat_prior import prior_of

    titles = {name: load_vessel(name).name for name in PUBLISHED}
    boats = [boat for boat in published_boats() if not {boat.name, titles[boat.name]} & set(without)]
    return prior_of(boats, length)


def first_model(length: float, speed: float) -> Model:
    """Return what the published boats let expect of one of `length` [m] at `speed` [m/s]: good enough to sail a zigzag
    by, and to no other end."""
    expected = boats_prior(length).at(speed)
    a, b, d = math.exp(expected.mean[0]), float(expected.mean[1]), math.exp(expected.mean[2])
    time_constant = 1.0 / abs(b)
    return Model(
        K_1_s=rounded(a * time_constant),
        T_s=rounded(time_constant),
        n1=math.copysign(1.0, b),
        n3_s2_rad2=rounded(d * time_constant),
        reference_speed_m_s=rounded(speed),
        source=f"expected of a boat of {length:g} m by {expected.boats} published ones: a guess to sail the zigzag by",
    )


@cache
def _known(name: str) -> KnownBoat:
    from autopilot.identification.boat_prior import KnownBoat

    vessel = load_vessel(name)
    assert vessel.length_m is not None, name
    errors = vessel.model.standard_errors
    return KnownBoat(name, vessel.length_m, model_of(vessel), errors.n3_s2_rad2 or 0.0)
