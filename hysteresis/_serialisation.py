"""Models, their parts and whatever is made of them as plain data and arrays, and back.

A class is written as `package:Class`. What is read back is put together field by field: no constructor is
run, only checks of the class itself, and only registered classes are made.
"""

import inspect
import json
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from pathlib import Path
from types import UnionType
from typing import (
    Any,
    ClassVar,
    Literal,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
    is_typeddict,
)

import equinox as eqx
import jax
import numpy as np

from ._errors import InputError
from ._files import write_whole
from ._limits import damage_told
from ._parameter import as_array
from ._registry import class_key, class_of, registered

Arrays = dict[str, Any]


def described(
    value: Any, name: str = "", arrays: Arrays | None = None, *, for_file: bool = True
) -> tuple[Any, Arrays]:
    """Plain data of a value, and its arrays by name.

    **Arguments:**

    - `name`: with which the names of the arrays begin.
    - `arrays`: to which they are added.
    - `for_file`: refuse classes that are not registered, because a file with them could not be loaded.

    Raises `InputError` for a class that is not registered, and for a value that is not an array, plain, or
    made of such.
    """
    arrays = {} if arrays is None else arrays

    def inside(part: Any, key: Any) -> Any:
        return described(part, f"{name}.{key}" if name else str(key), arrays, for_file=for_file)[0]

    if isinstance(value, jax.Array | np.ndarray):
        arrays[name] = np.asarray(value)
        return {"array": name, "jax": isinstance(value, jax.Array)}, arrays
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return {"number": repr(value)}, arrays  # which JSON does not have
    if value is None or isinstance(value, bool | int | float | str):
        return value, arrays
    kind = type(value)
    if kind in (tuple, list):
        words = [inside(part, k) for k, part in enumerate(value)]
        return ({"tuple": words} if kind is tuple else words), arrays
    if kind is dict and all(isinstance(key, str) for key in value):
        return {"dict": {key: inside(part, key) for key, part in value.items()}}, arrays
    if not (is_dataclass(kind) or hasattr(kind, "_fields")):
        said = f"{name or 'this'} is a {kind.__name__}, which cannot be kept in a file."
        mend = "keep arrays, numbers, strings, and registered classes made of them as fields."
        raise InputError("not-storable", said, fix=mend)
    if for_file and registered(kind) is None:
        said = f"{kind.__name__} is not registered, so a file with it could not be loaded."
        mend = f"call hysteresis.register({kind.__name__}) in the module that defines it."
        raise InputError("unregistered-class", said, fix=mend)
    given = {field: getattr(value, field) for field in _fields(kind)}
    for name_of_field in ("units", "trained"):  # of models; they are not written where not known
        if given.get(name_of_field, value) is None:
            del given[name_of_field]
    parts = {field: inside(part, field) for field, part in given.items()}
    return {"class": class_key(kind), "fields": parts}, arrays


def rebuilt(words: Any, arrays: Mapping[str, Any]) -> Any:
    """The inverse of `described`; also of what earlier versions wrote.

    Raises `InputError` for a class that is not registered, `KeyError`, `TypeError` and `ValueError` for
    what `described` does not write.
    """
    if isinstance(words, list):
        return [rebuilt(part, arrays) for part in words]
    if not isinstance(words, dict):
        return words
    if "array" in words:
        array = arrays[words["array"]]
        return as_array(array) if words.get("jax", True) else array
    if "number" in words:
        return float(words["number"])
    if "tuple" in words:
        return tuple(rebuilt(part, arrays) for part in words["tuple"])
    if "dict" in words:
        return {key: rebuilt(part, arrays) for key, part in words["dict"].items()}
    kind = class_of(str(words["class"]))
    if "fields" in words:
        return _made(kind, {name: rebuilt(part, arrays) for name, part in words["fields"].items()})
    # Earlier fits wrote the fields beside the class, and all that is in turn as a list.
    plain = {name: rebuilt(part, arrays) for name, part in words.items() if name != "class"}
    return _made(kind, {k: tuple(v) if isinstance(v, list) else v for k, v in plain.items()})


