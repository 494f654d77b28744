"""Options of the command line: one for every field, and the ways to write them."""

import pytest

from weldcell.cell.configuration import Disturbance
from weldcell.cell.errors import BadInput
from weldcell.scenarios.options import Parser, add_field_options, given_fields, normalised
from weldcell.scenarios.settings import fields, option_name, resolve


def given(*words):
    parser = Parser(prog="weldcell run")
    parser.add_argument("scenario")
    add_field_options(parser)
    return given_fields(parser.parse_args(normalised(words)))


def words_of(value):
    if isinstance(value, tuple):
        return [word for item in value for word in words_of(item)]
    return [str(value).lower() if isinstance(value, bool) else str(value)]


@pytest.mark.parametrize("field", fields(), ids=lambda field: field.path)
def test_every_field_can_be_given_as_an_option(field):
    options = given("v-seam", option_name(field.path), *words_of(field.default))
    assert list(options) == [field.path]
    assert resolve("v-seam", options=options) == resolve("v-seam")


def test_underscores_hyphens_and_equals_signs_all_work():
    for words in (["--sensor.peak-grey", "180"], ["--sensor.peak_grey", "180"], ["--sensor.peak_grey=180"]):
        assert given("boss", *words) == {"sensor.peak_grey": 180}


def test_only_the_name_of_an_option_is_normalised():
    assert normalised(["--out=a_b", "--out", "a_b", "--", "--a_b"]) == ["--out=a_b", "--out", "a_b", "--", "--a_b"]


@pytest.mark.parametrize(
    ("words", "value"),
    [
        (["--sensor.noise", "v-seam"], True),
        (["v-seam", "--sensor.noise"], True),
        (["--sensor.noise", "false", "v-seam"], False),
        (["--sensor.noise=False", "v-seam"], False),
        (["--sensor.noise", "true", "v-seam"], True),
        (["--no-sensor.noise", "v-seam"], False),
    ],
)
def test_switches_take_a_word_or_none(words, value):
    assert given(*words) == {"sensor.noise": value}


def test_negative_numbers_and_exponents_are_values():
    assert given("boss", "--boss.position-mm", "-1e-4", "-.5", "-3") == {"boss.position_mm": [-1e-4, -0.5, -3]}


def test_points_are_given_one_after_the_other():
    options = given("boss", "--calibration.near-points-mm", "1", "2", "3", "4", "5", "6")
    assert resolve("boss", options=options).config.calibration.near_points_mm == ((1, 2, 3), (4, 5, 6))


def test_disturbances_are_kinds_with_times_and_strength_if_wanted():
    options = given("v-seam", "--disturbances", "arc:2-8.5:0.5", "fume:1-3", "stripe-lost")
    assert resolve("v-seam", options=options).config.disturbances == (
        Disturbance(kind="arc", start_s=2.0, end_s=8.5, strength=0.5),
        Disturbance(kind="fume", start_s=1.0, end_s=3.0),
        Disturbance(kind="stripe-lost"),
    )


def test_a_choice_among_numbers_is_a_number():
    assert resolve("v-seam", options=given("v-seam", "--sensor.bits", "12")).config.sensor.bits == 12


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--sensor.peak-grey", "bright"], "--sensor.peak-grey: found 'bright', expected a number from 1 to 255"),
        (["--sensor.peak-grey", "nan"], "--sensor.peak-grey: found NaN, expected a number from 1 to 255"),
        (["--sensor.noise=maybe"], "--sensor.noise: found 'maybe', expected true or false"),
        (["--seam.frames", "8.5"], "--seam.frames: found 8.5, expected a whole number"),
        (["--calibration.near-points-mm", "1", "2", "3", "4"], "--calibration.near-points-mm: found [[1, 2, 3], [4]]"),
        (["--sensor.bits", "10"], "--sensor.bits: found '10', expected one of 8, 12"),
        (["--disturbances", "arc:5"], "--disturbances: found 'arc:5', expected KIND[:START-END[:STRENGTH]], e.g."),
        (["--disturbances", "arc:5-3"], "--disturbances[0]: found arc from 5 to 3 s, expected the smaller one first"),
        (["--disturbances", "arc", "ark:1-2"], "--disturbances[1].kind: found 'ark', expected one of arc"),
        (["--robot", "good"], "--robot: found 'good', expected one of perfect"),
    ],
)
def test_a_wrong_value_is_refused_by_option(words, message):
    with pytest.raises(BadInput) as refusal:
        resolve("boss", options=given("boss", *words))
    assert str(refusal.value).startswith(message)
