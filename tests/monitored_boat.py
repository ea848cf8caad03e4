"""A pilot at sea with its route, parameters and alarms, and a helm display on a line to it, all on one clock."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

from boat_at_sea import STEP, Sea
from boats import BOATS, vessel_of

from autopilot.estimation.sensor_selection import SensorSelection
from autopilot.links.alarm_outputs import Acknowledgements
from autopilot.links.base import LinkError, Transport
from autopilot.links.ground_station.boat_link import BoatLink
from autopilot.links.ground_station.commands import Commands, Instruments
from autopilot.links.ground_station.file_server import metadata_files
from autopilot.links.ground_station.station_service import ParameterServer
from autopilot.links.transports import loopback_pair
from autopilot.pilot import Pilot
from autopilot.runtime.tuning import LearningService, TuningService
from autopilot.runtime.vessel_store import VesselStore
from autopilot.signals import AlarmSample, Sample
from autopilot.vessel.parameters import parameters_of
from autopilot.vessel.schema import Vessel
from autopilot.web.journal import words_of
from autopilot.web.requests import asked_of
from autopilot.web.station import BoatLine, Station


def noted(pilot: Pilot, sample: AlarmSample) -> None:
    """A link has something to say, as if by a sample."""
    notes = dict(pilot.state.supervisor.notes)
    notes.pop(sample.source, None)
    if sample.event is not None:
        notes[sample.source] = sample.event
    pilot.state = pilot.state._replace(supervisor=pilot.state.supervisor._replace(notes=notes))


class AtOnce(Executor):
    """Does the work while it is asked for: no thread, no wall clock."""

    def submit(self, work: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
        done: Future[Any] = Future()
        try:
            done.set_result(work(*arguments, **named))
        except Exception as error:
            done.set_exception(error)
        return done


class BothAlarms:
    """The links to nobody that a run has: the route's alarms, and what the skipper has acknowledged."""

    def __init__(self, *links: Any) -> None:
        self._links = links

    def receive(self, now: float) -> list[Sample]:
        return [sample for link in self._links for sample in link.receive(now)]


class Watched(Sea):
    """`watch` moves boat and display on together; `order` gives an order as the page does and returns how it ended."""

    def __init__(
        self, folder: Path, learns: bool = False, vessel: Vessel | None = None, compasses: SensorSelection | None = None
    ) -> None:
        super().__init__(learns, vessel)
        vessel = vessel or vessel_of(BOATS["lanxin"])
        self.store = VesselStore(vessel, self.pilot, None, folder / "boat.tuned.yaml")
        self.service = None if self.pilot.learner is None else LearningService(self.pilot.learner, self.store)
        self.tuner = TuningService(self.store, self.service, AtOnce())
        self.files = metadata_files(parameters_of(self.store.running), "0.2.0")
        self.alarms = BothAlarms(self.alarms, Acknowledgements(self.skipper))
        self.commands = Commands(
            self.skipper, False, self.mission, self.tuner, self.skipper.wind, self.pilot.against_engaging
        )
        self.commands.instruments = Instruments(compasses, self.store.keep_compass)
        self.is_cut = False
        self.keeps_history = True
        self.lock = threading.RLock()  # a test and the thread of a page's server sail one boat
        self.station = Station()
        self.line = BoatLine("udpin:127.0.0.1:14550", self.station, opens=self._connect)

    def _connect(self, url: str) -> Transport:
        if self.is_cut:
            raise LinkError(f"link {url!r}: cannot be opened")
        near, self.far = loopback_pair("boat")
        self.links = [BoatLink(near, self.commands, ParameterServer(self.store, self.files))]
        return self.far

    @property
    def now(self) -> float:
        return self.box.time

    def watch(self, seconds: float, **options: Any) -> None:
        with self.lock:
            for _ in range(round(seconds / STEP)):
                self.sail(STEP, **options)
                self.tuner.turn()
                self.line.turn(self.now)
                if self.keeps_history:
                    self.station.view.keep_history(self.now)

    def until(self, happens: Callable[[], bool], seconds: float = 20.0) -> None:
        for _ in range(round(seconds / STEP)):
            if happens():
                return
            self.watch(STEP)
        raise AssertionError(f"not within {seconds:g} s of sailing")

    def answer(self, asked: Callable[[float, Any], None], what: str = "") -> tuple[bool, str]:
        ends: list[tuple[bool, str]] = []
        by = ("here", what) if what else None
        self.station.ask(self.now, asked, lambda taken, words: ends.append((bool(taken), words)), by)
        self.until(lambda: bool(ends))
        assert len(ends) == 1
        return ends[0]

    def order(self, **wanted: Any) -> tuple[bool, str]:
        return self.answer(asked_of(self.station, wanted), words_of(wanted))
