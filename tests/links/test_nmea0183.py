"""NMEA 0183: framing, encoders and meaning, checked on sentences that other people published and on noise."""

from __future__ import annotations

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.links.nmea import sentences as encoders
from autopilot.links.nmea.samples import Deviation, NmeaReader
from autopilot.links.nmea.sentences import NmeaFramer, checksum, format_sentence, is_nmea
from autopilot.signals import HeadingSample, RateSample, RudderSample, SpeedSample, WindSample

LENGTH_MAX = 102

KNOT = 0.514444444444

# Sentences as others published them, with what they say in plain words. Sources: RMC, E. S. Raymond "NMEA Revealed";
# HDM and VTG, documentation of the go-nmea library; HDG, notes on an Airmar weather station; THS and HDT, tests of an
# iXblue gyro driver; ROT, an Airmar log; RSA, documentation of the Java Marine API; VHW, tests of the Signal K parser
# and an Airmar log (a boat that drifts astern); MWV, the same parser's.
PUBLISHED = [
    ("$GPRMC,225446,A,4916.45,N,12311.12,W,000.5,054.7,191194,020.3,E*68", SpeedSample, 0.5 * KNOT),
    ("$HCHDM,093.8,M*2B", HeadingSample, math.radians(93.8)),
    ("$HCHDG,359.6,0.0,E,2.2,W*59", HeadingSample, math.radians(357.4 - 360.0)),
    ("$HETHS,191.75,A*16", HeadingSample, math.radians(191.75 - 360.0)),
    ("$HEHDT,41.87,T*25", HeadingSample, math.radians(41.87)),
    ("$TIROT,-22.0,A*26", RateSample, math.radians(-22.0 / 60.0)),
    ("$IIRSA,9,A,,*38", RudderSample, math.radians(9.0)),
    ("$IIVHW,,T,,M,06.12,N,11.33,K*50", SpeedSample, 6.12 * KNOT),
    ("$VDVHW,,T,,M,-0.08,N,-0.15,K*4B", SpeedSample, -0.08 * KNOT),
    ("$GPVTG,220.86,T,,M,2.550,N,4.724,K,A*34", SpeedSample, 2.550 * KNOT),
    ("$IIMWV,084.0,R,10.4,N,A*04", WindSample, math.radians(84.0)),
]


def sample_of(line: bytes | str, **kwargs):
    """Return the one sample in a line, None where it gives none."""
    data = line.encode() if isinstance(line, str) else line
    sentences = NmeaFramer().feed(data + b"\r\n")
    reader = NmeaReader(**kwargs)
    return reader.read(0.0, sentences[0]) if sentences else None


def of(body: str, **kwargs):
    """Return the sample in a sentence given without its checksum."""
    return sample_of(f"${body}*{checksum(body.encode()):02X}", **kwargs)


@pytest.mark.parametrize(("line", "kind", "value"), PUBLISHED)
def test_published_nmea_sentences_are_read(line, kind, value) -> None:
    sample = sample_of(line, variation=0.0 if "HDM" in line else None)
    assert isinstance(sample, kind)
    assert sample[1] == pytest.approx(value, rel=1e-9)
    assert sample.source == line[1:6]


@pytest.mark.parametrize(
    ("line", "rebuilt"),
    [
        ("$HCHDM,093.8,M*2B", encoders.encode_hdm(math.radians(93.8))),
        ("$HCHDG,359.6,0.0,E,2.2,W*59", encoders.encode_hdg(math.radians(359.6), 0.0, math.radians(-2.2))),
        ("$HETHS,191.75,A*16", encoders.encode_ths(math.radians(191.75), decimals=2)),
        ("$TIROT,-22.0,A*26", encoders.encode_rot(math.radians(-22.0 / 60.0))),
    ],
)
def test_encoders_write_published_sentences_byte_for_byte(line, rebuilt) -> None:
    assert rebuilt == line.encode() + b"\r\n"


def test_rudder_order_layout() -> None:
    # $--ROR: starboard (or only) rudder order, status, port rudder order, status, B for the bridge (IEC 61162-1).
    assert encoders.encode_ror(math.radians(-12.5), True).startswith(b"$AGROR,-12.50,A,,V,B*")
    assert encoders.encode_ror(0.3, False).startswith(b"$AGROR,17.19,V,,V,B*")
    assert len(encoders.encode_ror(math.radians(-35.0), True)) <= 30, "31 ms of a line at 9600 baud"


