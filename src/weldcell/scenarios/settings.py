"""The settings of a run: defaults, overridden by a YAML file, overridden by options of the command line."""

import ast
import dataclasses
import inspect
import json
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Le

from weldcell.cell.configuration import SEAM_PRESETS, SENSOR_PRESETS, CellConfig, SeamConfig, SensorConfig
from weldcell.cell.errors import BadInput
from weldcell.scenarios.catalogue import did_you_mean
from weldcell.scenarios.yaml_file import read_yaml

Seed = Annotated[int, Ge(0), Le(2**32 - 1)]

# Longest first: the end of a field's name gives its unit.
_UNITS = {
    "_per_grey": "per grey level",
    "_grey": "grey levels",
    "_mm_s": "mm/s",
    "_mm": "mm",
    "_um": "um",
    "_deg": "deg",
    "_px": "px",
    "_nm": "nm",
    "_ms": "ms",
    "_db": "dB",
    "_s": "s",
    "_electrons": "electrons",
}


@dataclass(frozen=True, kw_only=True)
class Field:
    """One value of the nested configuration."""

    path: str
    """Where it stands, e.g. sensor.peak_grey."""
    hint: Any
    """Its type, with bounds."""
    default: Any
    meaning: str
    """The docstring under the field."""

    @property
    def unit(self) -> str:
        """The unit as the name's end gives it; empty if it has none."""
        return next((unit for end, unit in _UNITS.items() if self.path.endswith(end)), "")

    @property
    def expected(self) -> str:
        """What the field accepts, in words."""
        return _expected(self.hint)

    def check(self, value: object, where: str) -> Any:
        """The value in the field's own type; refused, naming where it stands, unless type and bounds fit."""
        from pydantic import TypeAdapter, ValidationError  # not needed for listings and help

        entry = _entry_of(self.hint)
        if entry is not None and isinstance(value, list):
            return tuple(check_section(entry, item, f"{where}[{k}]") for k, item in enumerate(value))
        try:
            # By way of JSON, because strict lists are no tuples but strict JSON arrays are.
            return TypeAdapter(self.hint).validate_json(json.dumps(value), strict=True)
        except ValidationError:
            unit = f" ({self.unit})" if self.unit else ""
            raise BadInput(
                f"{where}: found {_shown(value)}, expected {self.expected}{unit}{_number_hint(self.expected, value)}"
            ) from None


@dataclass(frozen=True, kw_only=True)
class Settings:
    """All that a run depends on."""

    scenario: str
    seed: int
    config: CellConfig

    def as_mapping(self) -> dict[str, Any]:
        """What config.yaml holds: scenario and seed, then the configuration."""
        return {"scenario": self.scenario, "seed": self.seed, **dataclasses.asdict(self.config)}


_PRESETS: Mapping[str, tuple[str, Mapping[Any, Any]]] = {
    "sensor.preset": (SensorConfig.preset, SENSOR_PRESETS),
    "seam.joint": (SeamConfig.joint, SEAM_PRESETS),
}
"""Fields whose value sets the defaults of their whole section: the usual value, and the section for each."""
_SCENARIO_DEFAULTS: Mapping[str, Mapping[str, object]] = {
    "hand-eye-point": {"sensor.preset": "p1"},
    "u-seam": {
        "sensor.preset": "p1",
        "seam.joint": "u",
        "seam.path": "surface",
        "seam.width_mm": 100.0,
        "seam.thickness_mm": 20.0,
        "seam.root_face_mm": 10.0,
        "seam.root_radius_mm": 4.0,
        "seam.amplitude_mm": 12.0,
    },
    "weld": {"seam.thickness_mm": 12.0, "seam.groove_angle_deg": 60.0, "seam.root_face_mm": 2.0},
}
"""What a scenario has unless it is asked for otherwise, where that is not the field's own default."""
_FILES = ("arm_file", "seam.part_file")
"""Fields that name files."""
_SEED = Field(path="seed", hint=Seed, default=0, meaning="Where all randomness of the run comes from.")


