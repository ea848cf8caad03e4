"""The MMG tanker against the free-running model of MARIN, an independent package, and Froude's law."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pytest

from autopilot.errors import InputError
from autopilot.files.strict_yaml import parse_document
from autopilot.vessel.file import load_vessel
from sitl import mmg_tanker as mmg
from sitl.boat import STILL, Boat, BoatState
from sitl.registry import PLANTS
from sitl.scenario import Scenario, scenario_from
from sitl.world import World

DT = 0.01
SPEED = mmg.SERVICE_SPEED


class Circle(NamedTuple):
    """Advance and tactical diameter in lengths; seconds to 90 deg."""

    advance: float
    diameter: float
    quarter: float


def tanker(scale: float = 1.0, depth: float | None = None) -> Any:
    scenario = Scenario(1, "trial", plant="mmg_tanker", scale=scale, depth_draughts=depth)
    return PLANTS["mmg_tanker"].of(None, scenario)  # type: ignore[arg-type]


def boat_of(plant: Any, speed: float) -> Boat:
    return Boat(plant, BoatState(speed=speed, north_speed=speed), PLANTS["mmg_tanker"].step)


def circle(plant: Any, speed: float, rudder_deg: float, dt: float = DT) -> Circle:
    """A turn with the engine as it was."""
    boat, time, quarter, advance = boat_of(plant, speed), 0.0, 0.0, 0.0
    while abs(boat.state.heading) < math.pi:
        boat.step(time, math.radians(rudder_deg), speed, STILL, dt)
        time += dt
        if not quarter and abs(boat.state.heading) >= 0.5 * math.pi:
            quarter, advance = time, boat.state.north
    return Circle(advance / plant.length, abs(boat.state.east) / plant.length, quarter)


def overshoots(plant: Any, rudder_deg: float, heading_deg: float, dt: float = DT) -> list[float]:
    """First and second overshoot [deg] of a zigzag; the first rudder is to starboard where it is positive."""
    boat, time, side, angle = boat_of(plant, SPEED), 0.0, math.copysign(1.0, rudder_deg), math.radians(heading_deg)
    executed, farthest = [], [0.0]
    while len(executed) < 3:
        state = boat.step(time, side * math.radians(abs(rudder_deg)), SPEED, STILL, dt)
        time += dt
        farthest[-1] = max(farthest[-1], abs(state.heading))
        if side * state.heading >= angle:
            side = -side
            executed.append(time)
            farthest.append(0.0)
    return [math.degrees(peak - angle) for peak in farthest[1:3]]


def test_turning_circles_are_those_of_the_free_running_model() -> None:
    """MARIN's KVLCC2 for the SIMMAN 2008 workshop, Lpp 7.0 m at 15.5 kn of the ship, 35 deg to port: advance 3.01 L,
    tactical diameter 3.08 L, 164 s of the ship to 90 deg; read from the published time series. Ten per cent is asked of
    a simulation from captive tests."""
    port, starboard = (circle(tanker(), SPEED, angle) for angle in (-35.0, 35.0))
    assert port.advance == pytest.approx(3.01, rel=0.1)
    assert port.diameter == pytest.approx(3.08, rel=0.1)
    assert port.quarter * math.sqrt(mmg.SHIP_LENGTH / mmg.LENGTH) == pytest.approx(164.0, rel=0.1)
    assert starboard.advance == pytest.approx(port.advance, rel=0.05), "one screw makes a slight difference"
    assert starboard.diameter == pytest.approx(port.diameter, rel=0.05)


def test_zigzags_overshoot_as_a_tanker_near_neutral_does() -> None:
    """MARIN's 10/10 to port first: 9.5 deg, which three degrees about are asked of. The second overshoot is the larger,
    as that of every ship that hardly keeps its course by itself."""
    first, second = overshoots(tanker(), -10.0, 10.0)
    assert first == pytest.approx(9.5, abs=3.0)
    assert second > first
    starboard = overshoots(tanker(), 10.0, 10.0)
    assert starboard[0] < first
    assert starboard[1] > starboard[0]
    # IMO's MSC.137(76) limit for L/V of 40 s and more, which KVLCC2 meets
    assert first < 20.0 and overshoots(tanker(), 20.0, 20.0)[0] < 25.0


def test_without_its_screw_port_mirrors_starboard() -> None:
    plant = tanker()._replace(
        propeller=mmg.Propeller(c2_port=1.6), rudder=mmg.Rudder(straightening_port=0.5, straightening_starboard=0.5)
    )
    one, other = (boat_of(plant, SPEED) for _ in range(2))
    for step in range(3000):
        here, there = (boat.step(step * DT, side * 0.4, SPEED, STILL, DT) for boat, side in ((one, 1.0), (other, -1.0)))
        assert here.speed == pytest.approx(there.speed, rel=1e-12)
        assert (here.sway, here.rate, here.heading) == pytest.approx((-there.sway, -there.rate, -there.heading))


def test_froude_enlarges_everything_but_the_wake() -> None:
    """A model five times as long does the same in sqrt(5) times the time; the ship's wake is its own."""
    root = math.sqrt(5.0)
    small, large = circle(tanker(), SPEED, 20.0), circle(tanker(5.0), SPEED * root, 20.0, DT * root)
    assert large.advance == pytest.approx(small.advance, rel=1e-9)
    assert large.quarter == pytest.approx(small.quarter * root, rel=1e-9)
    assert tanker(320.0 / 7.0).propeller.wake == 0.35
    ship = circle(tanker(320.0 / 7.0), 15.5 * 1852.0 / 3600.0, 35.0, 0.05)
    assert 2.5 < ship.advance < 3.5 and 2.5 < ship.diameter < 3.5


