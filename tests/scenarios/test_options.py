"""Options of the command line: one for every field, and the ways to write them."""

import pytest

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


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--sensor.peak-grey", "bright"], "--sensor.peak-grey: found 'bright', expected a number from 1 to 255"),
        (["--sensor.peak-grey", "nan"], "--sensor.peak-grey: found NaN, expected a number from 1 to 255"),
        (["--sensor.noise=maybe"], "--sensor.noise: found 'maybe', expected true or false"),
        (["--seam.frames", "8.5"], "--seam.frames: found 8.5, expected a whole number"),
        (["--calibration.near-points-mm", "1", "2", "3", "4"], "--calibration.near-points-mm: found [[1, 2, 3], [4]]"),
        (["--robot", "good"], "--robot: found 'good', expected one of perfect"),
    ],
)
def test_a_wrong_value_is_refused_by_option(words, message):
    with pytest.raises(BadInput) as refusal:
        resolve("boss", options=given("boss", *words))
    assert str(refusal.value).startswith(message)