def resolve(
    scenario: str, *, file: Path | None = None, seed: object = None, options: Mapping[str, object] | None = None
) -> Settings:
    """The settings of a run of `scenario`: defaults < `file` < `seed` and `options` (value by field, e.g. robot)."""
    known = {field.path: field for field in fields()}
    values: dict[str, Any] = {}
    given = _with_places({path: known[path].check(x, option_name(path)) for path, x in (options or {}).items()}, Path())
    file_seed = _SEED.default
    if file is not None:
        mapping = read_yaml(file)
        _check_scenario(file, mapping.pop("scenario", scenario), scenario)
        file_seed = _SEED.check(mapping.pop("seed", _SEED.default), f"{file}: seed")
        values |= _with_places(dict(_from_mapping(mapping, known, file)), file.parent)
    usual = dict(_SCENARIO_DEFAULTS.get(scenario, {}))
    for preset in _PRESETS:
        section, plain = preset.split(".")[0], usual.get(preset, _PRESETS[preset][0])
        if preset in given and preset in values:  # what the file only has from its own preset gives way to the new one
            old = _preset_values(values, preset) | usual
            values = {path: value for path, value in values.items() if path not in old or value != old[path]}
        if {**values, **given}.get(preset, plain) != plain:  # another kind of thing has its own sizes
            usual = {path: value for path, value in usual.items() if not path.startswith(f"{section}.")}
    values = usual | values | given
    defaults = {path: value for preset in _PRESETS for path, value in _preset_values(values, preset).items()}
    return Settings(
        scenario=scenario,
        seed=file_seed if seed is None else _SEED.check(seed, "--seed"),
        config=_build(CellConfig, defaults | values),
    )


