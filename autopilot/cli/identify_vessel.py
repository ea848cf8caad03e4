"""The identified model as a vessel file: a new one for the boat of the recordings, or the model of one that exists.

A trial shows how the boat answers, not where its rudder stops or what a full pulse means. That comes from the file
that exists, from --vessel, from the vessel file inside our own logs, or from an option; the trial's amplitude never
stands in for it.
"""

from __future__ import annotations

import dataclasses
import datetime
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from autopilot.errors import InputError, RefusedError
from autopilot.files.saving import save_text
from autopilot.identification.identified import Identified
from autopilot.identification.interval import SURE_OF_IT
from autopilot.identification.likelihood_record import instruments
from autopilot.identification.model_choice import filed_model, ridge_model
from autopilot.identification.rudder_path import RudderRate, rate_sentence
from autopilot.identification.runs import Run
from autopilot.identification.verdict import backlash_of
from autopilot.report.identification import Result, undetermined
from autopilot.vessel.file import doubted, load_vessel, model_section, recorded_vessel, rounded, text_for
from autopilot.vessel.schema import SCHEMA_VERSION, Alarms, Control, Drive, Model, Rudder, Sensors, Vessel

ASSUMED_RATE_DEG_S = 10.0
"""Rudder rate written where the recordings cannot show it: slow for a small boat, so gains err to the safe side."""
LEAST_NOISE_DEG, LEAST_RATE_NOISE_DEG_S = 0.05, 0.02
"""No heading and no rate aboard is better than this, whatever a quiet recording of them shows."""
LEAST_PLAY, MOST_PLAY_DEG = math.radians(0.25), 20.0
"""Less play, or less of a zero [rad], passes for a sensor's noise; no file holds more."""
LATE_S = 0.05
"""Less is no matter to gains."""
RATE_DISAGREES = 0.15
"""A measured rate off the file's by more than this share, and by three standard errors, is worth a sentence."""


class NoGainsError(InputError):
    """No gains can be designed for the model, and its file is not written; why: with what to sail next."""

    def __init__(self, why: str, path: str) -> None:
        super().__init__(f"{path} is not written, for {why}")
        self.why = why


class Given(NamedTuple):
    """What the command line says of the steering gear.

    vessel: the file named by --vessel. end_stop_deg: the rudder's end stop. full_deg: the rudder's angle at full
    steering, negative where the servo turns the other way.
    """

    vessel: Vessel | None = None
    end_stop_deg: float | None = None
    full_deg: float | None = None


def boat_for(path: str, runs: Sequence[Run], given: Given) -> Vessel | None:
    """Return the vessel whose model is to be exchanged; None where a new one is made of what is given.

    Raises InputError where `path` cannot be read, or where nothing says where the rudder's end stops are: before the
    identification, not after it.
    """
    if Path(path).exists():
        return load_vessel(path)
    if given.vessel is not None:
        return _for_new_model(given.vessel, path)
    if (recorded := recorded_vessel(runs)) is not None:
        return _for_new_model(recorded, path)
    if given.end_stop_deg is None and given.full_deg is None:
        raise InputError(
            f"{path}: a new vessel file needs the rudder's end stop, which no recording shows; give "
            "--rudder-max-deg DEG, or --vessel FILE with the boat's rudder section."
        )
    return None


def _for_new_model(vessel: Vessel, path: str) -> Vessel:
    """Return what stays of a boat's file for a model of its own: all but the name and the gains of the old model."""
    loop = vessel.control
    kept = ("rate_hz", "loop_delay_s", "path_delay_s", "steerage_m_s")
    control = Control(**{name: getattr(loop, name) for name in kept})
    # off in `trial --unidentified`, where the model was a guess
    limits = Alarms(**{**vars(vessel.alarms), "reversed_rudder": True})
    return dataclasses.replace(vessel, name=Path(path).stem, description="", control=control, alarms=limits)


