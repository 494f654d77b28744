"""Configuration files: what a careless or hostile one may do, and that writing and reading agree."""

import os

import numpy as np
import pytest
import yaml

from weldcell.cell.errors import BadInput
from weldcell.scenarios.yaml_file import read_yaml, write_yaml, yaml_text


def read(tmp_path, content):
    path = tmp_path / "settings.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_yaml(path)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("robot: !!python/object/apply:os.system ['true']", "tag"),
        ("robot: !!str typical", "tag"),
        ("robot: ! typical", "tag"),
        ("a: &x [1]\nb: *x", "anchor or alias"),
        ("a: &x 1", "anchor or alias"),
        ("a: &a [1,1]\nb: &b [*a,*a]\nc: &c [*b,*b]", "anchor or alias"),
        ("a: &a\n  b: *a", "anchor or alias"),
        ("robot: typical\nrobot: bad", "line 2: robot: found twice"),
        ("sensor:\n  noise: true\n  noise: false", "line 3: noise: found twice"),
        ("? [a, b]\n: 1", "collection as a field's name"),
        ("", "empty file"),
        ("# only a remark", "empty file"),
        ("- a\n- b", "a list"),
        ("typical", "'typical'"),
        ("a: 1\n---\nb: 2", "second document"),
        ("a: [1, 2", "line 1: not YAML"),
        ("a: b: c", "not YAML"),
        ("\ta: 1", "not YAML"),
        ("a: '\x07'", "not YAML"),
        (b"robot: \xff\xfe", "UTF-8"),
        ("robot: typical".encode("utf-16"), "UTF-8"),
        ("a: " + "[" * 5000 + "]" * 5000, "levels"),
        ("{a: " * 5000, "levels"),
        ("a: " + "x" * 1_100_000, "bytes"),
        ("? " * 2000, "levels"),
    ],
)
def test_a_trap_in_a_file_is_refused_in_one_line_that_names_the_file(tmp_path, content, reason):
    with pytest.raises(BadInput) as refusal:
        read(tmp_path, content)
    message = str(refusal.value)
    assert message.startswith(f"{tmp_path / 'settings.yaml'}: ")
    assert reason in message
    assert "\n" not in message


def test_what_is_no_readable_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")  # opening it would wait for ever
    for name, reason in (("missing.yaml", "No such file"), ("", "not a plain file"), ("pipe", "not a plain file")):
        with pytest.raises(BadInput, match=reason):
            read_yaml(tmp_path / name)


@pytest.mark.parametrize(
    "text", ["1e3", "1e-3", "010", "0x10", "1_000", "1:30", "yes", "on", "2024-01-01", ".nan", "-.inf", "9" * 5000]
)
def test_what_yaml_readers_disagree_on_stays_text(tmp_path, text):
    assert read(tmp_path, f"a: {text}") == {"a": text}


def test_plain_values_are_read(tmp_path):
    content = "a: 1\nb: -2.5\nc: 1.5e-05\nd: true\ne: [1, [2.0, x]]\nf:\n  g: 'yes'\nh:\n"
    expected = {"a": 1, "b": -2.5, "c": 1.5e-5, "d": True, "e": [1, [2.0, "x"]], "f": {"g": "yes"}, "h": None}
    assert read(tmp_path, content) == expected
    assert read(tmp_path, b"\xef\xbb\xbf" + content.replace("\n", "\r\n").encode()) == expected


def test_what_is_written_is_read_back_to_the_last_bit(tmp_path):
    rng = np.random.default_rng(1)
    numbers = rng.standard_normal(200) * 10.0 ** rng.integers(-20, 20, 200)
    value = {"scenario": "v-seam", "deep": {"numbers": numbers.tolist(), "on": True, "text": "yes: no", "none": None}}
    write_yaml(tmp_path / "sub" / "a.yaml", value)
    assert read_yaml(tmp_path / "sub" / "a.yaml") == value
    assert yaml.safe_load(yaml_text(value)) == value  # and by others' readers


def test_arrays_are_written_as_plain_rows_and_no_number_as_null():
    text = yaml_text({"T_flange_camera": np.eye(2), "rms_um": np.float64(3.5), "count": np.int64(2), "bad": np.nan})
    assert text == "T_flange_camera:\n- [1.0, 0.0]\n- [0.0, 1.0]\nrms_um: 3.5\ncount: 2\nbad: null\n"


def test_the_same_list_twice_is_written_without_an_alias():
    point = [1.0, 2.0]
    assert yaml_text({"a": point, "b": point}) == "a: [1.0, 2.0]\nb: [1.0, 2.0]\n"


def test_a_write_that_fails_leaves_the_former_file_and_no_other(tmp_path, monkeypatch):
    write_yaml(tmp_path / "a.yaml", {"a": 1})

    def full_disk(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(OSError, match="No space"):
        write_yaml(tmp_path / "a.yaml", {"a": 2})
    assert read_yaml(tmp_path / "a.yaml") == {"a": 1}
    assert [path.name for path in tmp_path.iterdir()] == ["a.yaml"]
