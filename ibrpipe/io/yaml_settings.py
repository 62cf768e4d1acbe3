"""YAML text to plain values that remember their lines, and errors that name file, line and key."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, TypeVar

import yaml
from pydantic import AliasChoices, BaseModel, ValidationError
from pydantic_core import ErrorDetails

from ibrpipe.errors import ConfigError, closest

#: characters of a settings file, and values in it, at the most
MOST_TEXT, MOST_NODES = 1 << 20, 100_000
Key = tuple[str | int, ...]
Model = TypeVar("Model", bound=BaseModel)


@dataclass
class Settings:
    """Plain values and where each of them stands.

    Attributes
    ----------
    values : dict
        What the YAML says.
    places : dict
        Key path to the text that names its place, such as ``mesh.yaml:12``.
    """

    values: dict[str, Any]
    places: dict[Key, str] = field(default_factory=dict)

    def place(self, key: Key) -> str:
        """Return where `key`, or the closest parent that is written down, stands."""
        while key not in self.places and key:
            key = key[:-1]
        return self.places.get(key, "settings")

    def put(self, key: Key, value: Any, place: str) -> None:
        """Set the value at `key`, making the mappings on the way."""
        target: Any = self.values
        for index, part in enumerate(key[:-1]):
            if isinstance(target, list):
                target = target[_position(part, target, place)]
            else:
                if target.get(part) is None:
                    target[part] = {}
                    self.places[key[: index + 1]] = place
                target = target[part]
            if not isinstance(target, (dict, list)):
                raise ConfigError(f"{place}: {dotted(key[: index + 1])} is {target!r}, which has no keys below it")
        target[_position(key[-1], target, place) if isinstance(target, list) else key[-1]] = value
        self.places = {known: where for known, where in self.places.items() if known[: len(key)] != key}
        self.places[key] = place


def _position(part: str | int, items: list[Any], place: str) -> int:
    if str(part).isdigit() and int(part) < len(items):
        return int(part)
    raise ConfigError(f"{place}: expected a number from 0 to {len(items) - 1} to choose from the list, got {part!r}")


def parse(text: str, name: str) -> Settings:
    """Read the YAML `text` of the file `name`.

    Raises
    ------
    ConfigError
        It is no YAML, no mapping, or holds a key twice.
    """
    node, values = _loaded(text, name)
    if not isinstance(node, yaml.MappingNode):
        raise ConfigError(f"{name}:1: expected lines of the form key: value, got {_short(values)}")
    return Settings(values, {(): name, **dict(_places(node, (), name))})


def value_of(text: str, place: str) -> Any:
    """Read one YAML value, given on the command line or in the file called `place`; raises as `parse`."""
    return _loaded(text, place, lines=False)[1]


def _loaded(text: str, name: str, lines: bool = True) -> tuple[yaml.Node | None, Any]:
    """Return what the YAML `text` says, twice: as nodes and as values. Aliases may not repeat without end."""
    if len(text) > MOST_TEXT:
        raise ConfigError(f"{name}: has {len(text)} characters; settings have at most {MOST_TEXT}")
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        _check_repeats(node, name)
        return node, yaml.safe_load(text)
    except ConfigError:
        raise
    except yaml.YAMLError as error:
        where = _line_of(error) if lines else ""
        raise ConfigError(f"{name}{where}: not valid YAML: {_problem(error)}") from error
    except RecursionError as error:
        raise ConfigError(f"{name}: is nested too deeply; settings have a few levels") from error
    except (ValueError, ArithmeticError, AttributeError, LookupError, TypeError) as error:  # of dates, tags, numbers
        raise ConfigError(f"{name}: holds a value that is none: {_short_line(str(error))}") from error


def _check_repeats(node: yaml.Node | None, name: str) -> None:
    """Count nodes with all repetitions by aliases, which may be exponentially many, or endless."""
    left, count = [] if node is None else [node], 0
    while left:
        each = left.pop()
        count += 1
        if count > MOST_NODES:
            raise ConfigError(f"{name}: holds more than {MOST_NODES} values, aliases counted; write them out")
        if isinstance(each, yaml.MappingNode):
            left += [part for pair in each.value for part in pair]
        elif isinstance(each, yaml.SequenceNode):
            left += each.value


def _short_line(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= 100 else line[:97] + "..."


def _places(node: yaml.Node, above: Key, name: str) -> Iterator[tuple[Key, str]]:
    if isinstance(node, yaml.MappingNode):
        seen = dict[str, int]()
        for key_node, value_node in node.value:
            key, line = str(key_node.value), key_node.start_mark.line + 1
            if key in seen:
                raise ConfigError(f'{name}:{line}: "{key}" stands here and in line {seen[key]}; keep one of them')
            seen[key] = line
            yield (*above, key), f"{name}:{line}"
            yield from _places(value_node, (*above, key), name)
    elif isinstance(node, yaml.SequenceNode):
        for index, item in enumerate(node.value):
            yield (*above, index), f"{name}:{item.start_mark.line + 1}"
            yield from _places(item, (*above, index), name)


def _line_of(error: yaml.YAMLError) -> str:
    mark = getattr(error, "problem_mark", None)
    return f":{mark.line + 1}" if mark else ""


def _problem(error: yaml.YAMLError) -> str:
    return " ".join(str(getattr(error, "problem", None) or error).split())


def validated(model: type[Model], settings: Settings) -> Model:
    """Return `model` filled with `settings`.

    Raises
    ------
    ConfigError
        A key is unknown or a value is wrong; the message names the place, the key and what is expected.
    """
    try:
        return model.model_validate(settings.values)
    except ValidationError as error:
        problems = error.errors(include_url=False)
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        raise ConfigError(_told(model, settings, problems[0]) + more) from None


def _told(model: type[BaseModel], settings: Settings, problem: ErrorDetails) -> str:
    key = _written(problem["loc"], settings)
    place = settings.place(key)
    if problem["type"] == "extra_forbidden":
        where = f" in {dotted(key[:-1])}" if len(key) > 1 else ""
        return f'{place}: unknown key "{key[-1]}"{where}; {closest(key[-1], _fields(model, key[:-1]))}'
    if problem["type"] == "missing":
        return f"{place}: {dotted(problem['loc'])} is missing; add it"
    message = problem["msg"].removeprefix("Value error, ").removeprefix("Input ")
    if problem["type"] == "value_error":
        return f"{place}: {dotted(key)}: {message}"
    return f"{place}: {dotted(key)} is {_short(problem['input'])}; it {message}"


def _written(loc: Key, settings: Settings) -> Key:
    """Drop from an error's location what pydantic adds for unions, which stands nowhere in the file."""
    value: Any = settings.values
    kept: list[str | int] = []
    for part in loc:
        in_list = isinstance(value, list) and isinstance(part, int) and part < len(value)
        if in_list or (isinstance(value, dict) and part in value):
            value = value[part]
            kept.append(part)
    return tuple(kept)