def write_vessel(path: str, result: Result, boat: Vessel | None, given: Given) -> list[str]:
    """Write the model into the vessel file at `path`; return what the skipper should know of the rudder, as sentences.

    Everything else of `boat` is kept, an existing file's comments too; the rudder angle that full steering means is
    written out, so that nobody who edits the end stop changes the scale. Raises NoGainsError where no gains serve the
    model, and InputError where K or T is not determined, where no command could read the file, or where it cannot be
    written.
    """
    ratios = result.found.ratios
    on_ridge = ratios is not None and ratios.on_ridge
    if (unknown := undetermined(result.found)) and not on_ridge:
        raise InputError(f"{path} is not written, for it needs K and T: {result.found.unidentifiable[unknown[0]]}")
    runs = [run for run, role, _ in result.predictions if role == "fit"]
    rate = result.rudder_rate
    fresh = boat is None
    if boat is None:
        boat = Vessel(SCHEMA_VERSION, Path(path).stem, _model(result, runs), _new_rudder(runs, given, rate))
        boat = dataclasses.replace(boat, sensors=measured_sensors(runs))
        train = result.found.train
        moved = dataclasses.replace(boat.rudder, delay_s=rounded(train.delay), lag_s=rounded(train.lag))
        boat = dataclasses.replace(boat, rudder=moved)
    elif rate is not None and rate.by_turning:
        # the model is that of a boat with this rudder
        boat = dataclasses.replace(
            boat, rudder=dataclasses.replace(boat.rudder, rate_max_deg_s=_rate_deg_s(rate), rate_port_deg_s=None)
        )
    play_deg, play_remarks = _play(path, runs, boat.rudder.play_deg, math.degrees(result.found.train.dead_band))
    boat = dataclasses.replace(boat, rudder=dataclasses.replace(boat.rudder, play_deg=play_deg))
    vessel = _with_scale(dataclasses.replace(boat, model=_model(result, runs)), given)
    vessel, path_remarks = with_path(path, vessel, runs)
    text = text_for(path, vessel)
    _check_steering(path, vessel, result.found)
    save_text(path, text)
    remarks = [*_not_kept(path, result.found), *doubted(path, vessel)]
    if on_ridge:
        remarks.append(
            f"{path} holds n1 {vessel.model.n1:+g} with T {vessel.model.T_s:.3g} s, of which the runs know little, and "
            "K as it is at that T; its gains serve at both ends of what they leave open."
        )
    return [
        *remarks,
        *play_remarks,
        *path_remarks,
        *([] if fresh else _compass_remarks(runs, vessel)),
        *([] if fresh else [*_train_remarks(path, result, vessel), *_rudder_remarks(path, runs, vessel, rate)]),
    ]


def measured_sensors(runs: Sequence[Run]) -> Sensors:
    """Return the noise of the instruments as the recordings show it; what they do not show is as usual."""
    segments = [segment for run in runs for segment in run.segments]
    rate, heading = instruments(segments)
    usual, found = Sensors(), dict[str, float]()
    # where nothing was measured the noise is 1 rad
    if math.degrees(heading) < 30.0:
        found["heading_noise_deg"] = rounded(max(math.degrees(heading), LEAST_NOISE_DEG))
    if math.degrees(rate) < 30.0:
        found["rate_noise_deg_s"] = rounded(max(math.degrees(rate), LEAST_RATE_NOISE_DEG_S))
    if not found:
        return usual
    gyro = any(math.isfinite(rate) for segment in segments for rate in segment.rate)
    found["heading_latency_s"] = compass_late_s(runs)
    source = "noise measured, second differences of the recordings"
    return dataclasses.replace(usual, **found, gyro=gyro, source=source, date=datetime.date.today().isoformat())  # type: ignore[arg-type]


def compass_late_s(runs: Sequence[Run]) -> float:
    """Return by how much [s] the compass of the runs was later than the gyro, on average; 0 where the gyro was."""
    return round(max(sum(run.compass_late for run in runs) / len(runs), 0.0), 3)


