"""What bad data and bad settings are answered with."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from hysteresis import InputError


@contextmanager
def raises(code: str, *words: str) -> Iterator[None]:
    """The block raises an InputError with this code, whose message has these words."""
    with pytest.raises(InputError) as caught:
        yield
    said = str(caught.value)
    assert caught.value.code == code, said
    for word in words:
        assert word in said


def refuses(code: str, call: Callable[[], object], *words: str) -> None:
    """Of one call."""
    with raises(code, *words):
        call()