def _fields(model: type[BaseModel], key: Key) -> list[str]:
    """Return the valid keys of the model that `key` leads to."""
    models = [model]
    for part in key:
        if not isinstance(part, int):
            models = [
                inner
                for each in models
                if part in each.model_fields
                for inner in _models_in(each.model_fields[part].annotation)
            ]
    return [name for each in models for name in each.model_fields]


def renamed(model: type[BaseModel], key: Key) -> Key:
    """Return a key path in which names of earlier versions are those of today."""
    models, found = [model], list[str | int]()
    for part in key:
        fields = [(name, field) for each in models for name, field in each.model_fields.items()]
        if not isinstance(part, int):
            part = next((name for name, field in fields if part in _names(field.validation_alias)), part)
            models = [inner for name, field in fields if name == part for inner in _models_in(field.annotation)]
        found.append(part)
    return tuple(found)


def _names(alias: Any) -> list[Any]:
    return alias.choices if isinstance(alias, AliasChoices) else []


def take_current_names(model: type[BaseModel], settings: Settings) -> None:
    """Put what stands under a name of an earlier version under that of today, so that changes meet it there.

    Raises
    ------
    ConfigError
        A setting stands under both names.
    """
    for key in sorted(settings.places, key=len, reverse=True):
        new = renamed(model, key)
        if not key or new[-1] == key[-1]:
            continue
        target: Any = settings.values
        for part in key[:-1]:
            target = target[part]
        if new[-1] in target:
            place = settings.place(key)
            raise ConfigError(f'{place}: "{key[-1]}" is the earlier name of "{new[-1]}", which is set, too; keep one')
        target[new[-1]] = target.pop(key[-1])
    settings.places = {renamed(model, key): place for key, place in settings.places.items()}


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for inner in getattr(annotation, "__args__", ()) for model in _models_in(inner)]


def dotted(key: Key) -> str:
    """Return a key path as it is written on the command line."""
    return ".".join(map(str, key))


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
