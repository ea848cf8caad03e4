"""What the machine gives a loop in a hurry, and what it says when it does not."""

from __future__ import annotations

import ctypes
import gc
import os
import resource
from types import SimpleNamespace

import pytest

from autopilot.errors import InputError
from autopilot.runtime import machine
from autopilot.runtime.machine import RealTime, SlackCollector, cpus_of, make_real_time


def refuse(*_: object) -> None:
    raise PermissionError(1, "Operation not permitted")


def test_without_real_time_options_the_system_is_asked_for_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("sched_setaffinity", "sched_setscheduler"):
        monkeypatch.setattr(os, name, refuse)
    assert make_real_time(RealTime()) == []


def test_each_refusal_is_one_sentence_with_the_way_out(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("sched_setaffinity", "sched_setscheduler"):
        monkeypatch.setattr(os, name, refuse)
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setattr(resource, "getrlimit", lambda _: (65536, 65536))
    cpu, memory, priority = make_real_time(RealTime(40, (0,)))
    assert cpu.startswith("not kept to CPU 0 (Operation not permitted): allowed here are ")
    assert memory.startswith("memory is not locked (at most 64 kB are allowed): set LimitMEMLOCK=infinity")
    assert priority.startswith("no real-time priority (Operation not permitted): set LimitRTPRIO=40")
    assert "\n" not in cpu + memory + priority


def test_a_system_that_refuses_to_lock_is_quoted(monkeypatch: pytest.MonkeyPatch) -> None:
    def mlockall(flags: int) -> int:
        assert flags == 3
        ctypes.set_errno(12)
        return -1

    monkeypatch.setattr(resource, "getrlimit", lambda _: (resource.RLIM_INFINITY,) * 2)
    monkeypatch.setattr(ctypes, "CDLL", lambda *_, **__: SimpleNamespace(mlockall=mlockall))
    monkeypatch.setattr(os, "sched_setscheduler", lambda *_: None)
    (sentence,) = make_real_time(RealTime(40))
    assert "Cannot allocate memory" in sentence


def test_the_logs_thread_comes_right_below_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[tuple[int, int]] = []
    monkeypatch.setattr(
        os, "sched_setscheduler", lambda task, _, parameter: given.append((task, parameter.sched_priority))
    )
    main = SimpleNamespace(native_id=1)
    monkeypatch.setattr(machine.threading, "main_thread", lambda: main)
    monkeypatch.setattr(machine.threading, "enumerate", lambda: [main, SimpleNamespace(native_id=77)])
    assert machine._schedule(40) == ""
    assert given == [(77, 39), (0, 40)]


@pytest.mark.parametrize("text", ["", "x", "-1", "0,", "4096", "0.5"])
def test_cores_that_cannot_be_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="numbers of cores from 0 to"):
        cpus_of(text)
    assert cpus_of("0") == (0,)


def test_garbage_is_collected_in_the_slack_alone() -> None:
    before = gc.get_threshold(), gc.get_freeze_count()
    generations: list[int] = []
    collector = SlackCollector(lambda generation: generations.append(generation) or gc.collect(generation))  # type: ignore[func-returns-value]
    try:
        assert gc.get_freeze_count() > 1000
        collector()
        assert generations == []
        kept = [[number] for number in range(3 * machine.YOUNG)]
        assert generations == []
        collector()
        assert generations == [1]
        collector()
        assert generations == [1]
        assert gc.get_stats()[0]["collections"] >= 0
        del kept
    finally:
        collector.close()
    assert (gc.get_threshold(), gc.get_freeze_count()) == (before[0], 0)


def test_a_look_through_what_lasts_comes_seldom() -> None:
    generations: list[int] = []
    collector = SlackCollector(lambda generation: generations.append(generation) or gc.collect(generation))  # type: ignore[func-returns-value]
    try:
        for _ in range(machine.OLD_EVERY):
            kept = [[number] for number in range(machine.YOUNG + 100)]
            collector()
            del kept
    finally:
        collector.close()
    assert generations.count(2) == 1
    assert generations[-1] == 2
