"""JSON held to the schema of the record or model that it is, and the models of a configuration."""

import json
from types import SimpleNamespace
from typing import Any, get_args

import jsonschema
from pydantic import BaseModel, TypeAdapter


def check(document: object, kind: Any) -> None:
    """Check that `document` has every field of `kind`, each with a value that it may have, and no others."""
    jsonschema.validate(document, _complete(TypeAdapter(kind).json_schema(mode="serialization")))


def objects(document: str | bytes) -> Any:
    """JSON with attributes in place of keys."""
    return json.loads(document, object_hook=lambda found: SimpleNamespace(**found))


def models(*annotations: Any) -> set[type[BaseModel]]:
    """Every model in `annotations`, and in those of its fields."""
    found: set[type[BaseModel]] = set()
    ahead = list(annotations)
    while ahead:
        one = ahead.pop()
        ahead += get_args(one)
        if isinstance(one, type) and issubclass(one, BaseModel) and one not in found:
            found.add(one)
            ahead += [field.annotation for field in one.model_fields.values()]
    return found


def _complete(schema: Any) -> Any:
    """`schema`, in which every property is required and there are no others."""
    if isinstance(schema, list):
        return [_complete(one) for one in schema]
    if not isinstance(schema, dict):
        return schema
    whole = {key: _complete(value) for key, value in schema.items()}
    own = whole.get("properties")
    return whole if own is None else whole | {"required": list(own), "additionalProperties": False}
