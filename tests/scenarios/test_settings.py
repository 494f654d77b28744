"""Settings: defaults, file and command line, in this order; and what is refused with which words."""

import dataclasses
import math

import pytest

from weldcell.cell.configuration import SENSOR_PRESETS, CellConfig, Disturbance
from weldcell.cell.errors import BadInput
from weldcell.scenarios.settings import fields, resolve
from weldcell.scenarios.yaml_file import write_yaml


def settings_file(tmp_path, text):
    path = tmp_path / "settings.yaml"
    path.write_text(text)
    return path


def refusal_of(tmp_path, text, scenario="v-seam"):
    with pytest.raises(BadInput) as refusal:
        resolve(scenario, file=settings_file(tmp_path, text))
    message = str(refusal.value)
    assert message.startswith(f"{tmp_path / 'settings.yaml'}: ")
    assert "\n" not in message
    return message.removeprefix(f"{tmp_path / 'settings.yaml'}: ")


def test_nothing_given_is_the_default_configuration():
    settings = resolve("v-seam")
    assert settings.config == CellConfig()
    assert settings.seed == 0


def test_the_command_line_beats_the_file_and_the_file_beats_the_defaults(tmp_path):
    file = settings_file(tmp_path, "seed: 7\nrobot: bad\nsensor:\n  peak_grey: 150\n  noise: false\n")
    settings = resolve("v-seam", file=file, options={"sensor.peak_grey": 160})
    expected = CellConfig(robot="bad", sensor=dataclasses.replace(CellConfig().sensor, peak_grey=160.0, noise=False))
    assert settings.config == expected
    assert settings.seed == 7
    assert resolve("v-seam", file=file, seed=8).seed == 8


def test_the_written_configuration_repeats_the_run(tmp_path):
    settings = resolve("boss", seed=12, options={"robot": "paper", "boss.position_mm": [1, 2.5, -1e-7]})
    write_yaml(tmp_path / "config.yaml", settings.as_mapping())
    assert resolve("boss", file=tmp_path / "config.yaml") == settings


@pytest.mark.parametrize("preset", SENSOR_PRESETS)
def test_a_preset_sets_the_whole_sensor(preset):
    assert resolve("v-seam", options={"sensor.preset": preset}).config.sensor == SENSOR_PRESETS[preset]
    assert SENSOR_PRESETS[preset].preset == preset


def test_single_fields_beat_the_preset_whichever_comes_first(tmp_path):
    expected = dataclasses.replace(SENSOR_PRESETS["p1"], width_px=1000)
    for options in (
        {"sensor.width_px": 1000, "sensor.preset": "p1"},
        {"sensor.preset": "p1", "sensor.width_px": 1000},
    ):
        assert resolve("v-seam", options=options).config.sensor == expected
    file = settings_file(tmp_path, "sensor:\n  width_px: 1000\n  preset: p1\n")
    assert resolve("v-seam", file=file).config.sensor == expected
    file = settings_file(tmp_path, "sensor:\n  width_px: 1000\n")
    assert resolve("v-seam", file=file, options={"sensor.preset": "p1"}).config.sensor == expected


def test_another_preset_keeps_only_what_a_written_configuration_changed_of_its_own(tmp_path):
    """The file holds all fields; those that are its preset's own must not survive a change of the preset."""
    written = resolve("v-seam", options={"sensor.preset": "p1", "sensor.peak_grey": 150, "robot": "bad"})
    write_yaml(tmp_path / "config.yaml", written.as_mapping())
    changed = resolve("v-seam", file=tmp_path / "config.yaml", options={"sensor.preset": "profiler"}).config
    assert changed.sensor == dataclasses.replace(SENSOR_PRESETS["profiler"], peak_grey=150.0)
    assert changed.robot == "bad"
    assert resolve("v-seam", file=tmp_path / "config.yaml") == written


def test_disturbances_are_read_from_a_file_and_written_back(tmp_path):
    text = "disturbances:\n- {kind: arc, start_s: 2, end_s: 8.5}\n- {kind: fume}\n"
    settings = resolve("v-seam", file=settings_file(tmp_path, text))
    assert settings.config.disturbances == (Disturbance(kind="arc", start_s=2, end_s=8.5), Disturbance(kind="fume"))
    write_yaml(tmp_path / "config.yaml", settings.as_mapping())
    assert resolve("v-seam", file=tmp_path / "config.yaml") == settings


