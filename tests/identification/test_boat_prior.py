"""What other boats say of one: it helps where a recording is short, is named, and gives way to the recording."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.cli.main import main
from autopilot.identification.boat_prior import Expected, KnownBoat, combined, primes, prior_of
from autopilot.identification.marginal_likelihood import Rates
from autopilot.models.norrbin import Norrbin
from autopilot.vessel.file import PUBLISHED, boats_prior, load_vessel, published_boats

EXPECTED = Expected(np.array([math.log(0.2), 0.3, math.log(5.0)]), np.array([0.5, 0.2, 0.6]), 10)
TRUTH = Rates(0.22, 0.25, 6.0, 0.01)
SHARP = np.diag([1.0e-4, 1.0e-4, 1.0e-2, 1.0e-6]) ** 2
VAGUE = np.diag([0.1, 2.0, 60.0, 0.1]) ** 2


def test_a_recording_that_knows_the_boat_is_left_as_it_is() -> None:
    found = combined(TRUTH, SHARP, EXPECTED)
    assert found.rates == TRUTH
    assert found.shares == (0.0, 0.0, 0.0)
    assert np.array_equal(found.covariance, SHARP)


def test_a_recording_that_knows_nothing_gives_what_is_expected() -> None:
    found = combined(TRUTH, VAGUE * 1.0e4, EXPECTED)
    assert found.rates.a == pytest.approx(0.2, rel=0.02)
    assert found.rates.b == pytest.approx(0.3, abs=0.02)
    assert found.rates.d == pytest.approx(5.0, rel=0.05)
    assert min(found.shares) > 0.95
    deviations = np.sqrt(np.diag(found.covariance))[:3] / [found.rates.a, 1.0, found.rates.d]
    assert deviations == pytest.approx(EXPECTED.deviation, rel=0.05)


@given(st.floats(0.05, 0.8), st.floats(-0.5, 1.0), st.floats(0.5, 40.0), st.floats(-3.0, 3.0))
def test_shares_grow_as_the_recording_knows_less(a: float, b: float, d: float, vaguer: float) -> None:
    rates, covariance = Rates(a, b, d, 0.0), VAGUE * 10.0**vaguer
    near, far = combined(rates, covariance, EXPECTED), combined(rates, 10.0 * covariance, EXPECTED)
    for each in (near, far):
        assert np.all(np.linalg.eigvalsh(each.covariance) > 0.0)
        assert all(0.0 <= share <= 1.0 for share in each.shares)
        assert each.covariance[1, 1] <= covariance[1, 1] * 10.0
    if not near.contradicted:
        assert far.shares[1] >= near.shares[1] - 1.0e-9


def test_what_contradicts_the_other_boats_is_taken_alone() -> None:
    unlike = Rates(0.2, -2.0, 6.0, 0.0)
    found = combined(unlike, np.diag([0.01, 0.1, 1.0, 0.01]) ** 2, EXPECTED)
    assert found.contradicted
    assert found.rates == unlike


def test_expectations_scale_with_length_and_speed() -> None:
    model = Norrbin(0.1, 20.0, 120.0, reference_speed=5.0)
    larger = Norrbin(0.1 / 4.0, 80.0, 120.0 * 16.0, reference_speed=2.5)
    assert primes(KnownBoat("one", 50.0, model)) == pytest.approx(primes(KnownBoat("other", 100.0, larger)))
    others = published_boats()
    slow, quick = prior_of(others, 10.0).at(1.0), prior_of(others, 10.0).at(2.0)
    assert quick.mean[0] - slow.mean[0] == pytest.approx(2.0 * math.log(2.0))
    assert quick.mean[1] == pytest.approx(2.0 * slow.mean[1])


def test_an_n3_that_is_not_known_is_no_number() -> None:
    assert math.isnan(primes(KnownBoat("one", 50.0, Norrbin(0.1, 20.0, 120.0), n3_error=100.0))[2])


def test_too_few_boats_say_nothing() -> None:
    with pytest.raises(ValueError, match="three"):
        prior_of(published_boats()[:2], 10.0)


def test_no_boat_is_its_own_witness() -> None:
    title = load_vessel("mmg_tanker").name
    assert boats_prior(7.0).boats == len(PUBLISHED)
    for name in ("mmg_tanker", title):
        assert boats_prior(7.0, (name,)).boats == len(PUBLISHED) - 1


def test_each_published_boat_is_expected_from_the_others() -> None:
    boats, inside, of = published_boats(), 0, 0
    for boat in boats:
        prior = prior_of([other for other in boats if other is not boat], boat.length)
        off = np.abs((np.array(primes(boat)) - prior.mean) / prior.deviation)
        inside, of = inside + int(np.sum(off < 1.96)), of + int(np.sum(np.isfinite(off)))
    # 95 % of 28, less what chance takes once in a hundred
    assert inside >= of - 4


def short_log(path: Path) -> str:
    """Half a minute of a boat of 5 m, which changes course once."""
    random, psi, r, lines = np.random.default_rng(5), 0.0, 0.0, ["time_s,heading_deg,rudder_deg,speed_m_s"]
    for i in range(300):
        rudder = 10.0 if 50 <= i < 120 else -8.0 if 160 <= i < 200 else 0.0
        gust = 0.02 * math.sin(0.3 * i / 10.0)
        for _ in range(5):
            r += 0.02 * (0.5 * (math.radians(rudder) + gust) - 0.8 * r - 8.0 * r**3)
            psi += 0.02 * r
        lines.append(f"{0.1 * i:.1f},{math.degrees(psi) + 0.3 * random.standard_normal():.3f},{rudder},2.0")
    path.write_text("\n".join(lines), encoding="utf-8")
    return str(path)


def test_identify_says_how_much_is_other_boats(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = short_log(tmp_path / "short.csv")
    assert main(["identify", log]) == 0
    alone = capsys.readouterr().out
    assert main(["identify", log, "--length-m", "5"]) == 0
    helped = capsys.readouterr().out
    assert "other boats of that length" not in alone
    assert "10 other boats of that length and speed helped" in helped