@given(st.floats(-math.pi, math.pi), st.floats(-0.4, 0.4), st.floats(0.0, 20.0))
def test_what_is_written_is_read_again(heading, small, speed) -> None:
    half_digit = math.radians(0.0501)
    for line in (encoders.encode_hdt(heading), encoders.encode_ths(heading), encoders.encode_hdg(heading, 0.0, 0.0)):
        back = sample_of(line.strip())
        assert abs(math.remainder(back.heading - heading, math.tau)) <= half_digit
    assert sample_of(encoders.encode_rot(small).strip()).rate == pytest.approx(small, abs=half_digit / 60.0)
    assert sample_of(encoders.encode_rsa(small).strip()).angle == pytest.approx(small, abs=half_digit)
    for line in (
        encoders.encode_vhw(speed),
        encoders.encode_vtg(heading, speed),
        encoders.encode_rmc(heading, speed, -33.9, 151.2, 86399.999),
    ):
        assert sample_of(line.strip()).speed == pytest.approx(speed, abs=0.0051 * KNOT)


def test_a_heading_is_never_written_as_360() -> None:
    assert b"000.0" in encoders.encode_hdt(math.radians(359.97))
    assert b"-0.0" not in encoders.encode_rot(-1e-6)


@pytest.mark.parametrize(
    ("body", "sample_heading_deg"),
    [
        ("HCHDG,100.0,2.0,E,3.0,W", 99.0),  # its own deviation and variation
        ("HCHDG,100.0,,,3.0,W", 100.0 + 5.0 - 3.0),  # deviation from the table
        ("HCHDG,100.0,2.0,W,,", 100.0 - 2.0 + 10.0),  # variation as configured
        ("HCHDG,100.0,,,,", 100.0 + 5.0 + 10.0),
        ("HCHDM,100.0,M", 110.0),  # already free of deviation
    ],
)
def test_where_variation_and_deviation_come_from(body, sample_heading_deg) -> None:
    table = Deviation(((math.radians(90.0), math.radians(4.0)), (math.radians(110.0), math.radians(6.0))))
    sample = of(body, variation=math.radians(10.0), deviation=table)
    assert math.degrees(sample.heading) == pytest.approx(sample_heading_deg)


def test_a_magnetic_heading_without_variation_waits_for_rmc() -> None:
    reader, framer = NmeaReader(), NmeaFramer()
    lines = b"$HCHDM,093.8,M*2B\r\n$GPRMC,225446,A,4916.45,N,12311.12,W,000.5,054.7,191194,020.3,E*68\r\n" * 2
    samples = [reader.read(0.0, sentence) for sentence in framer.feed(lines)]
    assert samples[0] is None
    assert reader.waiting_for_variation == 1
    assert math.degrees(samples[2].heading) == pytest.approx(93.8 + 20.3)


def test_where_courses_are_magnetic_it_is_a_true_heading_that_takes_the_variation() -> None:
    reader, framer = NmeaReader(magnetic=True), NmeaFramer()
    lines = b"$HCHDM,093.8,M*2B\r\n" + encoders.encode_hdt(math.radians(100.0))
    rmc = b"$GPRMC,225446,A,4916.45,N,12311.12,W,000.5,054.7,191194,020.3,E*68\r\n"
    samples = [reader.read(0.0, sentence) for sentence in framer.feed(lines + rmc + lines)]
    assert math.degrees(samples[0].heading) == pytest.approx(93.8)
    assert samples[1] is None and reader.unusable == 1
    assert math.degrees(samples[4].heading) == pytest.approx(100.0 - 20.3)


def test_deviation_goes_round_the_card() -> None:
    table = Deviation(((math.radians(350.0), 0.1), (math.radians(10.0), 0.3)))
    assert table.at(0.0) == pytest.approx(0.2)
    assert table.at(math.radians(355.0)) == pytest.approx(0.15)
    assert table.at(math.radians(180.0)) == pytest.approx(0.2)
    assert Deviation().at(1.0) == 0.0
    with pytest.raises(ValueError, match="twice"):
        Deviation(((0.1, 0.0), (0.1, 0.1)))


