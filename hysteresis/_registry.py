"""The table of models: their names, where a fit of each starts, and models of other distributions.

A distribution announces its models in the entry-point group `hysid.models`, one entry a model:

    [project.entry-points."hysid.models"]
    Duhem = "hysid_duhem:Duhem"

Its module is imported when the name is first asked for, never at start-up.
"""

import difflib
import inspect
from collections.abc import Callable, Iterator
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import Any, TypeVar, overload

from ._errors import InputError
from ._model import AbstractModel
from .laws import announce, withdraw

GROUP = "hysid.models"
OURS = ("hysteresis", "compensate")

Guess = Callable[[Any], AbstractModel]
"""Start values of a fit: from a `Record` to a model."""

Class = TypeVar("Class", bound=type)


@dataclass(frozen=True)
class Registered:
    """A class that files may name; where it is a model, its name in `fit` and where a fit starts."""

    name: str
    kind: type
    guess: Guess | None = None

    @property
    def is_model(self) -> bool:
        """Whether it is a model, not a part of one."""
        return issubclass(self.kind, AbstractModel)

    @property
    def can_start(self) -> bool:
        """Whether a fit can start from its name alone."""
        return self.is_model and (self.guess is not None or _has_defaults(self.kind))

    def start(self, record: Any) -> AbstractModel:
        """The model from which a fit of `record` starts.

        Raises `InputError` where the model has no start values, or its guess is not such a model.
        """
        if self.guess is None:
            if _has_defaults(self.kind):
                return self.kind()
            raise InputError(
                "no-start-values",
                f"nothing says where a fit of {self.name} starts.",
                cause="it was registered without a guess, and its fields have no defaults.",
                fix=f"register({self.kind.__name__}, guess=...), or give such a model to start from.",
            )
        start = self.guess(record)
        if not isinstance(start, self.kind):
            said = f"the guess of {self.name} returned a {type(start).__name__}."
            mend = f"return a {self.kind.__name__} from the function given to register(guess=...)."
            raise InputError("no-start-values", said, fix=mend)
        return start


_BY_CLASS: dict[str, Registered] = {}
_BY_NAME: dict[str, Registered] = {}


@cache
def _load_ours() -> None:
    """Import the files of this package, which register their classes and say where fits of them start."""
    package = import_module("hysteresis")
    for name in package.__all__:
        getattr(package, name)
    import_module("hysteresis._start_values")


@overload
def register(
    model: Class,
    /,
    guess: Guess | None = None,
    name: str | None = None,
    law: ModuleType | None = None,
) -> Class: ...


@overload
def register(
    model: None = None,
    /,
    guess: Guess | None = None,
    name: str | None = None,
    law: ModuleType | None = None,
) -> Callable[[Class], Class]: ...


def register(
    model: Any = None,
    /,
    guess: Guess | None = None,
    name: str | None = None,
    law: ModuleType | None = None,
) -> Any:
    """Make a model known: by name in `fit` and on the command line, and in files of fits.

    A saved fit holds the names of its classes; only registered classes are made when it is loaded.
    `register` is a function and a decorator, with or without arguments.

    **Arguments:**

    - `model`: the class of a model, or of a part of one that is an `equinox.Module`, a dataclass or a
      named tuple.
    - `guess`: where a fit starts, `guess(record) -> model`. Without it the fit starts from `model()` where
      every field has a default.
    - `name`: how `fit` and `--model` call it, whatever the case; by default the name of the class.
    - `law`: the module of its law, see `hysteresis.laws.announce`.

    Returns the class; without a class, a decorator.

    Raises `InputError` `name-taken` where another class has this name, `not-a-model` for something else
    than a class with fields, `untranslatable-law` for a law of more than all its languages have.

    **Example:**

        >>> from hysteresis import Burgers, register
        >>> register(Burgers) is Burgers
        True
    """
    if model is None:
        return lambda kind: register(kind, guess, name, law)
    has_fields = inspect.isclass(model) and (is_dataclass(model) or hasattr(model, "_fields"))
    if not has_fields or inspect.isabstract(model):
        said = f"{model!r} cannot be registered."
        mend = "register a class that is not abstract, of a model or of a part with fields."
        raise InputError("not-a-model", said, fix=mend)
    key = class_key(model)
    if key.partition(":")[0] not in OURS:
        _load_ours()
    known = _BY_CLASS.get(key)
    if known is not None and not _is_same(known.kind, model):
        raise _taken(key, known.kind)
    if known is not None:
        guess, name = guess or known.guess, name or known.name
    entry = Registered(name or model.__name__, model, guess)
    other = _BY_NAME.get(entry.name.casefold()) if entry.is_model else None
    if other is not None and not _is_same(other.kind, model):
        raise _taken(entry.name, other.kind)
    if law is not None:
        _announce(law)
    if entry.is_model:
        if known is not None:
            _BY_NAME.pop(known.name.casefold(), None)
        _BY_NAME[entry.name.casefold()] = entry
    _BY_CLASS[key] = entry
    return model


