"""What the scenario's types allow, in words: turns a validation error into field, value and allowed range."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import msgspec
from msgspec import inspect

_STEP = re.compile(r"\.(\w+)|\[(\d+)\]")
_UNKNOWN = re.compile(r"unknown field `(.*)`")
_MISSING = re.compile(r"missing required field `(.*)`")


def explained(error: msgspec.ValidationError, tables: Mapping[str, Any], schema: type) -> str:
    """Return a validation error in one line: the field's path, what it got, what is allowed."""
    text = str(error)
    message, _, place = text.partition(" - at `$")
    steps = [name or int(index) for name, index in _STEP.findall(place)]
    kind, path = inspect.type_info(schema), ""
    value: Any = tables
    for step in steps:
        kind, value = _inside(kind, step), value[step]
        path += f"[{step}]" if isinstance(step, int) else f".{step}"
    path = path.removeprefix(".")
    if found := _UNKNOWN.search(message):
        return f"{_joined(path, found[1])}: unknown key, allowed are {_keys(kind)}"
    if found := _MISSING.search(message):
        return f"{_joined(path, found[1])}: missing"
    return f"{path}: got {value!r}, allowed is {allowed(kind)}"


def _joined(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _inside(kind: inspect.Type, step: str | int) -> inspect.Type:
    kind = _without_none(kind)
    if isinstance(kind, inspect.StructType):
        return next(field.type for field in kind.fields if field.encode_name == step)
    if isinstance(kind, inspect.TupleType):
        return kind.item_types[int(step)]
    if isinstance(kind, inspect.VarTupleType):
        return kind.item_type
    raise TypeError(f"{kind} has no inside")


def _without_none(kind: inspect.Type) -> inspect.Type:
    if isinstance(kind, inspect.UnionType):
        return next(part for part in kind.types if not isinstance(part, inspect.NoneType))
    return kind


def allowed(kind: inspect.Type) -> str:
    """Return what a type allows, in words."""
    kind = _without_none(kind)
    match kind:
        case inspect.StructType():
            return f"a table with {_keys(kind)}"
        case inspect.FloatType() | inspect.IntType():
            return _number(kind)
        case inspect.LiteralType():
            return "one of " + ", ".join(map(str, kind.values))
        case inspect.TupleType():
            same = len(set(map(str, kind.item_types))) == 1
            each = f", each {allowed(kind.item_types[0])}" if same else ""
            return f"a list of {len(kind.item_types)} values{each}"
        case inspect.VarTupleType():
            return f"a list, each {allowed(kind.item_type)}"
        case inspect.BoolType():
            return "true or false"
        case inspect.StrType():
            return "a text"
        case _:
            return str(kind)


def _keys(kind: inspect.Type) -> str:
    kind = _without_none(kind)
    return ", ".join(field.encode_name for field in kind.fields) if isinstance(kind, inspect.StructType) else ""


def _number(kind: inspect.FloatType | inspect.IntType) -> str:
    name = "a whole number" if isinstance(kind, inspect.IntType) else "a number"
    bounds = ((">", kind.gt), (">=", kind.ge), ("<", kind.lt), ("<=", kind.le))
    limits = " and ".join(f"{sign} {bound:g}" for sign, bound in bounds if bound is not None)
    return f"{name} {limits}".rstrip()