@pytest.mark.parametrize(
    "body",
    [
        "HETHS,191.75,V",
        "TIROT,5.0,V",
        "IIRSA,9.0,V,,V",
        "IIMWV,084.0,R,10.4,N,V",
        "IIMWV,084.0,T,10.4,N,A",
        "GPRMC,225446,V,4916.45,N,12311.12,W,000.5,054.7,191194,,",
        "GPRMC,225446,A,4916.45,N,12311.12,W,000.5,054.7,191194,,,N",
        "GPVTG,,T,,M,,N,,K,N",
        "GPVTG,220.86,T,,M,2.550,N,4.724,K,N",
        "HEHDT,,T",
        "HCHDG,,,,,",
        "VWVHW,,T,,M,,N,,K",
        "IIVWR,045.0,L,,N,,M,,K",
        "IIVWR,,,,,,,,",
    ],
)
def test_what_calls_itself_invalid_is_no_data(body) -> None:
    reader = NmeaReader(variation=0.0)
    (sentence,) = NmeaFramer().feed(f"${body}*{checksum(body.encode()):02X}\r\n".encode())
    assert reader.read(0.0, sentence) is None
    assert (reader.invalid, reader.malformed) == (1, 0)


@pytest.mark.parametrize(
    "body",
    [
        "HEHDT,360.1,T",
        "HEHDT,-1.0,T",
        "HEHDT,nan,T",
        "HEHDT,1e2,T",
        "HEHDT,1_0,T",
        "HEHDT, 10,T",
        "HEHDT,41.87,M",
        "HEHDT,41.87",
        "HEHDT",
        "HCHDG,100.0,2.0,X,3.0,W",
        "HCHDG,100.0,2.0,,3.0,W",
        "HCHDG,100.0,99.0,E,3.0,W",
        "HETHS,191.75,",
        "HETHS,191.75,Q",
        "TIROT,99999.0,A",
        "IIRSA,120.0,A,,V",
        "IIMWV,384.0,R,10.4,N,A",
        "IIMWV,84.0,R,10.4,F,A",
        "IIVWR,184.0,L,10.4,N,5.4,M,19.3,K",
        "IIVWR,84.0,,10.4,N,5.4,M,19.3,K",
        "IIVWR,84.0,L,10.4,M,5.4,M,19.3,K",
        "VWVHW,,T,,M,3.1,K,4.3,N",
        "GPVTG,220.86,T,,M,-2.5,N,4.724,K,A",
    ],
)
def test_nmea_sentences_with_impossible_values_are_counted_malformed(body) -> None:
    reader = NmeaReader(variation=0.0)
    (sentence,) = NmeaFramer().feed(f"${body}*{checksum(body.encode()):02X}\r\n".encode())
    assert reader.read(0.0, sentence) is None
    assert (reader.invalid, reader.malformed) == (0, 1)


@pytest.mark.parametrize(
    ("body", "degrees", "speed"),
    [
        ("IIVWR,045.0,L,10.0,N,5.1,M,18.5,K", -45.0, 10.0 * KNOT),
        ("IIVWR,045.0,R,,N,5.1,M,,K", 45.0, 5.1),
        ("IIVWR,180.0,R,,N,,M,18.0,K", 180.0, 5.0),
    ],
)
def test_an_older_vane_says_the_wind_off_the_bow_by_its_side(body: str, degrees: float, speed: float) -> None:
    wind = of(body)
    assert isinstance(wind, WindSample)
    assert (math.degrees(wind.angle), wind.speed) == (pytest.approx(degrees), pytest.approx(speed))


def test_a_vane_that_says_its_wind_in_both_ways_says_one() -> None:
    reader, framer = NmeaReader(), NmeaFramer()

    def is_said(time: float, kind: str, *fields: str) -> bool:
        (sentence,) = framer.feed(format_sentence("II", kind, fields))
        return reader.read(time, sentence) is not None

    mwv, vwr = ("MWV", "045.2", "R", "10.4", "N", "A"), ("VWR", "045.0", "R", "10.0", "N", "", "M", "", "K")
    assert [is_said(0.5 * number, *each) for number, each in enumerate((mwv, vwr, mwv, vwr))] == [True, False] * 2
    assert is_said(20.0, *vwr), "MWV has fallen silent"


