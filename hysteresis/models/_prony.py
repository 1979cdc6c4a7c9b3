"""Models of any number of delays: Kelvin-Voigt elements in series, Maxwell elements side by side."""

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._errors import InputError
from .._parameter import NOT_NEGATIVE, Scalar, array_module, check_shapes, is_concrete, parameter
from .._registry import register
from ._viscoelastic import MODULUS, STIFFNESS, VISCOSITY, AbstractViscoelastic, Chain, Hold

Values = Float[Array, " branches"] | Any
"""One value for each branch: anything that `jnp.asarray` takes, kept as an array."""


@register
class GeneralizedKelvinVoigt(AbstractViscoelastic):
    """Generalised Kelvin-Voigt model, force -> displacement: in series, a spring, n Kelvin-Voigt elements
    and, where `eta0` is given, a dashpot:

        x_k' = (F - E_k x_k) / eta_k,    x_0' = F / eta0,    d = F / E0 + sum of x + offset

    The creep compliance is J(t) = 1/E0 + t/eta0 + sum of (1 - exp(-E_k t/eta_k)) / E_k.

    **Arguments:**

    - `E0`: stiffness of the spring; infinite for no spring, a model that has no inverse.
    - `E`, `eta`: stiffnesses and viscosities of the elements, shape `(branches,)`; one whose stiffness is 0
      is a dashpot.
    - `eta0`: viscosity of flow, or None for an element that does not flow.
    - `offset`, `leading`, `hold`: as for `Burgers`.

    Raises `InputError` where `E0` or a viscosity is not positive, an `E` is negative, `E` and `eta` differ
    in length, or a leading model has no spring.

    **Example:**

        >>> creep = hysteresis.GeneralizedKelvinVoigt(E0=2.0, E=[1.0, 4.0], eta=[1.0, 40.0])
        >>> np.asarray(creep.simulate(np.arange(4.0), np.ones(4))).round(2).tolist()
        [0.5, 1.16, 1.41, 1.52]
    """

    E0: Scalar = parameter(unit=STIFFNESS, **MODULUS, meaning="instantaneous stiffness")
    E: Values = parameter(
        unit=STIFFNESS, **NOT_NEGATIVE, meaning="stiffnesses of the delayed parts"
    )
    eta: Values = parameter(unit=VISCOSITY, **MODULUS, meaning="viscosities of the delayed parts")
    eta0: Scalar | None = parameter(None, unit=VISCOSITY, **MODULUS, meaning="viscosity of flow")
    offset: Scalar = parameter(0.0, unit="output", meaning="output of the unloaded model")
    leading: bool = eqx.field(default=False, static=True)
    hold: Hold = eqx.field(default="linear", static=True)
    creeps: ClassVar[bool] = True

    def __check_init__(self) -> None:
        check_shapes(E=(self.E, "branches"), eta=(self.eta, "branches"))
        if self.leading and is_concrete(self.E0) and bool(jnp.isinf(self.E0).any()):
            said = "without a spring (E0 infinite) no force follows from a displacement."
            mend = "give a finite E0, or run it force -> displacement."
            raise InputError("not-invertible", said, fix=mend)

    def chain(self) -> Chain:
        xp = array_module(self.E0, self.E, self.eta, self.eta0 if self.eta0 is not None else 0.0)
        E, eta = xp.asarray(self.E), xp.asarray(self.eta)
        flow = None if self.eta0 is None else 1 / xp.asarray(self.eta0)
        return Chain(1 / xp.asarray(self.E0), E / eta, 1 / eta, flow)


@register
class GeneralizedMaxwell(AbstractViscoelastic):
    """Generalised Maxwell model (Prony series), displacement -> force: a spring and n Maxwell elements
    in parallel:

        x_k' = -(E_k d + x_k) / tau_k,    F = (E_inf + sum of E) d + sum of x + offset

    where E_k d + x_k is the force in an element. The relaxation modulus is
    G(t) = E_inf + sum of E_k exp(-t/tau_k).

    **Arguments:**

    - `E_inf`: stiffness of the spring; 0 for a liquid.
    - `E`, `tau`: stiffnesses and relaxation times (viscosity over stiffness) of the elements, shape
      `(branches,)`; one whose stiffness is 0 is not there.
    - `offset`: of the output.
    - `leading`: displacement -> force, whose output leads the input. False: force -> displacement, the
      exact algebraic inverse.
    - `hold`: the displacement between samples, `"linear"` or `"constant"`.

    Raises `InputError` where a modulus is negative or a time not positive, or `E` and `tau` differ in
    length.

    **Example:**

        >>> relax = hysteresis.GeneralizedMaxwell(E_inf=1.0, E=[2.0, 1.0], tau=[1.0, 10.0])
        >>> np.asarray(relax.simulate(np.arange(4.0), np.ones(4))).round(2).tolist()
        [4.0, 2.64, 2.09, 1.84]
    """

    E_inf: Scalar = parameter(unit=STIFFNESS, **NOT_NEGATIVE, meaning="stiffness at rest")
    E: Values = parameter(
        unit=STIFFNESS, **NOT_NEGATIVE, meaning="stiffnesses of the parts that relax"
    )
    tau: Values = parameter(unit="time", **MODULUS, meaning="relaxation times")
    offset: Scalar = parameter(0.0, unit="output", meaning="output of the unloaded model")
    leading: bool = eqx.field(default=True, static=True)
    hold: Hold = eqx.field(default="linear", static=True)
    creeps: ClassVar[bool] = False

    def __check_init__(self) -> None:
        check_shapes(E=(self.E, "branches"), tau=(self.tau, "branches"))

    def chain(self) -> Chain:
        xp = array_module(self.E_inf, self.E, self.tau)
        E, tau = xp.asarray(self.E), xp.asarray(self.tau)
        return Chain(self.E_inf + E.sum(), 1 / tau, -E / tau)