def _check_steering(path: str, vessel: Vessel, found: Identified) -> None:
    """Raise NoGainsError, with what to sail next, where no gains can be designed for the model; where course stability
    is not determined, for those at either end of its interval either, or where its own gains do not hold these."""
    from autopilot.cli.terminal import ProgressBar
    from autopilot.report.gains import bearing_level
    from autopilot.runtime.tuning import GainRequest, designed, holds

    ends: list[Vessel] = []
    if found.ratios is not None and found.ratios.on_ridge and found.likely is not None:
        (_, b, _, _), (_, error, _, _) = found.ratios
        for rate in (b - SURE_OF_IT * error, b + SURE_OF_IT * error):
            end = ridge_model(found.ratios, found.likely.covariance, found.model.reference_speed, rate)
            ends.append(dataclasses.replace(vessel, model=model_section(*end, vessel.model.source, vessel.model.date)))
    # what needs no simulation first, and the boat that is lost soonest
    boats = sorted((vessel, *ends), key=lambda boat: boat.model.n1 / boat.model.T_s)
    try:
        better = [designed(boat) for boat in boats]
        if not all(holds(better[boats.index(vessel)], end) for end in ends):
            raise RefusedError("gains that suit it do not hold it stable and unstable alike")
        with ProgressBar("trying turns") as bar:
            for done, each in enumerate(better):
                bar.update(done, len(better))
                # `autopilot gains` would refuse it for its turns
                if each.model.n1 <= 0.0 and bearing_level(each, GainRequest().level) is None:
                    raise RefusedError("a turn with a rudder 30 % weaker than the model's is lost at every level")
    except RefusedError as error:
        raise NoGainsError(
            f"no gains serve such a boat: {error}; sail a 20/20 zigzag of six reversals or more, and check the "
            "rudder's rate.",
            path,
        ) from None


def _compass_remarks(runs: Sequence[Run], vessel: Vessel) -> list[str]:
    late, filed = compass_late_s(runs), vessel.sensors.heading_latency_s
    if late < LATE_S:
        return []
    return [
        f"The compass of these runs is {late:.2g} s later than the gyro, and sensors.heading_latency_s stays "
        f"{filed:g}: a pilot that records its own headings has taken that off already; add the rest if it steers by "
        "this compass."
    ]


def _play(path: str, runs: Sequence[Run], filed_deg: float, fitted_deg: float) -> tuple[float, list[str]]:
    """Return the play to either side [deg] from order to water, and what is to be said of it and of the sensor's zero.

    fitted_deg: between the recorded rudder and the boat. A measured rudder has what lies between order and sensor
    before it; an ordered one has been through the file's gear.
    """
    if not any(run.rudder == "measured" for run in runs):
        play_deg, said = filed_deg + fitted_deg, []
    else:
        shown = backlash_of([run.orders for run in runs if run.orders is not None])
        sensed_deg, said = 0.0, list[str]()
        if shown is not None and shown.play > max(SURE_OF_IT * shown.play_error, LEAST_PLAY):
            sensed_deg = math.degrees(shown.play)
        if shown is not None and abs(shown.zero) > max(SURE_OF_IT * shown.zero_error, LEAST_PLAY):
            said = [
                f"The rudder's sensor shows {math.degrees(shown.zero):+.2g} +- "
                f"{math.degrees(SURE_OF_IT * shown.zero_error):.1g} deg where 0 is ordered: set one of them right."
            ]
        play_deg = sensed_deg + fitted_deg or filed_deg
    play_deg = min(round(play_deg, 2), MOST_PLAY_DEG)
    if play_deg == filed_deg:
        return filed_deg, said
    return play_deg, [
        *said,
        f"rudder.play_deg of {path} is {play_deg:g} now, to either side: it is reckoned with, and better taken out of "
        "the steering gear.",
    ]


def with_path(path: str, vessel: Vessel, runs: Sequence[Run]) -> tuple[Vessel, list[str]]:
    """Return the vessel with how late orders came to the rudder, where logs of ours show it, and what is to be said of
    it. Of several logs the latest."""
    known = [run.late for run in runs if math.isfinite(run.late)]
    if not known:
        return vessel, []
    delay = round(known[-1], 2)
    control = dataclasses.replace(vessel.control, path_delay_s=delay)
    said = f"Orders came to the rudder {delay:g} s after their headings: control.path_delay_s of {path}, of which"
    return dataclasses.replace(vessel, control=control), [
        f"{said} control.loop_delay_s expects {control.loop_delay_s:g} s."
    ]


def _not_kept(path: str, found: Identified) -> list[str]:
    """Return what was fitted and has no place in a vessel file."""
    around = found.around
    if around is None:
        return []
    kept = {"the propeller's race": around.race or around.steady_race, "wind": around.wind_beam or around.wind_quarter}
    names = " and ".join(name for name, value in kept.items() if value)
    return [f"{path} does not keep {names}: it has no place for it, and gains do not know it."] if names else []