def test_a_deviation_or_variation_of_nought_without_a_side_is_none() -> None:
    assert math.degrees(of("HCHDG,90.0,0.0,,4.0,E").heading) == pytest.approx(94.0)
    assert math.degrees(of("HCHDG,90.0,0.0,E,0.0,", variation=math.radians(3.0)).heading) == pytest.approx(93.0)


def test_speed_in_km_h_stands_in_for_knots() -> None:
    assert of("VWVHW,,T,,M,,N,18.0,K").speed == pytest.approx(5.0)


def test_counts_tell_what_came() -> None:
    framer = NmeaFramer()
    framer.feed(
        b"$HEHDT,41.87,T*25\r\n"
        b"$HEHDT,41.88,T*25\r\n"  # a digit changed on the way
        b"$HEHDT,41.87,T\r\n"  # no checksum
        b"$PGRMZ,246,f,3*1B\r\n"  # proprietary
        b"!AIVDM,1,1,,A,14eG;o@034o8sd<L9i:a;WF>062D,0*7D\r\n"
        b"$HEHDT,41.87,$HEHDT,41.87,T*25\r\n"  # a sentence that broke off
        b"$hehdt,41.87,T*25\r\n"
    )
    assert framer.counts == (2, 2, 2, 2)


@given(st.lists(st.binary(min_size=1, max_size=7), max_size=5), st.integers(1, 40))
def test_a_stream_may_be_split_anywhere(noise, size) -> None:
    lines = b"".join(line.encode() + b"\r\n" for line, _, _ in PUBLISHED)
    stream = lines + b"".join(part.replace(b"$", b"").replace(b"!", b"") for part in noise) + b"\r\n" + lines
    framer = NmeaFramer()
    found = [s for start in range(0, len(stream), size) for s in framer.feed(stream[start : start + size])]
    assert [s.talker + s.type for s in found] == [line[1:6] for line, _, _ in PUBLISHED] * 2
    assert framer.taken == len(stream)
    assert [stream[s.start : s.start + 6].decode() for s in found] == [line[:6] for line, _, _ in PUBLISHED] * 2


@given(st.binary(max_size=300))
def test_noise_never_raises_and_never_steers(data) -> None:
    framer, reader = NmeaFramer(), NmeaReader(variation=0.0)
    for sentence in framer.feed(data):
        reader.read(0.0, sentence)
    assert len(framer._line) <= LENGTH_MAX


def test_damaged_sentences_are_refused() -> None:
    """Twenty thousand sentences with one to three bytes changed: the checksum lets about one in 256 pass.

    What passes must still be in range.
    """
    rng = random.Random(20)
    framer, reader = NmeaFramer(), NmeaReader(variation=0.0)
    accepted = 0
    for _ in range(20000):
        line = bytearray(rng.choice(PUBLISHED)[0].encode())
        original = bytes(line)
        for _ in range(rng.randint(1, 3)):
            line[rng.randrange(len(line))] = rng.randrange(256)
        if bytes(line) == original:
            continue
        for sentence in framer.feed(bytes(line) + b"\r\n"):
            sample = reader.read(0.0, sentence)
            if sample is not None:
                accepted += 1
                assert all(math.isfinite(value) for value in sample if isinstance(value, float))
                assert not isinstance(sample, HeadingSample) or -math.pi < sample.heading <= math.pi
    assert accepted < 20000 / 100


def test_a_line_without_end_takes_no_memory() -> None:
    framer = NmeaFramer()
    for _ in range(100):
        assert framer.feed(b"$" + b"A" * 10000) == []
    assert len(framer._line) <= LENGTH_MAX
    assert [s.type for s in framer.feed(b"\r\n$HEHDT,41.87,T*25\r\n")] == ["HDT"]


@pytest.mark.parametrize("field", ["a*b", "$", "\r\n", "é", "!"])
def test_a_field_that_would_break_the_framing_is_refused(field) -> None:
    with pytest.raises(ValueError, match="printable ASCII"):
        format_sentence("II", "TXT", [field])


def test_a_datagram_is_known_by_a_right_checksum() -> None:
    assert is_nmea(b"$HEHDT,41.87,T*25\r\n")
    assert is_nmea(b"$HEHDT,41.87,T*25")
    assert not is_nmea(b"$HEHDT,41.87,T*26\r\n")
    assert not is_nmea(b"")