def _announce(law: ModuleType) -> None:
    """Make a law known that can be translated."""
    from .running._marks import Marked  # no model needs it until it runs

    kind = announce(law)
    try:
        Marked().marked(kind, "move")
    except InputError:
        withdraw(kind)
        raise


def class_key(kind: type) -> str:
    """How files call a class: `package:Class`, with the package at the top."""
    package = kind.__module__.partition(".")[0]
    return f"{'__main__' if package == '__mp_main__' else package}:{kind.__name__}"


def model_names() -> tuple[str, ...]:
    """Names of the models that `fit` can start by name: ours, and those of installed distributions.

    **Example:**

        >>> import hysteresis
        >>> "Burgers" in hysteresis.model_names()
        True
    """
    _load_ours()
    ours = [entry.name for entry in _BY_NAME.values() if entry.can_start]
    known = {name.casefold() for name in ours}
    return (*ours, *(p.name for p in _entry_points() if p.name.casefold() not in known))


def known_models() -> tuple[Registered, ...]:
    """Every registered model, whether a fit can start from its name or not."""
    _load_ours()
    return tuple(_BY_NAME.values())


def find_model(name: str) -> Registered | None:
    """The model of this name, whatever its case; its distribution is imported. None where there is none.

    Raises `InputError` where its distribution cannot be imported.
    """
    _load_ours()
    known = _BY_NAME.get(name.casefold())
    if known is not None:
        return known
    for point in _entry_points():
        if point.name.casefold() == name.casefold():
            return _loaded(point)
    return None


def registered(kind: type) -> Registered | None:
    """What is registered of this very class; None where it is not."""
    _load_ours()
    known = _BY_CLASS.get(class_key(kind))
    return known if known is not None and known.kind is kind else None


def class_of(key: str) -> type:
    """The class that a file calls `package:Class`, or one of ours by its bare name.

    Of other packages than ours only those are imported that announce a model in `hysid.models`.

    Raises `InputError` `unknown-model` for a class that is not registered.
    """
    _load_ours()
    package, colon, name = key.rpartition(":")
    keys = [key] if colon else [f"{ours}:{name}" for ours in OURS]
    for found in filter(None, map(_BY_CLASS.get, keys)):
        return found.kind
    points = [p for p in _entry_points() if colon and p.module.partition(".")[0] == package]
    for point in sorted(points, key=lambda p: p.attr != name):
        _loaded(point)
        if key in _BY_CLASS:
            return _BY_CLASS[key].kind
    if package in ("", *OURS):
        raise InputError(
            "unknown-model",
            f"the file names the class {key!r}, which this version does not have.",
            cause="a newer version wrote it, or it was edited.",
            fix="update hysid, or make the file again.",
        )
    raise InputError(
        "unknown-model",
        f"the file names the class {key!r}, which is not registered here.",
        cause=f"the module that registers {name} is not imported, or not installed.",
        fix=f"import that module of {package} first; it has to call hysteresis.register({name}).",
    )


def similar(name: str, names: tuple[str, ...]) -> str:
    """The name that was probably meant, or an empty string."""
    folded = {one.casefold(): one for one in names}
    close = difflib.get_close_matches(name.casefold(), folded, 1)
    return folded[close[0]] if close else ""


def _entry_points() -> Iterator[EntryPoint]:
    yield from entry_points(group=GROUP)


def _loaded(point: Any) -> Registered:  # an `EntryPoint`, also of the backport
    """What an entry point names; registered under the entry's name where its module did not do it."""
    try:
        kind = point.load()
    except Exception as error:
        raise InputError(
            "broken-plug-in",
            f"the model {point.name} cannot be imported: {type(error).__name__}: {error}.",
            place=f"entry point {point.value} of {GROUP}",
            fix="repair or remove the distribution that announces it.",
        ) from error
    known = registered(kind) if inspect.isclass(kind) else None
    if known is None:
        register(kind, name=point.name)
        known = registered(kind)
    if known is None or not known.is_model:
        raise InputError(
            "not-a-model",
            f"{point.value} is not a model.",
            place=f"entry point {point.name} of {GROUP}",
            fix="name a subclass of AbstractModel.",
        )
    return known


def _has_defaults(kind: Any) -> bool:
    """Whether it can be made without arguments, and then has something to fit."""
    own = [field for field in fields(kind) if field.init]
    to_fit = (field.metadata.get("parameter") for field in own)
    given = (f.default is not MISSING or f.default_factory is not MISSING for f in own)
    return all(given) and any(info is not None and not info.fixed for info in to_fit)


def _is_same(one: type, other: type) -> bool:
    """Whether both are one class, perhaps of a cell or module that was run again."""
    return (one.__module__, one.__qualname__) == (other.__module__, other.__qualname__)


def _taken(name: str, kind: type) -> InputError:
    return InputError(
        "name-taken",
        f"{name} is the name of another class, {kind.__module__}.{kind.__qualname__}.",
        fix='give the class another name, or the model another one in fits: register(..., name="...").',
    )
