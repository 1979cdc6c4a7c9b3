"""Programs are forgotten before they take all memory maps of a process, and not earlier."""

import sys

import jax
import jax.numpy as jnp
import pytest

from hysteresis.numerics import _compiled


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="memory maps are counted on Linux")
def test_programs_are_forgotten_where_there_are_too_many(monkeypatch: pytest.MonkeyPatch):
    double = jax.jit(lambda x: 2 * x)
    double(jnp.zeros(3))
    _compiled.forget_compiled()
    assert double._cache_size() == 1
    monkeypatch.setattr(_compiled, "MOST", 0)
    _compiled.forget_compiled()
    assert double._cache_size() == 0
    assert double(jnp.ones(3)).tolist() == [2.0, 2.0, 2.0]