def test_values_come_in_their_own_types(tmp_path):
    config = resolve("v-seam", file=settings_file(tmp_path, "seam:\n  length_mm: 200\n  position_mm: [1, 2, 3]")).config
    assert type(config.seam.length_mm) is float
    assert config.seam.position_mm == (1.0, 2.0, 3.0)
    assert all(type(number) is float for number in config.seam.position_mm)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sensor:\n  peek_grey: 100", "sensor.peek_grey: no such field (did you mean sensor.peak_grey?)"),
        ("sensors:\n  peak_grey: 100", "sensors: no such field (did you mean sensor?)"),
        ("robbot: bad", "robbot: no such field (did you mean robot?)"),
        ("zzz: 1", "zzz: no such field"),
        ("sensor: 3", "sensor: found 3, expected a mapping of fields"),
        ("sensor:", "sensor: found nothing, expected a mapping of fields"),
        ("robot:", "robot: found nothing, expected one of perfect, calibrated, typical, bad, paper"),
        ("robot: good", "robot: found 'good', expected one of perfect, calibrated, typical, bad, paper"),
        (
            "sensor:\n  peak_grey: 300",
            "sensor.peak_grey: found 300, expected a number from 1 to 255 (grey levels)",
        ),
        (
            "seam:\n  speed_mm_s: 1e3",
            "seam.speed_mm_s: found '1e3', expected a number above 0, up to 1000000 (mm/s);"
            " this is text to YAML, write 1000.0",
        ),
        ("seam:\n  frames: 1e2", "seam.frames: found '1e2', expected a whole number from 8 to 100000"),
        ("seam:\n  frames: 20.5", "seam.frames: found 20.5, expected a whole number from 8 to 100000"),
        ("seam:\n  frames: true", "seam.frames: found true, expected a whole number from 8 to 100000"),
        ("sensor:\n  noise: 1", "sensor.noise: found 1, expected true or false"),
        ("sensor:\n  noise: yes", "sensor.noise: found 'yes', expected true or false"),
        ("sensor:\n  focal_mm: .nan", "sensor.focal_mm: found '.nan', expected a number above 0, up to 1000000 (mm)"),
        ("sensor:\n  focal_mm: 1.0e+999", "sensor.focal_mm: found Infinity, expected a number above 0"),
        ("sensor:\n  focal_mm: -12.0", "sensor.focal_mm: found -12.0, expected a number above 0"),
        ("sensor:\n  focal_mm: {a: 1}", 'sensor.focal_mm: found {"a": 1}, expected a number above 0'),
        (
            "seam:\n  position_mm: [1, 2]",
            "seam.position_mm: found [1, 2], expected 3 times a number from -1000000 to 1000000 (mm)",
        ),
        ("seam:\n  position_mm: 1", "seam.position_mm: found 1, expected 3 times"),
        ("calibration:\n  near_points_mm: [1, 2, 3]", "calibration.near_points_mm: found [1, 2, 3], expected a list"),
        ("sensor:\n  preset: p3", "sensor.preset: found 'p3', expected one of p2, p1, profiler"),
        ("sensor:\n  bits: 10", "sensor.bits: found 10, expected one of 8, 12"),
        ("sensor:\n  exposure_ms: -1", "sensor.exposure_ms: found -1, expected a number above 0, up to 1000000 (ms)"),
        ("disturbances: arc", "disturbances: found 'arc', expected a list, each entry a mapping of kind, start_s"),
        ("disturbances: [arc]", "disturbances[0]: found 'arc', expected a mapping of kind, start_s, end_s, strength"),
        ("disturbances: [{kind: ark}]", "disturbances[0].kind: found 'ark', expected one of arc, spatter, fume"),
        ("disturbances: [{start_s: 1}]", "disturbances[0].kind: found nothing, expected one of arc, spatter, fume"),
        (
            "disturbances: [{kind: arc}, {kind: fume, strat_s: 1}]",
            "disturbances[1].strat_s: no such field (did you mean start_s?)",
        ),
        (
            "disturbances: [{kind: arc, start_s: -5}]",
            "disturbances[0].start_s: found -5, expected a number from 0 to 1000000 (s)",
        ),
        (
            "disturbances: [{kind: arc, start_s: 5, end_s: 3}]",
            "disturbances[0]: found arc from 5 to 3 s, expected the smaller one first",
        ),
        ("scenario: boss", "scenario: found 'boss', expected v-seam"),
        ("seed: -1", "seed: found -1, expected a whole number from 0 to 4294967295"),
        ("seed: many", "seed: found 'many', expected a whole number"),
        ("? |\n  two\n  lines\n: 1", "'two\\nlines\\n': no such field"),
        ("<<: {robot: bad}", "<<: no such field"),
    ],
)
def test_a_wrong_value_is_refused_by_file_and_field(tmp_path, text, message):
    assert refusal_of(tmp_path, text).startswith(message)


def test_numbers_as_text_get_a_hint_for_whole_numbers_too(tmp_path):
    assert refusal_of(tmp_path, "seam:\n  frames: 1e2").endswith("write 100")


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", [f for f in fields() if isinstance(f.default, float)], ids=lambda field: field.path)
def test_no_field_takes_what_is_not_a_finite_number(field, number):
    with pytest.raises(BadInput):
        resolve("v-seam", options={field.path: number})


@pytest.mark.parametrize("field", fields(), ids=lambda field: field.path)
def test_every_field_takes_its_own_default_and_says_what_it_means(field):
    default = (
        [list(p) if isinstance(p, tuple) else p for p in field.default]
        if isinstance(field.default, tuple)
        else (field.default)
    )
    assert field.check(default, "here") == field.default
    assert len(field.meaning) > 5
    assert field.expected