def _train_remarks(path: str, result: Result, vessel: Vessel) -> list[str]:
    """Return what delay and lag say that were found beside those of the file, whose gear the orders had passed."""
    found = result.found
    late = found.train.delay + found.train.lag
    doubt = math.hypot(*(found.standard_errors.get(name) or 0.0 for name in ("delay", "lag")))
    if late < LATE_S or late < SURE_OF_IT * doubt:
        return []
    filed = vessel.rudder.delay_s + vessel.rudder.lag_s
    return [
        f"The boat follows its rudder {late:.2g} s later than the {filed:.2g} s of rudder.delay_s and rudder.lag_s in "
        f"{path} explain: look over them."
    ]


def _with_scale(vessel: Vessel, given: Given) -> Vessel:
    """Return the vessel with the servo's scale written out, so that it no longer follows the end stop."""
    helm, drive, stop_deg = vessel.helm, vessel.drive, vessel.rudder.angle_max_deg
    if given.full_deg is not None:
        scale_deg, is_reversed = abs(given.full_deg), given.full_deg < 0.0
        helm = dataclasses.replace(helm, rudder_at_full_pwm_deg=scale_deg, reversed=is_reversed)
    elif helm.rudder_at_full_pwm_deg is None:
        helm = dataclasses.replace(helm, rudder_at_full_pwm_deg=stop_deg)
    has_line = dataclasses.replace(drive, kind="rudder", thrust_exponent=None, astern_share=None) != Drive()
    if has_line and drive.angle_at_full_deg is None:
        drive = dataclasses.replace(drive, angle_at_full_deg=stop_deg)
    return dataclasses.replace(vessel, helm=helm, drive=drive)


def _model(result: Result, runs: list[Run]) -> Model:
    log, today = tuple(Path(run.source).name for run in runs), datetime.date.today().isoformat()
    return model_section(*filed_model(result.found), "identified", today, log)


def _new_rudder(runs: list[Run], given: Given, rate: RudderRate | None) -> Rudder:
    """Return the rudder of a boat without a file: its end stop as given, its rate as measured, or assumed and said."""
    stop_deg = given.end_stop_deg if given.end_stop_deg is not None else abs(given.full_deg or 0.0)
    seen_deg = max(_reach_deg(run) for run in runs)
    if seen_deg > 1.1 * stop_deg + 1.0:
        raise InputError(
            f"--rudder-max-deg {stop_deg:g}: the recordings have the rudder at {seen_deg:.0f} deg; give its end stop."
        )
    if rate is None:
        source = (
            f"end stop as given; the rate of {ASSUMED_RATE_DEG_S:g} deg/s is assumed, for no sensor shows the rudder "
            "moving: measure it before you trust the gains"
        )
        return Rudder(stop_deg, ASSUMED_RATE_DEG_S, source=source)
    return Rudder(stop_deg, _rate_deg_s(rate), source=f"end stop as given; rate measured, {rate_sentence(rate)}")


def _rate_deg_s(rate: RudderRate) -> float:
    return min(max(round(math.degrees(rate.rate), 2), 0.1), 1000.0)


def _reach_deg(run: Run) -> float:
    return math.degrees(max(float(abs(segment.rudder).max()) for segment in run.segments))


def _rudder_remarks(path: str, runs: list[Run], vessel: Vessel, rate: RudderRate | None) -> list[str]:
    """Return where the recordings contradict the rudder section that was kept."""
    rudder, remarks = vessel.rudder, []
    seen_deg = max(_reach_deg(run) for run in runs)
    if seen_deg > 1.1 * rudder.angle_max_deg + 1.0:
        remarks.append(
            f"The rudder was at {seen_deg:.0f} deg, and rudder.angle_max_deg of {path} is {rudder.angle_max_deg:g}: "
            "look at the scale of the rudder or its sensor."
        )
    if rate is not None and rate.by_turning:
        remarks.append(f"rudder.rate_max_deg_s of {path} is {_rate_deg_s(rate):g} now: {rate_sentence(rate)}.")
    elif rate is not None:
        filed = math.inf if rudder.rate_max_deg_s is None else math.radians(rudder.rate_max_deg_s)
        off = abs(rate.rate - filed)
        if off > RATE_DISAGREES * min(filed, rate.rate) and off > 3.0 * rate.standard_error:
            remarks.append(
                f"The rudder moved at {rate_sentence(rate)}, and rudder.rate_max_deg_s of {path} is "
                f"{'unlimited' if math.isinf(filed) else f'{rudder.rate_max_deg_s:g}'}: if it was asked to move as "
                "quickly as it can, put the measured rate into the file before you design gains."
            )
    return remarks
