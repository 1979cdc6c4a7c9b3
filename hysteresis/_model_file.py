"""One model as one JSON file: its structure in words, and its arrays as numbers."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from ._atomic_file import write_whole
from ._limits import damage_told
from ._serialisation import described, rebuilt


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
