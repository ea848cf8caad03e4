"""One run, wired: links, pilot, log, and who moves the order. The only place where they are put together."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TextIO

from autopilot import __version__
from autopilot.angles import compass_text
from autopilot.errors import InputError
from autopilot.estimation.tuning import PATH_LATER
from autopilot.files.saving import BackgroundSaver, check_folder
from autopilot.links.alarm_outputs import Acknowledgements
from autopilot.links.base import GuideAlarms, Link, close_all
from autopilot.runtime.build import build_pilot, track_settings_of, wind_settings_of
from autopilot.runtime.build_links import (
    LinkOptions,
    Stations,
    alarm_outputs_of,
    build_links,
    build_station_links,
    refuse_failsafe,
    shared_by_links,
    variation_of,
)
from autopilot.runtime.machine import Clock, LoopHealth, Note, PathNote, RealTime, RestartState, ServiceHooks
from autopilot.runtime.session import Orders, Session
from autopilot.signals import Tick
from autopilot.vessel.file import dump_vessel
from autopilot.vessel.schema import Vessel

if TYPE_CHECKING:
    # loaded where a run has them
    from autopilot.operators.skipper import Skipper
    from autopilot.runtime.log_files import Sink
    from autopilot.runtime.record import Recorder
    from autopilot.runtime.tuning import LearningService, TuningService
    from autopilot.runtime.vessel_store import VesselStore


class Machine(NamedTuple):
    """What a run has of the machine that it steers on: real time, the terminal whose bell rings, and the file in which
    the heading that is held is noted for the process after this one."""

    real_time: RealTime = RealTime()
    bell: TextIO | None = None
    restart_file: Path | None = None


RESUME_S = 5.0
"""So long the compass by which a heading was held may take to steer, while another does."""


class Plan(NamedTuple):
    """What a run is made of.

    vessel: what runs; `path`: where it was read, beside it changes and routes are kept.  orders: who moves the order.
    law: None for the file's own.  urls: links to be opened with `options`; `links`: such as are open already.
    log: makes the place where all is written down, None for no log.  machine: None in simulated time.
    skipper: who can follow a route or the wind and carries out what `stations` order, None where only a script orders;
    `armed`: whether they find the pilot so.  learns: whether the pilot learns the boat.
    resume: is given the heading [rad] that a process which died has held, where the vessel lets it be held again.
    """

    vessel: Vessel
    orders: Orders
    path: str = ""
    law: str | None = None
    urls: tuple[str, ...] = ()
    options: LinkOptions = LinkOptions()
    links: tuple[Link, ...] = ()
    log: Callable[[], Sink] | None = None
    machine: Machine | None = None
    skipper: Skipper | None = None
    stations: Stations = Stations(())
    armed: bool = False
    learns: bool = False
    resume: Callable[[float], None] | None = None


class App:
    """A run. Making it opens everything; as a context it is left with the rudder given back, whatever happened.

    Attributes:
        session: the loop.  pilot: what it steps.  recorder: the log, None without one.
        store: the vessel that can be changed while it runs, and `learning` what learns it; None where nobody can.
        notices: what the skipper should know of how the run begins.
    """

    def __init__(self, plan: Plan, clock: Clock) -> None:
        machine = plan.machine
        self._clock, self._saver = clock, BackgroundSaver(plan.options.warn)
        self.notices: list[str] = []
        has_file = machine is not None and plan.path
        filed = plan.vessel.control.path_delay_s
        self._path = PathNote(path_file(plan.path), plan.urls, filed, self._saver) if has_file else None
        vessel = self._begun = self._as_measured(plan.vessel)
        self.pilot = build_pilot(vessel, plan.law, learns=plan.learns)
        self.recorder: Recorder | None = None
        self.store: VesselStore | None = None
        self.learning: LearningService | None = None
        self._plan, self._shared = plan, plan.options
        self._tuning: TuningService | None = None
        self._held: Note | None = None
        self._held_from: tuple[float, int] | None = None
        restart = self._restart_state()
        self._hooks = ServiceHooks(machine.real_time, restart, plan.options.warn) if machine is not None else None
        self._running = ExitStack()
        with ExitStack() as opened:  # closes what is open until the session has it, whatever happens in between
            links: list[Link] = list(plan.links)
            opened.callback(lambda: close_all(links))
            if plan.urls:
                self._shared = shared_by_links(vessel, plan.urls, plan.options)
                links += build_links(vessel, plan.urls, self._shared)
            if plan.skipper is not None:
                links += self._skipper_links(plan.skipper)
            if plan.log is not None:
                self.recorder = self._recorder(plan.log())
                opened.callback(self.recorder.close)
                links.append(GuideAlarms(self.recorder, "log"))
            links.append(GuideAlarms(self._saver, "files"))
            links += alarm_outputs_of(vessel, machine.bell if machine is not None else None)[0]
            if machine is not None:
                links.append(LoopHealth(1.0 / vessel.control.rate_hz))
            if plan.skipper is not None:
                links.append(Acknowledgements(plan.skipper))
            if restart is not None:
                self._resume(restart)
            self.session = Session(self.pilot, links, clock, vessel.control.rate_hz, plan.orders, self.recorder)
            opened.pop_all()

    def __enter__(self) -> App:
        with ExitStack() as entered:
            entered.callback(self._saver.close)
            if self._tuning is not None:
                entered.callback(self._tuning.close)
            try:
                if self._hooks is not None:
                    entered.enter_context(self._hooks)
            except BaseException:
                self.session.close()
                raise
            self.session.__enter__()
            self._running = entered.pop_all()
        return self

    def __exit__(self, *why: Any) -> None:
        # by itself, for it gives the rudder back: a stack of contexts needs memory to be left
        try:
            self.session.__exit__(*why)
        finally:
            self._running.__exit__(*why)

    def run(self, duration: float, watch: Callable[[Tick], bool]) -> None:
        """Steer for `duration` [s], or until `watch`, called after every tick, returns True. Raises LinkError."""

        def after(tick: Tick) -> bool:
            if self._tuning is not None:
                self._tuning.turn()
            if self._saver.alarm is not None:
                self._saver.retry(tick.now)
            is_over = watch(tick)
            if self._held is not None:
                self._await_compass(self._held, tick)
            if self._hooks is not None:
                self._hooks.ticked(tick)
            if self._path is not None:
                self._path.steered_by(self.pilot.state.estimate.path, self.pilot.config.loop_delay)
            return is_over

        self.session.run(self._clock.now() + duration, after)

    def _as_measured(self, vessel: Vessel) -> Vessel:
        """Return the vessel as the run begins with it: with the delay that an earlier run measured over these links."""
        note, control = self._path, vessel.control
        if note is None:
            return vessel
        if (delay := note.left()) is not None:
            control = replace(control, path_delay_s=delay)
            if delay - control.loop_delay_s > PATH_LATER:
                self.notices.append(
                    f"an earlier run measured a path delay of {delay:.2f} s over these links: it counts"
                )
        note.kept = control.loop_delay_s if control.path_delay_s is None else control.path_delay_s
        return replace(vessel, control=control)

    def _restart_state(self) -> RestartState | None:
        """Return what keeps note of what is steered; None where the vessel file or the place for it is missing."""
        plan, within = self._plan, self._plan.vessel.failsafe.reengage_after_restart_s
        if plan.machine is None or plan.machine.restart_file is None or plan.resume is None or within <= 0.0:
            return None
        return RestartState(plan.machine.restart_file, within, self._saver, compass=self._compass)

    def _compass(self) -> str:
        """Return the source of the headings that are steered by, '' where nothing chooses among several."""
        selection = self._shared.selection
        return "" if selection is None else selection.selected("heading")

    def _resume(self, restart: RestartState) -> None:
        note = restart.left()
        if note is None or self._plan.resume is None:
            return
        held, name = f"{compass_text(note.heading)} deg", note.compass.partition("@")[0]
        again = "engaging on it again" + (f" when {name} steers" if name else "")
        self.notices.append(f"the process before this one ended while it held {held}: {again}")
        if name:
            self._held = note
        else:
            self._plan.resume(note.heading)

    def _await_compass(self, held: Note, tick: Tick) -> None:
        """Engage on what was held as soon as its compass steers; not where another does, whose number for the same
        course is not this one, nor where somebody gives an order."""
        if not tick.state.valid:
            return
        since, serial = self._held_from = self._held_from or (tick.now, tick.order.serial)
        steers, is_over = self._compass(), tick.now - since > RESUME_S
        if tick.order.serial != serial:
            self._held = None
        elif steers == held.compass and self._plan.resume is not None:
            self._held = None
            self._plan.resume(held.heading)
        elif is_over:
            self._held = None
            before, now = held.compass.partition("@")[0], steers.partition("@")[0] or "another compass"
            self._plan.options.warn(
                f"not engaged again on {compass_text(held.heading)} deg, which was held by {before}: {now} steers; "
                "give a heading"
            )

    def _recorder(self, place: Sink) -> Recorder:
        from autopilot.runtime.record import Recorder

        plan = self._plan
        header = {"norrbin": __version__, "vessel": dump_vessel(self._begun), "law": plan.law}
        recorder = Recorder(place, header, self._clock.now())
        if self.store is not None:
            self.store.log = recorder
        return recorder

    def _skipper_links(self, skipper: Skipper) -> list[Link]:
        """Have routes followed as the vessel says, and kept; return the links to nobody that bring their alarms, and
        those over which the skipper is given orders."""
        from autopilot.links.ground_station.mission import dump_items

        plan, mission, kept = self._plan, skipper.mission, mission_file(self._plan.path)
        mission.save_route = lambda items: self._saver(kept, dump_items(items))
        mission.guide.settings, skipper.wind.settings = track_settings_of(plan.vessel), wind_settings_of(plan.vessel)
        links: list[Link] = [
            GuideAlarms(mission.guide, "track"),
            GuideAlarms(skipper.wind, "wind"),
            GuideAlarms(mission.overboard, "skipper"),
        ]
        if plan.learns or plan.stations.urls:
            self.store = self._store(skipper)
        if self.store is None or not plan.stations.urls:
            return links
        from autopilot.links.ground_station.commands import Commands, Instruments

        commands = Commands(skipper, plan.armed, mission, self._tuning, skipper.wind, self.pilot.against_engaging)
        known = self._shared.variation or variation_of(plan.vessel, by_model=False)
        commands.instruments = Instruments(self._shared.selection, self.store.keep_compass, known)
        commands.last_stop = skipper.last_stop
        return [*links, *build_station_links(plan.vessel, plan.stations, commands, self.store, plan.options)]

    def _store(self, skipper: Skipper) -> VesselStore:
        """Let the numbers of the vessel be changed while it runs."""
        from autopilot.runtime.tuning import LearningService, TuningService
        from autopilot.runtime.vessel_store import VesselStore, tuned_file

        plan, kept = self._plan, tuned_file(self._plan.path)
        refuse = partial(refuse_failsafe, urls=plan.urls)
        store = VesselStore(plan.vessel, self.pilot, plan.law, kept, self._saver, refuse)

        def keep_course_settings(vessel: Vessel) -> None:
            skipper.mission.guide.settings, skipper.wind.settings = track_settings_of(vessel), wind_settings_of(vessel)

        store.changed = keep_course_settings
        if self.pilot.learner is not None:
            self.learning = LearningService(self.pilot.learner, store)
        self._tuning = TuningService(store, self.learning)
        older = f"; changes of an earlier run are in {kept}: start with that file to use them" if kept.exists() else ""
        kept_where = f"is kept in {kept}{older}"
        try:
            check_folder(kept)
        except InputError as error:
            kept_where = f"is lost at its end: {error}{older}"
        self.notices.append(f"in force: {plan.path}; what is changed while it runs {kept_where}")
        return store


def path_file(vessel_path: str) -> Path:
    """Return the file in which the path's delay is noted: boat.yaml, boat.path.json."""
    path = Path(vessel_path)
    return path.with_name(f"{path.stem}.path.json")


def mission_file(vessel_path: str) -> Path:
    """Return the file in which the route is kept: boat.yaml, boat.mission.waypoints."""
    path = Path(vessel_path)
    return path.with_name(f"{path.stem}.mission.waypoints")
