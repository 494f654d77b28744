"""YAML as this project reads and writes it: plain values only, nothing that a typo or a trap could turn."""

import math
import re
import stat
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from weldcell.cell.errors import BadInput
from weldcell.scenarios.atomic_file import write_text

_MAX_BYTES = 100_000  # a whole configuration has 3 000
_MAX_DEPTH = 8  # a whole configuration has 4


class _PlainLoader(yaml.SafeLoader):
    """YAML 1.2's booleans and decimal numbers; everything else is text (no `yes`, no octal, no dates, no `1:30`)."""

    yaml_implicit_resolvers = {}  # noqa: RUF012 - add_implicit_resolver fills it below


class _PlainDumper(yaml.SafeDumper):
    """A field a line; lists of plain values stay on one line; no anchors for lists that occur twice."""

    def represent_sequence(
        self, tag: str, sequence: Iterable[Any], flow_style: bool | None = None
    ) -> yaml.SequenceNode:
        flow_style = not any(isinstance(item, list | dict) for item in sequence)
        return super().represent_sequence(tag, sequence, flow_style=flow_style)

    def ignore_aliases(self, data: Any) -> bool:
        return True


# `1e3` stays text on purpose: YAML readers do not agree whether it is a number.
for _tag, _pattern, _first in (
    ("null", r"(~|null|)", ["~", "n", ""]),
    ("bool", r"(true|false|True|False)", list("tfTF")),
    ("int", r"[-+]?(0|[1-9][0-9]{0,17})", list("-+0123456789")),
    ("float", r"[-+]?([0-9]+\.[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?", list("-+.0123456789")),
):
    _PlainLoader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(f"^{_pattern}$"), _first)


def read_yaml(path: Path) -> dict[str, Any]:
    """The mapping that a YAML file holds; refused if it is anything but plain, bounded and unambiguous."""
    text = _read_text(path)
    try:
        _refuse_traps(path, text)
        node = yaml.compose(text, Loader=_PlainLoader)
        value = _plain(path, node) if node is not None else None
    except yaml.MarkedYAMLError as error:
        line = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
        raise BadInput(f"{path}: {line}not YAML: {error.problem or error.context}") from error
    except yaml.YAMLError as error:
        raise BadInput(f"{path}: not YAML: {' '.join(str(error).split())}") from error
    if not isinstance(value, dict):
        found = "an empty file" if value is None else _kind(value)
        raise BadInput(f"{path}: found {found}, expected a mapping of fields (name: value)")
    return value


def write_yaml(path: Path, value: Mapping[str, Any]) -> None:
    """Writes a mapping of plain values, arrays and further mappings; the file appears when it is whole."""
    write_text(path, yaml_text(value))


def yaml_text(value: Mapping[str, Any]) -> str:
    """The mapping as YAML: one field a line, in the given order, the rows of arrays on one line each."""
    return yaml.dump(_writable(value), Dumper=_PlainDumper, sort_keys=False, width=120, allow_unicode=True)


def _read_text(path: Path) -> str:
    try:
        if not stat.S_ISREG(path.stat().st_mode):  # a folder, or a pipe that would block
            raise BadInput(f"{path}: expected a YAML file, found something that is not a plain file")
        with path.open("rb") as file:
            content = file.read(_MAX_BYTES + 1)
    except OSError as error:
        raise BadInput(f"{path}: expected a YAML file, found: {error.strerror}") from error
    except ValueError as error:  # a zero byte in the name
        raise BadInput(f"{path}: expected the name of a YAML file, found: {error}") from error
    if len(content) > _MAX_BYTES:
        raise BadInput(f"{path}: found more than {_MAX_BYTES} bytes, expected a configuration of a few thousand")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise BadInput(f"{path}: expected text in UTF-8, found byte {error.start} that is not") from error


def _refuse_traps(path: Path, text: str) -> None:
    """Refuses tags, anchors, aliases, deep nesting and further documents before any value is built."""
    depth = documents = 0
    for event in yaml.parse(text, Loader=_PlainLoader):
        where = f"{path}: line {event.start_mark.line + 1 if event.start_mark else '?'}"
        if getattr(event, "anchor", None):  # an alias has one too
            raise BadInput(f"{where}: found an anchor or alias, expected plain values")
        if tag := getattr(event, "tag", None):
            raise BadInput(f"{where}: found the tag {tag!r}, expected plain values")
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        documents += isinstance(event, yaml.DocumentStartEvent)
        if depth > _MAX_DEPTH:
            raise BadInput(f"{where}: found more than {_MAX_DEPTH} levels, expected at most 4")
        if documents > 1:
            raise BadInput(f"{where}: found a second document, expected one")


def _plain(path: Path, node: yaml.Node) -> Any:
    if isinstance(node, yaml.SequenceNode):
        return [_plain(path, item) for item in node.value]
    if isinstance(node, yaml.MappingNode):
        return _mapping(path, node)
    match node.tag.rpartition(":")[2]:
        case "null":
            return None
        case "bool":
            return node.value.lower() == "true"
        case "int":
            return int(node.value)
        case "float":
            return float(node.value)
    return node.value


def _mapping(path: Path, node: yaml.MappingNode) -> dict[str, Any]:
    mapping: dict[str, Any] = {}
    for key, value in node.value:
        where = f"{path}: line {key.start_mark.line + 1}"
        if not isinstance(key, yaml.ScalarNode):
            raise BadInput(f"{where}: found a collection as a field's name, expected a word")
        if key.value in mapping:
            raise BadInput(f"{where}: {key.value}: found twice, expected once")
        mapping[key.value] = _plain(path, value)
    return mapping


def _kind(value: object) -> str:
    return "a list" if isinstance(value, list) else f"the single value {value!r}"


def _writable(value: Any) -> Any:
    """Plain Python for YAML; what is not a number becomes null, as in metrics.json."""
    if isinstance(value, Mapping):
        return {str(key): _writable(item) for key, item in value.items()}
    if hasattr(value, "tolist"):  # numpy's arrays and scalars, without importing numpy to read a configuration
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_writable(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise TypeError(f"cannot write {type(value).__name__} as YAML; give numbers, texts, arrays or mappings")