def test_without_way_the_race_alone_steers_and_sternway_turns_it_round() -> None:
    ahead = boat_of(tanker(), 0.0)
    for step in range(200):
        ahead.step(step * DT, 0.3, SPEED, STILL, DT)
    assert ahead.state.rate > 0.0
    astern = boat_of(tanker(), -0.3)
    for step in range(300):
        astern.step(step * DT, 0.3, -0.3, STILL, DT)
    assert astern.state.rate < 0.0


def test_deep_water_is_the_papers_and_so_is_water_without_a_bottom_that_counts() -> None:
    deep, bottomless = tanker(), tanker(depth=100.0)
    assert (deep.forces, deep.mass, deep.propeller) == (mmg.HullForces(), mmg.Mass(), mmg.Propeller())
    assert bottomless.forces == pytest.approx(deep.forces, rel=5e-3)
    assert bottomless.mass == pytest.approx(deep.mass, rel=5e-3)
    assert bottomless.revolutions == pytest.approx(deep.revolutions, rel=5e-3)


def test_the_shallower_the_water_the_wider_the_turn() -> None:
    """Okuda, Yasukawa, Sano and Matsuda 2025 (J Mar Sci Technol 30), free-running models of four ships: to a depth of
    two draughts the tactical diameter is about that of deep water, below it becomes significantly larger, and so does
    the advance. Koseki et al. 1969, a large tanker among two: at 1 1/3 draughts r L/U is 50 to 60 % of that in deep
    water; ours has 67 %, and three quarters is asked of it."""
    deep, two, half, least = (circle(tanker(depth=depth), SPEED, 35.0, 0.05) for depth in (None, 2.0, 1.5, 1.2))
    assert two.diameter == pytest.approx(deep.diameter, rel=0.1)
    assert 1.1 * deep.diameter < half.diameter < 1.5 * deep.diameter < least.diameter
    assert two.advance < half.advance < least.advance
    assert swing(tanker(depth=4.0 / 3.0)) < 0.75 * swing(tanker())


def swing(plant: Any) -> float:
    """r L/U [-] of a steady turn with full rudder."""
    boat = boat_of(plant, SPEED)
    for step in range(2400):
        boat.step(step * 0.05, math.radians(35.0), SPEED, STILL, 0.05)
    state = boat.state
    return float(state.rate * plant.length / math.hypot(state.speed, state.sway))


def test_overshoots_grow_a_little_to_two_draughts_and_all_but_vanish_below() -> None:
    """The same models, 20/20: a little more than in deep water near two draughts, significantly less below."""
    deep, two, least = (overshoots(tanker(depth=depth), 20.0, 20.0, 0.05) for depth in (None, 2.0, 1.2))
    assert deep[0] < two[0] < 1.3 * deep[0]
    assert least[0] < 0.5 * deep[0] and least[1] < 0.5 * deep[1]


