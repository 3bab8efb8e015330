"""Mistakes in a configuration as sentences: the place in the file, what is wrong, the remedy."""

import re
from collections.abc import Mapping, Sequence
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from adapters.fields.words import shown, suggestion

Place = tuple[str | int, ...]
Model = TypeVar("Model", bound=BaseModel)

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_SECRET = re.compile(r"passw|passphrase|secret|token|credential|api_?key", re.IGNORECASE)


class Problems:
    def __init__(self, raw: Mapping[str, Any]) -> None:
        self._raw = raw
        self.sentences: list[str] = []
        self.warnings: list[str] = []
        """What is no mistake, but probably not meant."""

    def add(self, place: Place, sentence: str) -> None:
        if any(_SECRET.search(str(part)) for part in place):
            # Whoever wrote a secret where none belongs must not find it in a log as well.
            sentence = sentence.replace(shown(_value(self._raw, place)), "what is there")
        # Of a network alone, the whole has no place of its own.
        line = f"{written(self._raw, place)}: {sentence}" if place else sentence
        if line not in self.sentences:
            self.sentences.append(line)

    def warn(self, place: Place, sentence: str) -> None:
        self.warnings.append(f"{written(self._raw, place)}: {sentence}")

    def read(self, model: type[Model], table: object, place: Place, context: Mapping[str, Any]) -> Model | None:
        """`table`, found at `place`, as a `model`; None, with its mistakes noted, when it has any."""
        try:
            return model.model_validate(table, context=dict(context))
        except ValidationError as error:
            details = error.errors(include_url=False)
            for detail in details:
                inner = any(_inside_of(other["loc"], detail["loc"]) for other in details)
                # A list with a bad item is not also too short.
                if not inner:
                    at = _located(detail)
                    self.add((*place, *at), _sentence(model, detail, at))
        return None


def written(raw: object, place: Place) -> str:
    """`place` as the reader finds it: zones[1] ('bedroom').channels.T_air; it ends where the tables do."""
    text = ""
    for part in place:
        if isinstance(part, int):
            text = extended(text, part)
            raw = raw[part] if isinstance(raw, list | tuple) and part < len(raw) else None
            if isinstance(raw, dict) and isinstance(raw.get("id"), str):
                text += f" ('{raw['id']}')"
        elif text and not isinstance(raw, dict):
            break
        else:
            text = extended(text, part if _BARE_KEY.fullmatch(part) else f'"{part}"')
            raw = raw.get(part) if isinstance(raw, dict) else None
    return text


def extended(text: str, part: str | int) -> str:
    """The place `text` and one step more: an item of its list, or a key of its table."""
    if isinstance(part, int):
        return f"{text}[{part}]"
    return f"{text}.{part}" if text else part


def own_sentence(detail: Mapping[str, Any]) -> str | None:
    """What a check of ours says in an error of pydantic's; None where the check is pydantic's own."""
    return str(detail["ctx"]["error"]) if detail["type"] == "value_error" else None


def _value(raw: Any, place: Place) -> object:
    """What the file has at `place`; None if there is no such place."""
    for part in place:
        try:
            raw = raw[part]
        except (KeyError, IndexError, TypeError):
            return None
    return raw


def unknown_key(key: object, known: Sequence[str]) -> str:
    return f"is not a known key; {suggestion(key, known, 'the keys here are')}"


def _inside_of(inner: Place, outer: Place) -> bool:
    return len(inner) > len(outer) and inner[: len(outer)] == outer


def _located(detail: Any) -> Place:
    """Where a mistake is: a key is at its own place, and what a pair lacks is wrong with the pair."""
    place = tuple(part for part in detail["loc"] if part != "[key]")
    return place[:-1] if detail["type"] == "missing" and isinstance(place[-1], int) else place


def _sentence(model: type[BaseModel], detail: Any, place: Place) -> str:
    kind, sentence = detail["type"], own_sentence(detail)
    if sentence is not None:
        return sentence
    owner = _model_at(model, place[:-1])
    if kind == "extra_forbidden" and owner is not None:
        return unknown_key(place[-1], list(owner.model_fields))
    description = _description(model, place)
    if kind == "missing" and place == detail["loc"]:
        return f"is missing; give {description}"
    return f"must be {description}, not {shown(detail['input'])}"


def _description(model: type[BaseModel], place: Place) -> str:
    """What the innermost described field on the way to `place` wants."""
    for end in range(len(place), 0, -1):
        key, owner = place[end - 1], _model_at(model, place[: end - 1])
        if isinstance(key, str) and owner is not None and key in owner.model_fields:
            inner = _model_at(model, place)
            keys = f"a table with {', '.join(inner.model_fields)}" if inner is not None and end == len(place) else None
            return owner.model_fields[key].description or keys or "something else"
    return f"a table with {', '.join(model.model_fields)}"


def _model_at(model: type[BaseModel], place: Place) -> type[BaseModel] | None:
    """The model that describes the table at `place` inside a `model`."""
    annotation: Any = model
    for part in place:
        annotation = _inside(_plain(annotation), part)
    plain = _plain(annotation)
    return plain if isinstance(plain, type) and issubclass(plain, BaseModel) else None


def _inside(annotation: Any, part: str | int) -> Any:
    """The annotation of the item or field `part` of something annotated with `annotation`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        field = annotation.model_fields.get(str(part))
        return field.annotation if field else None
    if get_origin(annotation) is dict:
        return get_args(annotation)[1]
    return get_args(annotation)[0] if get_origin(annotation) in (list, tuple) else None


def _plain(annotation: Any) -> Any:
    """`annotation` without its metadata and without "or None"."""
    if get_origin(annotation) is Annotated:
        return _plain(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType):
        return _plain(next(option for option in get_args(annotation) if option is not type(None)))
    return annotation
