"""`check_model` passes what keeps the laws, and names the law that a model breaks."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from compensate import Status, invert
from hysteresis import AbstractModel, AbstractSteppedModel, Scalar, parameter, register
from hysteresis.testing import check_model


def test_the_model_of_the_template_keeps_the_laws_and_can_be_inverted(duhem: Any):
    model = duhem
    check_model(model, -2.0, 3.0)
    u = np.interp(np.arange(60), [0, 15, 35, 59], [0.0, 3.0, -2.0, 1.0])
    found = invert(model).simulate(None, model.simulate(None, u))
    np.testing.assert_allclose(found.value, u, atol=1e-9)
    assert (np.asarray(found.status) == Status.OK).all()


class AbstractSum(AbstractSteppedModel[Any]):
    """Sums its input's changes; each subclass breaks one law."""

    def init(self, t0: Any = None, u0: Any = None) -> Any:
        return jnp.zeros(()), jnp.zeros(())

    def step(self, state: Any, t: Any, u: Any) -> Any:
        return self.next(state, t, u)

    def next(self, state: Any, t: Any, u: Any) -> Any:
        """The state and the output."""
        return (u, state[1] + abs(u - state[0])), self.gain() * state[1]

    def gain(self) -> Any:
        """Of the output."""
        return getattr(self, "k", 1.0)


@register
class NeedsTimes(AbstractSum):
    """It works without times, but gives something else with them."""

    k: Scalar = parameter(1.0)

    def step(self, state: Any, t: Any, u: Any) -> Any:
        state, y = self.next(state, t, u)
        return state, y if t is None else y + t


class Unknown(AbstractSum):
    """Not registered."""

    k: Scalar = parameter(1.0)


@register
class WrongSlope(AbstractSum):
    """Its derivative is not that of its output."""

    k: Scalar = parameter(1.0)

    def step(self, state: Any, t: Any, u: Any) -> Any:
        state, y = self.next(state, t, u)
        return state, y + jax.lax.stop_gradient(self.gain() * u)


@register
class NotFinite(AbstractSum):
    """A square root of negative inputs."""

    k: Scalar = parameter(1.0)

    def step(self, state: Any, t: Any, u: Any) -> Any:
        return self.next(state, t, u)[0], jnp.sqrt(u)


@register
class Forgets(AbstractModel[Any, Any]):
    """`prepare` ignores the state."""

    k: Scalar = parameter(1.0)

    def init(self, t0: Any = None, u0: Any = None) -> Any:
        return jnp.zeros(())

    def step(self, state: Any, t: Any, u: Any) -> Any:
        return state + u, self.k * (state + u)

    def prepare(self, t: Any, u: Any, state: Any = None, *, starts: tuple[int, ...] = (0,)) -> Any:
        return jnp.asarray(u, float)

    def evaluate(self, prepared: Any) -> Any:
        return self.k * jnp.cumsum(prepared)


@register
class Delays(AbstractSum):
    """`evaluate` is that of another model."""

    k: Scalar = parameter(1.0)

    def evaluate(self, prepared: Any) -> Any:
        return self.k * prepared.u


@pytest.mark.parametrize(("model", "words"), [
    (NeedsTimes(), "without times"),
    (Unknown(), r"a file gives the model back: .*register\(Unknown\)"),
    (WrongSlope(), r"the gradient in k == finite differences fails. history \d: derivative"),
    (NotFinite(), "not finite at sample"),
    (Forgets(), r"a split record carries the state fails at sample \d+"),
    (Delays(), "simulate == the scan of step fails at sample"),
], ids=lambda x: type(x).__name__ if isinstance(x, AbstractModel) else "")  # fmt: skip
def test_a_broken_law_is_named(model: AbstractModel, words: str):
    with pytest.raises(AssertionError, match=words):
        check_model(model, -1.0, 2.0)