def test_a_straight_course_is_as_fast_as_the_engine_is_ordered_in_any_depth() -> None:
    boat = boat_of(tanker(depth=1.2), SPEED)
    for step in range(400):
        boat.step(step * 0.05, 0.0, SPEED, STILL, 0.05)
    assert boat.state.speed == pytest.approx(SPEED, rel=0.01)


def test_depths_that_no_formula_covers_and_boats_that_know_none_are_refused() -> None:
    text = "schema_version: 1\nname: flat\nplant: {}\ndepth_draughts: {}\n"
    with pytest.raises(InputError, match=r"depth_draughts.*1\.1.*1\.2"):
        scenario_from(parse_document(text.format("mmg_tanker", 1.1), "flat.yaml"))
    outboard = scenario_from(parse_document(text.format("outboard", 1.5), "flat.yaml"))
    with pytest.raises(InputError, match=r"plant outboard: depth_draughts is 1\.5.*only mmg_tanker"):
        World(load_vessel("outboard"), outboard)
    assert scenario_from(parse_document(text.format("mmg_tanker", 1.5), "flat.yaml")).depth_draughts == 1.5


@pytest.mark.parametrize("rudder_deg", [10.0, -35.0])
def test_hull_propeller_and_rudder_are_those_of_shipmmg(rudder_deg: float) -> None:
    """A minute of turning against the package `shipmmg` (Runge-Kutta of order 4 and 5, tolerance 1e-9).

    Its wake changes otherwise in a turn, and it puts the centre of gravity elsewhere into the drift: both are set to
    nothing on both sides. What is left is every other equation.
    """
    shipmmg = pytest.importorskip("shipmmg.mmg_3dof", reason="pip install --no-deps shipmmg")
    wake, revolutions, length, draught, density = 0.0, 11.0, mmg.LENGTH, mmg.DRAUGHT, 1000.0
    hull, mass, propeller, rudder = mmg.HullForces(), mmg.Mass(), mmg.Propeller(wake=wake, c1=0.0), mmg.Rudder()
    unit = 0.5 * density * length**2 * draught
    particulars = shipmmg.Mmg3DofBasicParams(
        L_pp=length,
        B=mmg.BEAM,
        d=draught,
        x_G=0.0,
        D_p=0.216,
        m=density * 3.27,
        I_zG=density * 3.27 * (0.25 * length) ** 2,
        A_R=0.0539,
        η=0.216 / 0.345,
        m_x=unit * mass.surge,
        m_y=unit * mass.sway,
        J_z=unit * length**2 * mass.yaw,
        f_α=rudder.lift_slope,
        ϵ=rudder.wake_ratio,
        t_R=rudder.deduction,
        x_R=rudder.place * length,
        a_H=rudder.increase,
        x_H=rudder.increase_at * length,
        γ_R_minus=rudder.straightening_port,
        γ_R_plus=rudder.straightening_starboard,
        l_R=rudder.rate_lever,
        κ=rudder.race,
        t_P=propeller.deduction,
        w_P0=wake,
        x_P=propeller.place,
    )
    derivatives = {f"{name[0].upper()}_{name[2:]}_dash": value for name, value in hull._asdict().items() if "_" in name}
    coefficients = shipmmg.Mmg3DofManeuveringParams(
        k_0=propeller.k0, k_1=propeller.k1, k_2=propeller.k2, R_0_dash=hull.resistance, **derivatives
    )
    times = np.linspace(0.0, 60.0, 6001)
    peer = shipmmg.simulate_mmg_3dof(
        particulars,
        coefficients,
        list(times),
        [math.radians(rudder_deg)] * len(times),
        [revolutions] * len(times),
        u0=SPEED,
        ρ=density,
        rtol=1e-9,
        atol=1e-10,
    ).sol(times)[:, -1]
    plant = tanker()._replace(
        mass=mmg.Mass(centre=0.0), propeller=propeller, revolutions=revolutions / SPEED, gear=mmg.GEAR._replace(lag=0.0)
    )
    start = BoatState(speed=SPEED, north_speed=SPEED, rudder=math.radians(rudder_deg))
    boat = Boat(plant, start, PLANTS["mmg_tanker"].step)
    for step in range(6000):
        boat.step(step * DT, math.radians(rudder_deg), SPEED, STILL, DT)
    state = boat.state
    assert (state.speed, state.sway, state.rate) == pytest.approx(tuple(peer[:3]), rel=1e-6)
    assert (state.north, state.east, state.heading) == pytest.approx(tuple(peer[3:6]), abs=2e-3)