def byte_by_byte(chunks: list[bytes]) -> tuple[list[tuple[str, int]], int, int]:
    """Address and place of each sentence, checksum errors and malformed ones, by the plainest automaton there is."""
    line: bytes | None = None
    begun = errors = malformed = 0
    found = []
    for place, byte in enumerate(b"".join(chunks)):
        if byte in b"$!":
            malformed += line is not None
            line, begun = b"", place
        if line is None:
            continue
        if byte in b"\r\n":
            body, star, given = line[1:].partition(b"*")
            total = 0
            for value in body:
                total ^= value
            address = body.split(b",")[0].decode("ascii")
            if not star or len(given) != 2:
                malformed += 1
            elif given.upper() != b"%02X" % total:
                errors += 1
            elif line[:1] == b"$" and not address.startswith("P"):
                if len(address) == 5 and address.isalnum() and address.isupper():
                    found.append((address, begun))
                else:
                    malformed += 1
            line = None
        elif len(line) >= 102 or not 0x20 <= byte <= 0x7E:
            malformed += 1
            line = None
        else:
            line += bytes((byte,))
    return found, errors, malformed


PIECES = st.one_of(
    st.binary(max_size=12),
    st.sampled_from([b"$", b"!", b"*", b"\r\n", b"\n", b"$HEHDT,12.0,T*2D\r\n", b"$HEHDT,12.0,T*2E\r\n", b"A" * 60]),
)


@given(st.lists(PIECES, max_size=25))
def test_the_framer_is_the_plain_automaton_however_the_stream_is_cut(chunks: list[bytes]) -> None:
    framer = NmeaFramer()
    got = [(s.talker + s.type, s.start) for chunk in chunks for s in framer.feed(chunk)]
    found, errors, malformed = byte_by_byte(chunks)
    assert got == found
    assert (framer.counts.checksum_errors, framer.counts.malformed) == (errors, malformed)
    assert framer.taken == sum(len(chunk) for chunk in chunks)


@given(st.binary(max_size=200))
def test_the_checksum_is_the_exclusive_or(body: bytes) -> None:
    total = 0
    for byte in body:
        total ^= byte
    assert checksum(body) == total


@pytest.mark.parametrize(
    ("line", "counts"),
    [
        ("$HEHDT,41.87,T*25", (1, 0, 0, 0)),
        ("$HEHDT,41.87,T*2", (0, 0, 1, 0)),
        ("$HEHDT,41.87,T*255", (0, 0, 1, 0)),
        ("$HEHDT,41.87,T", (0, 0, 1, 0)),
        ("$HEHDT,41.87,T*26", (0, 1, 0, 0)),
        ("$PGRME,15.0,M,45.0,M,25.0,M*1C", (0, 0, 0, 1)),
        ("!AIVDM,1,1,,A,14eG;o@034o8sd<L9i:a;WF>062D,0*7D", (0, 0, 0, 1)),
        *((f"${address},1*{checksum(f'{address},1'.encode()):02X}", (0, 0, 1, 0))
          for address in ("HEHD", "HEHDTT", "HE-DT", "HEHdT", "hehdt", "-----", "12345", "")),
        ("$HEHDT,41.87,T*25\r\n$HEHDT,41.87,T*25", (2, 0, 0, 0)),
    ],
)  # fmt: skip
def test_each_line_counts_once_as_what_it_is(line: str, counts: tuple[int, int, int, int]) -> None:
    framer = NmeaFramer()
    found = framer.feed(line.encode() + b"\r\n")
    assert framer.counts == counts and len(found) == counts[0]
    framer.feed(line.encode() + b"\r\n")
    assert framer.counts == tuple(2 * count for count in counts)


def test_a_sentence_of_102_characters_is_taken_and_a_longer_one_is_not() -> None:
    for size, is_taken in ((102, True), (103, False)):
        body = "GPTXT," + "x" * (size - 10)
        line = f"${body}*{checksum(body.encode()):02X}".encode()
        assert len(line) == size
        for chunks in ([line + b"\r\n"], [line[:90], line[90:], b"\r\n"]):
            framer = NmeaFramer()
            assert sum(len(framer.feed(chunk)) for chunk in chunks) == is_taken
            assert framer.counts.malformed == (not is_taken)