def decoded(value: Any, kind: Any, place: str = "") -> Any:
    """Plain data of JSON as an annotation says: objects as its named tuples, null for NaN as NaN.

    Of a typed dictionary further entries are kept as they are.

    Raises `ValueError` for what the annotation does not allow, with its `place`.
    """
    origin, inner = get_origin(kind), get_args(kind)
    if kind is Any or isinstance(kind, TypeVar) or origin is ClassVar:
        return value
    if origin in (Union, UnionType):
        if value is None and type(None) in inner:
            return None
        for one in inner[:-1]:
            with suppress(TypeError, ValueError):
                return decoded(value, one, place)
        return decoded(value, inner[-1], place)
    if kind is float and value is None:
        return math.nan
    if kind is float and np.ndim(value) == 0 and hasattr(value, "dtype"):
        return value  # models of others keep arrays where they say float
    if kind is float and type(value) in (int, float) and abs(value) < math.inf:
        return float(value)
    if origin in (list, tuple) and isinstance(value, list | tuple):
        kinds = inner if origin is tuple and inner[-1:] != (...,) else inner[:1] * len(value)
        if len(kinds) == len(value):
            pairs = enumerate(zip(value, kinds, strict=True))
            return origin(decoded(part, one, f"{place}.{k}") for k, (part, one) in pairs)
    if origin is dict and isinstance(value, dict):
        return {key: decoded(part, inner[1], f"{place}.{key}") for key, part in value.items()}
    if isinstance(value, dict) and (is_typeddict(kind) or hasattr(kind, "_fields")):
        hints = _hints(kind)
        found = {k: decoded(v, hints.get(k, Any), f"{place}.{k}") for k, v in value.items()}
        needed = getattr(kind, "__required_keys__", ())
        if missing := [key for key in hints if key in needed and key not in value]:
            raise ValueError(f"{place}.{missing[0]} is missing".lstrip("."))
        return found if is_typeddict(kind) else _made(kind, found)
    if origin is Literal:
        fits = value in inner
    elif kind is int:
        fits = type(value) is int and abs(value) < 2**63
    else:
        fits = inspect.isclass(origin or kind) and isinstance(value, origin or kind)
    if not fits:
        raise ValueError(f"{place.lstrip('.') or 'it'} is {value!r:.40}")
    return value


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _made(kind: Any, parts: dict[str, Any]) -> Any:
    """An instance with these fields, others by default, checked as the class checks itself.

    A class says by `GONE` which fields it had, and of which value it still does what they said.
    """
    gone = getattr(kind, "GONE", {})
    parts = {k: part for k, part in parts.items() if k not in gone or part != gone[k]}
    unknown = sorted(set(parts) - set(_fields(kind)))
    if unknown:
        raise TypeError(f"a {kind.__name__} has no field {unknown[0]!r}")
    hints = _hints(kind)
    parts = {name: decoded(part, hints[name], name) for name, part in parts.items()}
    if not is_dataclass(kind):
        return kind(**parts)
    new: Any = object.__new__(kind)  # type: ignore[arg-type]
    for field in fields(kind):
        value = parts[field.name] if field.name in parts else _default(kind, field)
        object.__setattr__(new, field.name, value)
    if isinstance(new, eqx.Module):
        for base in type(new).__mro__:
            if "__check_init__" in vars(base):
                vars(base)["__check_init__"](new)
    return new


def _default(kind: Any, field: Any) -> Any:
    if field.default is MISSING and field.default_factory is MISSING:
        raise TypeError(f"the field {field.name!r} of a {kind.__name__} is missing")
    value = field.default if field.default is not MISSING else field.default_factory()
    return field.metadata.get("converter", lambda x: x)(value)


def _fields(kind: Any) -> tuple[str, ...]:
    return kind._fields if hasattr(kind, "_fields") else tuple(f.name for f in fields(kind))


# One model as one JSON file: its structure in words, and its arrays as numbers.


def save_model(model: Any, file: str | Path) -> Path:
    """Write a model of any registered class to one JSON file, and return its path.

    Raises `InputError` for a class that is not registered (`hysteresis.register`).

    **Example:**

        >>> place = hysteresis.save_model(hysteresis.LinearSponge(K=2.0), folder / "sponge.json")
        >>> float(hysteresis.load_model(place).K)
        2.0
    """
    structure, arrays = described(model)
    document = {"structure": structure, "arrays": {k: _written(x) for k, x in arrays.items()}}
    write_whole(Path(file), json.dumps(document))
    return Path(file)


def load_model(file: str | Path) -> Any:
    """The model that `save_model` wrote. Nothing in the file is executed.

    Raises `InputError` `damaged-file` for another file, and as `save_model` for a class that is not
    registered here: import what registers it before.

    **Example:**

        >>> place = hysteresis.save_model(hysteresis.LinearSponge(K=2.0, b=1.5), folder / "sponge.json")
        >>> hysteresis.load_model(place).b.item()
        1.5
    """
    place = Path(file)
    text = place.read_bytes()
    with damage_told(f"The model {place.name}", place, "write it with hysteresis.save_model."):
        document = json.loads(text)
        arrays = {name: _read(x) for name, x in document["arrays"].items()}
        if "class" not in document["structure"]:
            raise ValueError("it is not a model")
        return rebuilt(document["structure"], arrays)


def _written(x: Any) -> dict[str, Any]:
    """A complex array is one of real numbers with one axis more."""
    if np.iscomplexobj(x):
        return _written(np.stack([x.real, x.imag], -1)) | {"complex": True}
    return {"type": x.dtype.name, "shape": x.shape, "values": x.ravel().tolist()}


def _read(words: dict[str, Any]) -> np.ndarray:
    x = np.array(words["values"], np.dtype(words["type"])).reshape(words["shape"])
    return x[..., 0] + 1j * x[..., 1] if words.get("complex") else x
