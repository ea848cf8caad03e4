"""The NMEA 0183 session, driven by lists of byte chunks and times: no transport, no clock."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from autopilot.links.nmea.link import NmeaSession, NmeaSettings
from autopilot.links.nmea.sentences import encode_hdt, encode_ror, format_sentence
from autopilot.links.rudder_order import ReleaseState
from autopilot.signals import HeadingSample, HelmSample, RudderCommand, RudderSample, Sample

HDT = format_sentence("HE", "HDT", ["123.4", "T"])
RSA = format_sentence("II", "RSA", ["5.0", "A", "", ""])
STEER = RudderCommand(0.0, math.radians(10.0), True)
LET_GO = RudderCommand(0.0, 0.0, False)


def of(kind: type[Sample], samples: list[Sample]) -> list[Sample]:
    return [sample for sample in samples if isinstance(sample, kind)]


@pytest.mark.parametrize("size", [1, 3, 17, 1000])
def test_sentences_cut_anywhere_give_the_same_samples(size: int) -> None:
    session, stream = NmeaSession("line"), HDT + RSA
    samples = session.receive(1.0, [stream[place : place + size] for place in range(0, len(stream), size)])
    (heading,), (rudder,) = of(HeadingSample, samples), of(RudderSample, samples)
    assert (heading.time, heading.source) == (1.0, "HEHDT") and rudder.source == "IIRSA"
    assert heading.heading == pytest.approx(math.radians(123.4)) and rudder.angle == pytest.approx(math.radians(5.0))


def test_a_sample_is_as_old_as_its_sentence_on_a_slow_line() -> None:
    session = NmeaSession("line", NmeaSettings(baud=4800))
    (heading,) = of(HeadingSample, session.receive(1.0, [HDT]))
    assert heading.time == pytest.approx(1.0 - len(HDT) * 10 / 4800)


def test_half_a_datagram_never_borrows_from_the_next() -> None:
    whole, split = NmeaSession("line", is_stream=False), NmeaSession("line", is_stream=False)
    assert of(HeadingSample, whole.receive(1.0, [HDT.rstrip()]))
    assert not of(HeadingSample, [*split.receive(1.0, [HDT[:9]]), *split.receive(1.1, [HDT[9:]])])


def test_an_order_waits_for_the_line_and_the_newest_leaves() -> None:
    session = NmeaSession("line", NmeaSettings(baud=4800))
    session.send(0.0, STEER)
    first = session.due(0.0)
    assert len(first) == 1 and b"ROR,10.00,A" in first[0]
    assert session.due(0.0) == first, "what has not left is due again"
    session.sent(0.0, first)
    for angle in (4.0, 5.0):
        session.send(0.01, STEER._replace(angle=math.radians(angle)))
    assert session.due(0.01) == []
    (newest,) = session.due(0.0 + len(first[0]) * 10 / 4800)
    assert b"ROR,5.00,A" in newest


def test_a_release_is_due_five_times_a_tenth_of_a_second_apart() -> None:
    session = NmeaSession("line")
    session.send(0.0, STEER)
    session.sent(0.0, session.due(0.0))
    session.send(0.01, LET_GO)
    times = []
    for step in range(100):
        now = round(0.02 + 0.01 * step, 3)
        if sentences := session.due(now):
            assert b",V," in sentences[0]
            session.sent(now, sentences)
            times.append(now)
    assert len(times) == 5 and all(0.1 <= after - before < 0.12 for before, after in pairwise(times))
    assert session.release(1.1) == []


def test_the_way_out_says_every_release_at_once_and_what_became_of_it() -> None:
    session = NmeaSession("line")
    session.send(0.0, STEER)
    releases = session.release(1.0)
    assert len(releases) == 5 and all(b",V," in sentence for sentence in releases)
    session.released(1.0, is_gone=False)
    assert session.release_result(1.0) is None
    found = session.release_result(2.0)
    assert found is not None and found.state is ReleaseState.UNSHOWN


def test_a_rudder_that_does_not_follow_takes_control_away() -> None:
    session, said = NmeaSession("line"), []
    for step in range(60):
        now = 0.1 * step
        session.send(now, STEER._replace(angle=math.radians(25.0)))
        said += of(HelmSample, session.receive(now, [RSA]))
    assert [sample.available for sample in said] == [True, False]


def test_another_autopilot_that_orders_the_rudder_on_the_line_has_it() -> None:
    def reasons(session: NmeaSession, now: float, *sentences: bytes) -> list[str]:
        return [each.reason for each in session.receive(now, [b"".join(sentences)]) if isinstance(each, HelmSample)]

    session = NmeaSession("line", NmeaSettings())
    assert reasons(session, 0.0, encode_hdt(1.0)) == [""]
    assert reasons(session, 1.0, encode_ror(0.1, True)) == [], "an echo of our own"
    assert reasons(session, 1.1, encode_ror(0.0, False, talker="AP")) == [], "it gives the rudder back"
    (said,) = reasons(session, 1.2, encode_ror(0.1, True, talker="AP"))
    assert said.startswith("another autopilot on this line orders the rudder (APROR): put it in standby")
    assert reasons(session, 3.2, encode_hdt(1.0)) == []
    assert reasons(session, 3.3, encode_hdt(1.0)) == [""]
    for settings in (NmeaSettings(with_other_pilot=True), NmeaSettings(steers=False)):
        other = NmeaSession("line", settings)
        assert not any(reasons(other, 1.0, encode_ror(0.1, True, talker="AP")))
