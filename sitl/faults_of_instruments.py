"""Faults of compass, rate gyro, speed log and GPS; `sitl.sensors` corrupts its readings by them."""

from __future__ import annotations

from sitl.fault_kind import Kind

KINDS = {
    "heading_dropout": Kind("the compass sends nothing", silences=("ATTITUDE",), of_a_compass=True),
    "heading_frozen": Kind("the compass repeats its last heading", of_a_compass=True),
    "heading_jump": Kind("the compass is off by a constant", "deg", 40.0, -180.0, 180.0, of_a_compass=True),
    "heading_drift": Kind("the compass wanders off", "deg/s", 1.0, -30.0, 30.0, of_a_compass=True),
    "heading_noise": Kind("the compass is noisy, standard deviation", "deg", 10.0, 0.0, 180.0, of_a_compass=True),
    "heading_spikes": Kind(
        "single headings are anything at all", "share of headings", 0.1, 0.0, 1.0, of_a_compass=True
    ),
    "heading_nan": Kind("the flight controller sends a heading that is no number"),
    "heading_late": Kind("heading, rate and roll leave the sensor late", "s", 1.0, 0.0, 10.0),
    "heading_lag": Kind("headings are older than their time stamps say", "s", 0.3, 0.0, 10.0, of_a_compass=True),
    "rate_bias": Kind("the rate gyro is off by a constant", "deg/s", 5.0, -90.0, 90.0, of_a_compass=True),
    "rate_frozen": Kind("the rate gyro repeats its last value", of_a_compass=True),
    "rate_noise": Kind("the rate gyro is noisy, standard deviation", "deg/s", 5.0, 0.0, 90.0, of_a_compass=True),
    "rate_reversed": Kind("the rate gyro has the wrong sign", of_a_compass=True),
    "rate_lag": Kind("rates of turn are older than their time stamps say", "s", 0.3, 0.0, 10.0, of_a_compass=True),
    "speed_lost": Kind(
        "no speed, through the water or over the ground, is sent",
        silences=(
            "GLOBAL_POSITION_INT",
            "LOCAL_POSITION_NED",
            "VFR_HUD",
            "VHW",
            "VTG",
        ),
    ),
    "log_lost": Kind("no speed through the water is sent; that over the ground remains", silences=("VHW",)),
    "speed_frozen": Kind("speeds repeat their last values"),
    "speed_wrong": Kind("speeds are multiplied", "times", 3.0, 0.0, 100.0),
    "position_lost": Kind("the GPS has no position", silences=("RMC",)),
    "position_jump": Kind("the GPS shows a place to the north", "m", 200.0, -20000.0, 20000.0),
}