def _with_places(values: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The values with names of files made whole: they are relative to the file that names them, or to where we are."""
    named = {path: str((folder / values[path]).resolve()) for path in _FILES if values.get(path)}
    return values | named


def _preset_values(values: Mapping[str, Any], preset: str) -> dict[str, Any]:
    """The fields of a preset's section as the chosen value has them."""
    usual, sections_by_value = _PRESETS[preset]
    section = preset.split(".")[0]
    return {f"{section}.{name}": value for name, value in vars(sections_by_value[values.get(preset, usual)]).items()}


@cache
def fields() -> tuple[Field, ...]:
    """Every single value of the configuration, in its order."""
    return tuple(_fields_of(CellConfig(), ""))


def sections() -> dict[str, str]:
    """What each part of the configuration is about, by its name."""
    meanings = _meanings(CellConfig)
    return {name: meanings[name] for name, hint in get_type_hints(CellConfig).items() if dataclasses.is_dataclass(hint)}


def option_name(path: str) -> str:
    """The command line's name of a field: sensor.peak_grey is --sensor.peak-grey."""
    return "--" + path.replace("_", "-")


def shown_default(field: Field) -> str:
    """The default as a person would write it, with its unit."""
    text = " ".join(_as_words(field.default)) or "none"
    return f"{text} {field.unit}".strip()


def _as_words(value: object) -> list[str]:
    if isinstance(value, tuple):
        return [word for item in value for word in _as_words(item)]
    return [
        str(value).lower() if isinstance(value, bool) else f"{value:.10g}" if isinstance(value, float) else str(value)
    ]


def _fields_of(section: Any, prefix: str) -> Iterator[Field]:
    meanings, hints = _meanings(type(section)), get_type_hints(type(section), include_extras=True)
    for name, hint in hints.items():
        value = getattr(section, name)
        if dataclasses.is_dataclass(value):
            yield from _fields_of(value, f"{prefix}{name}.")
        else:
            yield Field(path=f"{prefix}{name}", hint=hint, default=value, meaning=meanings.get(name, ""))


def _meanings(section: type) -> dict[str, str]:
    """The docstring under each field, which Python itself throws away."""
    body = ast.parse(textwrap.dedent(inspect.getsource(section))).body[0].body  # type: ignore[attr-defined]
    return {
        field.target.id: " ".join(str(below.value.value).split())
        for field, below in zip(body, body[1:], strict=False)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(below, ast.Expr)
        and isinstance(below.value, ast.Constant)
    }


def _check_scenario(file: Path, found: object, expected: str) -> None:
    if found != expected:
        raise BadInput(f"{file}: scenario: found {_shown(found)}, expected {expected} (or leave the field out)")


def _from_mapping(
    mapping: Mapping[str, Any], known: Mapping[str, Field], file: Path, prefix: str = ""
) -> Iterator[tuple[str, Any]]:
    """The checked value of each field in the file."""
    names = {path[len(prefix) :].split(".")[0] for path in known if path.startswith(prefix)}
    for name, value in mapping.items():
        path = f"{prefix}{name}"
        if path in known:
            yield path, known[path].check(value, f"{file}: {path}")
        elif name not in names:
            raise BadInput(
                f"{file}: {_shown_key(path)}: no such field{did_you_mean(path, [prefix + n for n in names])}"
            )
        elif not isinstance(value, dict):
            raise BadInput(f"{file}: {path}: found {_shown(value)}, expected a mapping of fields")
        else:
            yield from _from_mapping(value, known, file, f"{path}.")


def _entry_of(hint: Any) -> type | None:
    """The section that each entry of a list is; None if the field is no list of sections."""
    entry = get_args(hint)[0] if get_origin(hint) is tuple else None
    return entry if isinstance(entry, type) and dataclasses.is_dataclass(entry) else None


def check_section(section: type, item: object, where: str, between: str = ".") -> Any:
    """A mapping as a section of plain fields; refused, naming where it stands, unless its fields fit.

    A field's name follows `where` and `between`.
    """
    hints, meanings = get_type_hints(section, include_extras=True), _meanings(section)
    defaults = {field.name: field.default for field in dataclasses.fields(section)}
    if not isinstance(item, dict):
        raise BadInput(f"{where}: found {_shown(item)}, expected {_expected(section)}")
    for name in item:
        if name not in hints:
            raise BadInput(f"{where}{between}{_shown_key(str(name))}: no such field{did_you_mean(str(name), hints)}")
    for name, default in defaults.items():
        if default is dataclasses.MISSING and name not in item:
            raise BadInput(f"{where}{between}{name}: found nothing, expected {_expected(hints[name])}")
    values = {
        name: Field(path=name, hint=hints[name], default=defaults[name], meaning=meanings[name]).check(
            value, f"{where}{between}{name}"
        )
        for name, value in item.items()
    }
    try:
        return section(**values)
    except BadInput as refusal:
        raise BadInput(f"{where}: {refusal}") from None


def _build(section: type, values: Mapping[str, Any], prefix: str = "") -> Any:
    """The section with these values by path, and defaults for the rest."""
    given: dict[str, Any] = {}
    for name, hint in get_type_hints(section).items():
        path = f"{prefix}{name}"
        if dataclasses.is_dataclass(hint):
            given[name] = _build(hint, values, f"{path}.")  # type: ignore[arg-type]
        elif path in values:
            given[name] = values[path]
    return section(**given)


def _expected(hint: Any) -> str:
    kind, bounds = (get_args(hint)[0], get_args(hint)[1:]) if get_origin(hint) is Annotated else (hint, ())
    if kind is bool:
        return "true or false"
    if kind is str:
        return "a text"
    if NoneType in get_args(kind):
        return _expected(get_args(kind)[0])
    if get_origin(kind) is Literal:
        return f"one of {', '.join(map(str, get_args(kind)))}"
    if dataclasses.is_dataclass(kind):
        return f"a mapping of {', '.join(get_type_hints(kind))}"
    if get_origin(kind) is tuple:
        item, *rest = get_args(kind)
        return f"a list, each entry {_expected(item)}" if rest == [...] else f"{1 + len(rest)} times {_expected(item)}"
    number = "a whole number" if kind is int else "a number"
    return " ".join([number, " to ".join(_bound(bound) for bound in bounds)]).strip()


def _bound(bound: object) -> str:
    match bound:
        case Gt(gt=limit):
            return f"above {limit:.10g}, up"
        case Ge(ge=limit):
            return f"from {limit:.10g}"
        case Le(le=limit):
            return f"{limit:.10g}"
    raise TypeError(f"unknown bound {bound!r}")


def _number_hint(expected: str, value: object) -> str:
    """How to write a number that YAML takes for text, e.g. 1e3."""
    if not isinstance(value, str) or "number" not in expected:
        return ""
    try:
        number = float(value)
    except ValueError:
        return ""
    whole = "whole" in expected and number.is_integer()
    return f"; this is text to YAML, write {int(number) if whole else number}" if abs(number) < 1e6 else ""


def _shown(value: object) -> str:
    if value is None:
        return "nothing"
    text = json.dumps(value) if not isinstance(value, str) else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _shown_key(path: str) -> str:
    text = path if path.isprintable() else repr(path)
    return text if len(text) <= 60 else f"{text[:57]}..."
