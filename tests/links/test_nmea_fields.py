"""Fields of NMEA 0183 at both sides of every limit, and the encoders' layouts by numbers worked out by hand."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.links.nmea import sentences as encoders
from autopilot.links.nmea.samples import Deviation, NmeaReader
from autopilot.links.nmea.sentences import NmeaFramer, format_sentence
from autopilot.signals import (
    CourseSample,
    HeadingSample,
    PositionSample,
    RateSample,
    RudderSample,
    SpeedSample,
    WindSample,
)

KNOT = 1852.0 / 3600.0


def read(body: str, **options: object) -> tuple[object, str]:
    """Return the sample in a sentence, and what else became of it."""
    total = 0
    for byte in body.encode():
        total ^= byte
    framer = NmeaFramer()
    (sentence,) = framer.feed(f"${body}*{total:02X}\r\n".encode())
    reader = NmeaReader(**options)  # type: ignore[arg-type]
    sample = reader.read(2.5, sentence)
    kinds = {
        "malformed": reader.malformed,
        "invalid": reader.invalid,
        "ignored": reader.ignored,
        "variation": reader.waiting_for_variation,
    }
    named = [name for name, count in kinds.items() if count]
    assert len(named) <= 1 and set(kinds.values()) <= {0, 1} and (sample is None) is bool(named)
    assert reader.unusable == (kinds["variation"] and ("HD" in body[:5] or "THS" in body[:5]))
    return sample, named[0] if named else ""


@pytest.mark.parametrize(
    ("body", "fate"),
    [
        ("HEHDT,360.0,T", ""),
        ("HEHDT,360.1,T", "malformed"),
        ("HEHDT,0,T", ""),
        ("HEHDT,-0.1,T", "malformed"),
        ("HEHDT,10.0,M", "malformed"),
        ("HEHDT,,T", "invalid"),
        ("HEHDT,1e2,T", "malformed"),
        ("HEHDT, 10,T", "malformed"),
        ("HEHDT,nan,T", "malformed"),
        ("AGHDT,10.0,T", "ignored"),
        ("HCHDM,10.0,T", "malformed"),
        ("HCHDM,10.0,M", "variation"),
        ("HCHDG,10.0,,,,", "variation"),
        ("HCHDG,10.0,90.0,E,180.0,W", ""),
        ("HCHDG,10.0,90.1,E,1.0,W", "malformed"),
        ("HCHDG,10.0,1.0,E,180.1,W", "malformed"),
        ("HCHDG,10.0,1.0,N,1.0,W", "malformed"),
        ("HCHDG,10.0,1.0,E,1.0,", "malformed"),
        ("HETHS,10.0,A", ""),
        ("HETHS,10.0,V", "invalid"),
        ("HETHS,10.0,N", "invalid"),
        ("HETHS,10.0,", "malformed"),
        ("HETHS,10.0,Q", "malformed"),
        *((f"HETHS,10.0,{mode}", "") for mode in "DEFPR"),
        *((f"HETHS,10.0,{mode}", "invalid") for mode in "MS"),
        ("TIROT,10000.0,A", ""),
        ("TIROT,-10000.0,A", ""),
        ("TIROT,10000.1,A", "malformed"),
        ("TIROT,-10000.1,A", "malformed"),
        ("TIROT,1.0,V", "invalid"),
        ("TIROT,1.0,", "malformed"),
        ("IIRSA,90.0,A,,V", ""),
        ("IIRSA,-90.0,A,,V", ""),
        ("IIRSA,90.1,A,,V", "malformed"),
        ("IIRSA,-90.1,A,,V", "malformed"),
        ("IIRSA,1.0,V,2.0,A", "invalid"),
        ("WIMWV,10.0,R,5.0,M,A", ""),
        ("WIMWV,10.0,T,5.0,M,A", "invalid"),
        ("WIMWV,10.0,R,5.0,M,V", "invalid"),
        ("WIMWV,10.0,R,5.0,S,A", "malformed"),
        ("WIMWV,10.0,R,200.0,M,A", ""),
        ("WIMWV,10.0,R,200.1,M,A", "malformed"),
        ("WIMWV,10.0,R,-0.1,M,A", "malformed"),
        ("GPVTG,1,T,,M,200.0,N,,K,A", ""),
        ("GPVTG,1,T,,M,200.1,N,,K,A", "malformed"),
        ("GPVTG,1,T,,M,-0.1,N,,K,A", "malformed"),
        ("GPVTG,1,T,,M,5.0,K,,K,A", "malformed"),
        ("GPVTG,1,T,,M,5.0,N,,K,N", "invalid"),
        ("GPVTG,1,T,,M,5.0,N,,K,S", "invalid"),
        ("GPVTG,1,T,,M,5.0,N,,K,E", ""),
        ("GPVTG,1,T,,M,5.0,N,,K", ""),
        ("GPVTG,1,T,,M,,N,5.0,N,A", "malformed"),
        ("GPVTG,1,T,,M,5.0,,18.0,K,A", "malformed"),
        ("GPVTG,1,T,,M,,N,200.0,K,A", ""),
        ("GPVTG,1,T,,M,,N,200.1,K,A", "malformed"),
        ("GPVTG,1,T,,M,,N,-0.1,K,A", "malformed"),
        ("VWVHW,,T,,M,,N,-200.0,K", ""),
        ("VWVHW,,T,,M,,N,-200.1,K", "malformed"),
        ("GPVTG,1,T,,M,,N,,K,A", "invalid"),
        ("VWVHW,,T,,M,-200.0,N,,K", ""),
        ("VWVHW,,T,,M,-200.1,N,,K", "malformed"),
        ("GPRMC,0,A,,,,,5.0,1.0,010126,,,A", ""),
        ("GPRMC,0,V,,,,,5.0,1.0,010126,,,A", "invalid"),
        ("GPRMC,0,A,,,,,5.0,1.0,010126,,,N", "invalid"),
        ("GPRMC,0,A,,,,,5.0,1.0,010126,,,S", "invalid"),
        ("GPRMC,0,A,,,,,5.0,1.0,010126,180.1,E,A", "malformed"),
        ("GPRMC,0,A,,,,,-1.0,1.0,010126,,,A", "malformed"),
        ("GPRMC,0,A,9000.0,N,18000.0,E,5.0,1.0,010126,,,A", ""),
        ("GPRMC,0,A,9000.1,N,18000.0,E,5.0,1.0,010126,,,A", "malformed"),
        ("GPRMC,0,A,9000.0,N,18000.1,E,5.0,1.0,010126,,,A", "malformed"),
        ("GPRMC,0,A,4559.999,N,00000.0,W,5.0,1.0,010126,,,A", ""),
        ("GPRMC,0,A,4560.0,N,00000.0,W,5.0,1.0,010126,,,A", "malformed"),
        ("GPRMC,0,A,4500.0,E,00000.0,W,5.0,1.0,010126,,,A", "malformed"),
        ("GPRMC,0,A,450.0,N,00000.0,W,5.0,1.0,010126,,,A", "malformed"),
        ("GPRMC,0,A,45.5,N,00000.0,W,5.0,1.0,010126,,,A", "malformed"),
    ],
)
def test_a_field_is_taken_up_to_its_limit_and_no_further(body: str, fate: str) -> None:
    assert read(body)[1] == fate


@pytest.mark.parametrize(
    ("body", "sample"),
    [
        ("HEHDT,90.0,T", HeadingSample(2.5, math.pi / 2, None, "HEHDT")),
        ("HEHDT,270.0,T", HeadingSample(2.5, -math.pi / 2, None, "HEHDT")),
        ("HCHDG,90.0,3.0,E,8.0,W", HeadingSample(2.5, math.radians(85.0), None, "HCHDG")),
        ("HCHDG,90.0,3.0,W,8.0,E", HeadingSample(2.5, math.radians(95.0), None, "HCHDG")),
        ("TIROT,-60.0,A", RateSample(2.5, math.radians(-1.0), "TIROT")),
        ("IIRSA,-30.0,A,,V", RudderSample(2.5, math.radians(-30.0), False, "IIRSA")),
        ("WIMWV,270.0,R,10.0,N,A", WindSample(2.5, -math.pi / 2, 10.0 * KNOT, "WIMWV")),
        ("WIMWV,90.0,R,36.0,K,A", WindSample(2.5, math.pi / 2, 10.0, "WIMWV")),
        ("WIMWV,0.0,R,7.0,M,A", WindSample(2.5, 0.0, 7.0, "WIMWV")),
        ("GPVTG,1,T,,M,10.0,N,99.0,K,A", SpeedSample(2.5, 10.0 * KNOT, True, "GPVTG")),
        ("GPVTG,1,T,,M,,N,36.0,K,A", SpeedSample(2.5, 10.0, True, "GPVTG")),
        # knots go before, however little else is filled in
        ("GPVTG,1,T,,M,10.0,N,99.0,K", SpeedSample(2.5, 10.0 * KNOT, True, "GPVTG")),
        ("GPVTG,1,T,,M,10.0,N,99.0,", SpeedSample(2.5, 10.0 * KNOT, True, "GPVTG")),
        ("VWVHW,,T,,M,10.0,N,99.0", SpeedSample(2.5, 10.0 * KNOT, False, "VWVHW")),
        ("VWVHW,,T,,M,,N,36.0,K", SpeedSample(2.5, 10.0, False, "VWVHW")),
        ("VWVHW,,T,,M,-1.0,N,,K", SpeedSample(2.5, -KNOT, False, "VWVHW")),
        ("GPRMC,0,A,,,,,5.0,1.0,010126,,,A", SpeedSample(2.5, 5.0 * KNOT, True, "GPRMC")),
    ],
)
def test_each_sentence_by_numbers_worked_out_by_hand(body: str, sample: tuple[object, ...]) -> None:
    found, _ = read(body)
    assert type(found) is type(sample)
    for got, wanted in zip(found, sample, strict=True):  # type: ignore[call-overload]
        assert got == (pytest.approx(wanted) if isinstance(wanted, float) else wanted)


def test_the_deviation_table_is_interpolated_round_the_card() -> None:
    table = Deviation(tuple((math.radians(at), math.radians(off)) for at, off in ((350.0, 2.0), (30.0, -6.0))))
    for at, off in ((350.0, 2.0), (0.0, 0.0), (10.0, -2.0), (30.0, -6.0), (190.0, -2.0), (-10.0, 2.0), (730.0, -2.0)):
        assert math.degrees(table.at(math.radians(at))) == pytest.approx(off)
    sample, _ = read("HCHDG,10.0,,,5.0,E", deviation=table)
    assert math.degrees(sample.heading) == pytest.approx(13.0)  # type: ignore[attr-defined]
    sample, _ = read("HCHDG,10.0,1.0,E,5.0,E", deviation=table)
    assert math.degrees(sample.heading) == pytest.approx(16.0), "its own"  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match="twice"):
        Deviation(((0.0, 0.1), (math.tau, 0.2)))


def body(sentence: bytes) -> str:
    return sentence.decode()[1:-5]


@pytest.mark.parametrize(
    ("seconds", "clock"),
    [
        (0.0, "000000.00"),
        (59.99, "000059.99"),
        (60.0, "000100.00"),
        (3599.0, "005959.00"),
        (3600.0, "010000.00"),
        (45296.78, "123456.78"),
        (86399.99, "235959.99"),
        (86399.996, "000000.00"),
        (86400.0, "000000.00"),
    ],
)
def test_the_time_of_day(seconds: float, clock: str) -> None:
    assert body(encoders.encode_rmc(0.0, 0.0, 0.0, 0.0, seconds)).split(",")[1] == clock


@pytest.mark.parametrize(
    ("latitude", "longitude", "fields"),
    [
        (54.5, 10.25, "5430.0000,N,01015.0000,E"),
        (-54.5, -10.25, "5430.0000,S,01015.0000,W"),
        (0.0, 0.0, "0000.0000,N,00000.0000,E"),
        (89.9999999, 179.9999999, "9000.0000,N,18000.0000,E"),
        (1.0 / 60.0, 100.0 + 1.2345 / 60.0, "0001.0000,N,10001.2345,E"),
    ],
)
def test_a_place_in_degrees_and_minutes(latitude: float, longitude: float, fields: str) -> None:
    assert ",".join(body(encoders.encode_rmc(0.0, 0.0, latitude, longitude)).split(",")[3:7]) == fields


@given(st.floats(-90.0, 90.0), st.floats(-180.0, 180.0))
def test_a_place_is_read_again_within_a_twenty_thousandth_of_a_minute(latitude: float, longitude: float) -> None:
    """Four decimals of a minute, each 0.185 m: what is read lies within half of one."""
    reader = NmeaReader()
    (sentence,) = NmeaFramer().feed(encoders.encode_rmc(0.0, 0.0, latitude, longitude))
    assert isinstance(reader.read(3.0, sentence), SpeedSample)
    place, course = reader.take_others()
    assert isinstance(place, PositionSample) and isinstance(course, CourseSample)
    assert place.time == course.time == 3.0 and reader.take_others() == []
    half = 0.5e-4 / 60.0 + 1e-9
    assert math.degrees(place.latitude) == pytest.approx(latitude, abs=half)
    assert math.degrees(place.longitude) == pytest.approx(longitude, abs=half)
    minutes = [field[-7:] for field in (sentence.fields[2], sentence.fields[4])]
    assert all(float(each) < 60.0 for each in minutes)


@pytest.mark.parametrize("empty", ["", "4530.0,N,,", ",,01015.0,E"])
def test_a_speed_comes_without_a_place_and_a_place_only_whole(empty: str) -> None:
    reader = NmeaReader()
    line = f"GPRMC,0,A,{empty or ',,,'},5.0,1.0,010126,,,A"
    address, *fields = line.split(",")
    (sentence,) = NmeaFramer().feed(format_sentence(address[:2], address[2:], fields))
    assert isinstance(reader.read(0.0, sentence), SpeedSample)
    assert [type(each) for each in reader.take_others()] == [CourseSample]


def test_every_nmea_encoder_writes_the_expected_sentence() -> None:
    radians = math.radians
    whole = [
        (encoders.encode_hdt(radians(7.24)), "HEHDT,007.2,T"),
        (encoders.encode_hdt(radians(-0.04)), "HEHDT,000.0,T"),
        (encoders.encode_hdt(radians(-0.06), decimals=2), "HEHDT,359.94,T"),
        (encoders.encode_hdm(radians(123.4)), "HCHDM,123.4,M"),
        (encoders.encode_hdg(radians(10.0)), "HCHDG,010.0,,,,"),
        (encoders.encode_hdg(radians(10.0), radians(-1.5), radians(2.5)), "HCHDG,010.0,1.5,W,2.5,E"),
        (encoders.encode_hdg(radians(10.0), 0.0, None), "HCHDG,010.0,0.0,E,,"),
        (encoders.encode_ths(radians(10.0)), "HETHS,010.0,A"),
        (encoders.encode_rot(radians(-1.0)), "TIROT,-60.0,A"),
        (encoders.encode_rot(-1e-9, False), "TIROT,0.0,V"),
        (encoders.encode_rsa(radians(-5.0)), "IIRSA,-5.0,A,,V"),
        (encoders.encode_rsa(radians(5.0), port=radians(4.0)), "IIRSA,5.0,A,4.0,A"),
        (encoders.encode_rsa(radians(5.0), False, radians(4.0)), "IIRSA,5.0,V,4.0,V"),
        (encoders.encode_ror(radians(-12.346), True), "AGROR,-12.35,A,,V,B"),
        (encoders.encode_ror(0.0, False), "AGROR,0.00,V,,V,B"),
        (encoders.encode_vhw(5.0), "VWVHW,,T,,M,9.72,N,18.00,K"),
        (encoders.encode_vhw(5.0, radians(9.0), radians(350.0)), "VWVHW,009.0,T,350.0,M,9.72,N,18.00,K"),
        (encoders.encode_vtg(radians(9.0), 5.0), "GPVTG,009.0,T,,M,9.72,N,18.00,K,A"),
        (encoders.encode_vtg(radians(9.0), 5.0, radians(8.0), "N"), "GPVTG,009.0,T,008.0,M,9.72,N,18.00,K,N"),
        (
            encoders.encode_rmc(radians(9.0), 5.0, 1.0, 2.0, 61.5, (3, 4, 2026), radians(-2.0)),
            "GPRMC,000101.50,A,0100.0000,N,00200.0000,E,9.72,009.0,030426,2.0,W,A",
        ),
        (
            encoders.encode_rmc(radians(9.0), 5.0, 1.0, 2.0, valid=False),
            "GPRMC,000000.00,V,0100.0000,N,00200.0000,E,9.72,009.0,010126,,,N",
        ),
    ]
    for sentence, expected in whole:
        assert body(sentence) == expected
