"""The command line's options for the fields of the configuration."""

import argparse
import re
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, Literal, NoReturn, get_args, get_origin

from weldcell.cell.configuration import Disturbance
from weldcell.cell.errors import BadInput
from weldcell.scenarios.settings import Field, fields, option_name, sections, shown_default

_DESTINATION = "field:"  # keeps the fields apart from the command's own options


class Parser(argparse.ArgumentParser):
    """An argument parser that raises instead of printing its usage, and takes -1e-4 for a number."""

    def __init__(self, **settings: Any) -> None:
        settings.setdefault("formatter_class", _Help)
        super().__init__(allow_abbrev=False, **settings)
        # Private, but there is no other way:
        self._negative_number_matcher = re.compile(r"^-(\d|\.\d)")  # Python's own knows no exponent before 3.14

    def error(self, message: str) -> NoReturn:
        raise BadInput(f"{message} ({self.prog} --help shows what there is)")


class _Help(argparse.HelpFormatter):
    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=44, width=120)


def add_field_options(parser: argparse.ArgumentParser) -> None:
    """Adds an option for every field of the configuration, grouped by section."""
    groups = {name: parser.add_argument_group(f"{name}: {meaning.rstrip('.')}") for name, meaning in sections().items()}
    for field in fields():
        section, _, _ = field.path.rpartition(".")
        _add_option(groups.get(section, parser), field)


def given_fields(arguments: argparse.Namespace) -> dict[str, Any]:
    """The values given for fields, by path."""
    by_path = {field.path: field for field in fields()}
    return {
        path: _value(by_path[path], text)
        for name, text in vars(arguments).items()
        if (path := name.removeprefix(_DESTINATION)) != name and text is not None
    }


def normalised(arguments: Sequence[str]) -> list[str]:
    """The command line with --sensor.peak_grey as --sensor.peak-grey, and switches with their value attached."""
    switches = {option_name(field.path) for field in fields() if field.hint is bool}
    result: list[str] = []
    rest = iter(arguments)
    for argument in rest:
        if argument == "--":
            return [*result, argument, *rest]
        if argument.startswith("--"):
            name, equals, value = argument.partition("=")
            argument = name.replace("_", "-") + equals + value
        if result and result[-1] in switches:
            # Otherwise `--sensor.noise v-seam` would take the scenario for the switch's value.
            is_value = argument.lower() in ("true", "false")
            result[-1] += f"={argument}" if is_value else "=true"
            if is_value:
                continue
        result.append(argument)
    return result


def option_strings(parser: argparse.ArgumentParser) -> Iterable[str]:
    """Every option that a parser knows."""
    return parser._option_string_actions  # private, but there is no other way


def typed(hint: Any, word: str) -> Any:
    """The value that a word stands for in a field of this type; a word that stands for none comes back as it is."""
    kind = _kind(hint)
    if kind is Literal:
        return next((choice for choice in get_args(hint) if str(choice) == word), word)
    if kind is Disturbance:
        return _disturbance(word)
    if kind is bool:
        return {"true": True, "false": False}.get(word.lower(), word)
    if kind not in (int, float):
        return word
    try:
        number = float(word)
        return int(number) if number.is_integer() and abs(number) < 1e15 else number
    except ValueError:
        return word


def _add_option(group: Any, field: Field) -> None:
    name = option_name(field.path)
    explained = f"{field.meaning.rstrip('.')} (default: {shown_default(field)})".replace("%", "%%")
    settings: dict[str, Any] = {"dest": _DESTINATION + field.path, "default": None, "help": explained}
    if field.hint is bool:
        opposite = f"--no-{name[2:]}"
        settings["help"] = f"{explained}; {opposite} is false"
        group.add_argument(name, nargs="?", const="true", metavar="true|false", **settings)
        group.add_argument(opposite, action="store_const", const="false", **settings | {"help": argparse.SUPPRESS})
    elif _kind(field.hint) is Literal:
        group.add_argument(name, metavar="|".join(map(str, get_args(field.hint))), **settings)
    elif _kind(field.hint) is tuple:
        size = len(get_args(field.hint))
        many = get_args(field.hint)[1] is ...
        each = _entry_shape(get_args(field.hint)[0])
        shape = ("X", "Y", "Z") if size == 3 else tuple(f"K{index + 1}" for index in range(size))
        nargs = "*" if many and field.default == () else "+" if many else len(shape)
        group.add_argument(name, nargs=nargs, metavar=(each, "...") if many else shape, **settings)
    else:
        group.add_argument(name, metavar="N" if " " in field.unit else field.unit.upper() or "N", **settings)


def _value(field: Field, text: str | list[str]) -> Any:
    """What the words on the command line mean for this field; words that mean nothing stay, to be refused by name."""
    if isinstance(text, str):
        return typed(field.hint, text)
    first, *rest = get_args(field.hint)
    if rest != [...] or get_origin(first) is not tuple:
        return [typed(first, word) for word in text]
    size = len(get_args(first))
    numbers = [typed(get_args(first)[0], word) for word in text]
    return [numbers[start : start + size] for start in range(0, len(numbers), size)]


def _entry_shape(hint: Any) -> str:
    """What one entry of a list looks like on the command line."""
    if hint is Disturbance:
        return "KIND[:START-END[:STRENGTH]]"
    return "|".join(map(str, get_args(hint))) if get_origin(hint) is Literal else "X Y Z"


def _disturbance(word: str) -> dict[str, Any]:
    """KIND[:START-END[:STRENGTH]] as the fields of a disturbance, e.g. arc:2-8.5:0.5; refused if it is none."""
    match = re.fullmatch(r"([a-z-]+)(?::([\d.]+)-([\d.]+)(?::([\d.]+))?)?", word)
    if match is None:
        shape = _entry_shape(Disturbance)
        raise BadInput(f"--disturbances: found {word!r}, expected {shape}, e.g. arc:2-8.5:0.5 (seconds)")
    values = zip(("start_s", "end_s", "strength"), match.groups()[1:], strict=True)
    return {"kind": match[1]} | {name: typed(float, text) for name, text in values if text is not None}


def _kind(hint: Any) -> Any:
    plain = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    return get_origin(plain) or plain
