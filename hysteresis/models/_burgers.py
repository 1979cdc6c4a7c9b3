"""Models of one delay: the Burgers element, and the standard linear solid."""

from typing import ClassVar

import equinox as eqx

from .._parameter import Scalar, array_module, parameter
from .._registry import register
from ._viscoelastic import MODULUS, STIFFNESS, VISCOSITY, AbstractViscoelastic, Chain, Hold


@register
class Burgers(AbstractViscoelastic):
    """Burgers model, force -> displacement, a spring, a dashpot and a Kelvin-Voigt element in series:

        x1' = F / eta1,    x2' = (F - E2 x2) / eta2,    d = F / E1 + x1 + x2 + offset

    The creep compliance is J(t) = 1/E1 + t/eta1 + (1 - exp(-E2 t/eta2)) / E2. There is no internal
    displacement before the first sample, so a first force other than zero is a jump. Steps are exact
    at any spacing, even or uneven, for a force that is piecewise linear (`hold="linear"`) or keeps
    its last value until the next sample (`hold="constant"`).

    **Arguments:** moduli `E1`, `E2` (N/mm), viscosities `eta1`, `eta2` (N s/mm), all positive,
    and the output's `offset`.

    **Other arguments:**

    - `leading`: displacement -> force instead. Each step solves the last equation for F, so this is
      the exact algebraic inverse. The output then leads the input.
    - `hold`: the force between samples, `"linear"` or `"constant"`.

    Raises `InputError` where a modulus or viscosity is not positive.

    Source: Findley, Lai and Onaran, Creep and relaxation of nonlinear viscoelastic materials (1976);
    exact steps re-derived.

    **Example:**

        >>> creep = hysteresis.Burgers(E1=2.0, eta1=10.0, E2=1.0, eta2=1.0)
        >>> np.asarray(creep.simulate(np.arange(4.0), np.ones(4))).round(2).tolist()
        [0.5, 1.23, 1.56, 1.75]
    """

    E1: Scalar = parameter(unit=STIFFNESS, **MODULUS, meaning="instantaneous stiffness")
    eta1: Scalar = parameter(unit=VISCOSITY, **MODULUS, meaning="viscosity of flow")
    E2: Scalar = parameter(unit=STIFFNESS, **MODULUS, meaning="stiffness of delayed part")
    eta2: Scalar = parameter(unit=VISCOSITY, **MODULUS, meaning="viscosity of delayed part")
    offset: Scalar = parameter(0.0, unit="output", meaning="output of the unloaded model")
    leading: bool = eqx.field(default=False, static=True)
    hold: Hold = eqx.field(default="linear", static=True)
    creeps: ClassVar[bool] = True

    def chain(self) -> Chain:
        flow = 1 / array_module(self.eta1).asarray(self.eta1)
        return one_branch(self.E1, self.E2, self.eta2)._replace(flow=flow)


@register
class StandardLinearSolid(AbstractViscoelastic):
    """Standard linear solid, force -> displacement, a spring and a Kelvin-Voigt element in series:

        x' = (F - E2 x) / eta2,    d = F / E1 + x + offset

    The creep compliance is J(t) = 1/E1 + (1 - exp(-E2 t/eta2)) / E2. This is a Burgers element that does
    not flow.

    **Arguments:** moduli `E1`, `E2`, viscosity `eta2`, all positive, the output's `offset`;
    `leading` and `hold` as for `Burgers`.

    Raises `InputError` where a modulus or viscosity is not positive.

    **Example:**

        >>> solid = hysteresis.StandardLinearSolid(E1=2.0, E2=1.0, eta2=1.0)
        >>> np.asarray(solid.simulate(np.arange(4.0), np.ones(4))).round(2).tolist()
        [0.5, 1.13, 1.36, 1.45]
    """

    E1: Scalar = parameter(unit=STIFFNESS, **MODULUS, meaning="instantaneous stiffness")
    E2: Scalar = parameter(unit=STIFFNESS, **MODULUS, meaning="stiffness of delayed part")
    eta2: Scalar = parameter(unit=VISCOSITY, **MODULUS, meaning="viscosity of delayed part")
    offset: Scalar = parameter(0.0, unit="output", meaning="output of the unloaded model")
    leading: bool = eqx.field(default=False, static=True)
    hold: Hold = eqx.field(default="linear", static=True)
    creeps: ClassVar[bool] = True

    def chain(self) -> Chain:
        return one_branch(self.E1, self.E2, self.eta2)


def one_branch(E1: Scalar, E2: Scalar, eta2: Scalar) -> Chain:
    """A spring and a Kelvin-Voigt element in series."""
    first, second, dashpot = map(array_module(E1, E2, eta2).asarray, (E1, E2, eta2))
    return Chain(1 / first, (second / dashpot)[None], (1 / dashpot)[None])
