"""Several masses with hysteretic links between them: chains, and matrices M, C and K."""

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from .._errors import InputError
from .._model import AbstractModel, AbstractSteppedModel
from .._parameter import is_concrete, parameter
from .._registry import register
from ..models._compose import Sum
from ..numerics._newton import root_of
from ._rate_form import AbstractRateForm
from ._runge_kutta import runge_kutta

INTEGRATORS = ("newmark", "runge-kutta")

Matrix = Float[Array, "masses masses"] | Any
Vector = Float[Array, " masses"] | Any


class CoupledState(NamedTuple):
    """Time (NaN before the first sample), forces and motion of the masses, and the parts' states."""

    t: Array
    force: Vector
    displacement: Vector
    velocity: Vector
    acceleration: Vector
    parts: tuple[Any, ...]


class System(NamedTuple):
    """Matrices of mass, damping and stiffness, and of the links: L y is how far each is stretched."""

    mass: Matrix
    damping: Matrix
    stiffness: Matrix
    links: Float[Array, "links masses"] | Any


@register
class CoupledOscillators(AbstractSteppedModel[CoupledState]):
    """Masses, dampers and springs with hysteretic links between them.

        M y'' + C y' + K y + L' z[L y] = u

    L y are the stretches of the links, and z their hysteretic forces, one model each. A row of L says what
    stretches a link: (1, -1) is the difference of two coordinates, (0, 1) the second one against the
    ground. Without `links` the masses are a chain from a wall outwards, and link l joins mass l to the one
    before.

    As a model of one input and one output the force acts on the mass `driven`, and the output is the
    displacement of the mass `observed`; `displacements` takes forces on all masses and returns all
    displacements. The motion starts at rest, and the force is straight between its samples.

    **Arguments:**

    - `mass`: (n,) masses, or (n, n) a symmetric, positive definite matrix.
    - `damping`, `stiffness`: (l,) of the dampers and springs beside each link, or (n, n) symmetric
      matrices. A fit changes vectors and keeps matrices.
    - `hysteresis`: l models of a force over a displacement, or None for a link without.
    - `links`: (l, n) L.
    - `driven`, `observed`: places among the masses; the last one unless given.
    - `substeps`: steps of the integration to a sample. `integrator`: `"newmark"`, average acceleration of
      second order, or `"runge-kutta"`, of fourth order between turning points of the links.

    Raises `InputError` where shapes differ, a matrix is not symmetric, masses are not positive, or an
    option is unknown.

    Source: Newmark 1959; Clough and Penzien, Dynamics of Structures (1993).

    **Example:**

        >>> spring = hysteresis.BoucWenForce(alpha=5e4, beta_gamma=800.0)
        >>> chain = hysteresis.CoupledOscillators([2.0, 1.0], [10.0, 10.0], [5e4, 3e4], (spring, None))
        >>> t = np.arange(4) / 750
        >>> (1e6 * np.asarray(chain.simulate(t, [0.0, 40.0, 40.0, 40.0]))).round(1).tolist()
        [0.0, 11.8, 81.4, 216.2]
    """

    mass: Vector | Matrix = parameter(unit="mass", bounds=(0.0, float("inf")), meaning="masses")
    damping: Vector | Matrix = parameter(
        unit="force * time / displacement", bounds=(0.0, float("inf")), meaning="forces by velocity"
    )
    stiffness: Vector | Matrix = parameter(
        unit="force / displacement", meaning="springs beside the hysteresis"
    )
    hysteresis: tuple[AbstractModel | None, ...] = eqx.field(converter=tuple, default=())
    links: Float[Array, "links masses"] | Any = parameter(
        None, fixed=True, meaning="what stretches each link"
    )
    driven: int = eqx.field(static=True, default=-1)
    observed: int = eqx.field(static=True, default=-1)
    substeps: int = eqx.field(static=True, default=20)
    integrator: str = eqx.field(static=True, default="newmark")
    moved_by_force: ClassVar[bool] = True

    def __check_init__(self) -> None:
        n = jnp.shape(self.mass)[-1] if jnp.ndim(self.mass) else 0
        count = n if self.links is None else jnp.shape(self.links)[0]
        shapes = [jnp.shape(one) for one in (self.mass, self.damping, self.stiffness)]
        fits = shapes[0] in ((n,), (n, n)) and all(s in ((count,), (n, n)) for s in shapes[1:])
        if n < 1 or not fits or (self.links is not None and jnp.shape(self.links) != (count, n)):
            raise InputError(
                "length-mismatch",
                f"masses, dampings and stiffnesses of the shapes {', '.join(map(str, shapes))} for {count}"
                " links.",
                fix="give n masses or an n by n matrix, and of the others one a link or an n by n matrix.",
            )
        if len(self.hysteresis) != count or not all(
            one is None or isinstance(one, AbstractModel) for one in self.hysteresis
        ):
            raise InputError(
                "bad-parts",
                f"{len(self.hysteresis)} entries of hysteresis for {count} links.",
                fix="give each link a model of its force, or None for one without hysteresis.",
            )
        for name, place in (("driven", self.driven), ("observed", self.observed)):
            if not -n <= place < n:
                raise InputError("bad-option", f"{name}={place}; there are {n} masses.")
        if self.integrator not in INTEGRATORS:
            said = f"integrator={self.integrator!r}; have {', '.join(INTEGRATORS)}."
            raise InputError("bad-option", said)
        if self.substeps < 1:
            raise InputError("bad-option", f"substeps={self.substeps}; at least 1.")
        self._check_values()

    def _check_values(self) -> None:
        for name in ("mass", "damping", "stiffness"):
            if not is_concrete(value := getattr(self, name)):
                continue
            known = np.asarray(value)
            if known.ndim == 2 and not np.allclose(known, known.T, rtol=1e-9, atol=0):
                raise InputError(
                    "parameter-out-of-bounds",
                    f"the matrix {name} is not symmetric.",
                    fix="give the matrices of an assembled structure.",
                )
            if name == "mass" and not np.all(
                (np.linalg.eigvalsh(known) if known.ndim == 2 else known) > 0
            ):
                raise InputError(
                    "parameter-out-of-bounds",
                    f"the masses {known.tolist()} are not all positive.",
                    cause="without a mass the force sets no acceleration.",
                    fix="give positive masses, or a positive definite matrix.",
                )

    def system(self) -> System:
        """The matrices of the equation of motion."""
        n, dtype = self.mass.shape[-1], self.mass.dtype
        L = (
            self.links
            if self.links is not None
            else jnp.asarray(np.eye(n) - np.eye(n, k=-1), dtype)
        )
        C, K = (
            one if one.ndim == 2 else L.T @ (one[:, None] * L)
            for one in (self.damping, self.stiffness)
        )
        return System(self.mass if self.mass.ndim == 2 else jnp.diag(self.mass), C, K, L)

    @property
    def parts(self) -> tuple[tuple[int, AbstractModel], ...]:
        """Every model of a hysteretic force with the number of its link; a `Sum` counts as its parts."""
        return tuple(
            (link, part)
            for link, model in enumerate(self.hysteresis)
            if model is not None
            for part in (model.parts if isinstance(model, Sum) else (model,))
        )

    def init(self, t0: Any = None, u0: Any = None) -> CoupledState:
        zero = jnp.zeros_like(jnp.diagonal(self.system().mass))
        t = zero[0] * jnp.nan if t0 is None else jnp.asarray(t0, zero.dtype)
        return CoupledState(t, zero, zero, zero, zero, tuple(part.init() for _, part in self.parts))

    def step(self, state: CoupledState, t: Any, u: Any) -> tuple[CoupledState, Float[Array, ""]]:
        force = jnp.zeros_like(state.force).at[self.driven].set(jnp.asarray(u, state.force.dtype))
        after = self.moved(state, t, force)
        return after, after.displacement[self.observed]

    def displacements(self, t: ArrayLike, forces: ArrayLike) -> Float[np.ndarray, "samples masses"]:
        """Displacements of all masses from rest, under forces (samples, masses).

        Raises `InputError` `length-mismatch` where their shapes do not fit.
        """
        state = self.init()
        times, u = jnp.asarray(t, state.force.dtype), jnp.asarray(forces, state.force.dtype)
        if u.shape != (*times.shape, len(state.force)):
            raise InputError(
                "length-mismatch",
                f"forces of shape {u.shape} at {times.shape} times for {len(state.force)} masses.",
                fix="give a row of forces for each time, one a mass.",
            )
        return np.asarray(_all_displacements(self, state, times, u))

    def moved(self, state: CoupledState, t: Any, force: Vector) -> CoupledState:
        """The state at the time t, under forces (masses,) that go straight to `force`."""
        if t is None:
            raise InputError(
                "no-time",
                "coupled oscillators need a clock.",
                fix="give times, in the unit of their parameters.",
            )
        t = jnp.asarray(t, state.t.dtype)
        system, new = self.system(), jnp.isnan(state.t)
        M, C, K, L = system
        h = jnp.where(new, 0.0, t - jnp.where(new, t, state.t)) / self.substeps
        last = jnp.where(new, force, state.force)
        # The first sample is where the motion begins: its acceleration alone is found.
        _, z = self._links(state.parts, t, L @ state.displacement)
        left = last - C @ state.velocity - K @ state.displacement - L.T @ z
        begun = jnp.where(new, jnp.linalg.solve(M, left), state.acceleration)
        state = state._replace(t=t, force=last, acceleration=begun)
        advance = self._newmark if self.integrator == "newmark" else self._runge_kutta

        def fine(at: CoupledState, k: Array) -> tuple[CoupledState, None]:
            end = last + (force - last) * ((k + 1.0) / self.substeps)
            clock = t - h * (self.substeps - 1.0 - k)
            return advance(system, at, clock, h, end)._replace(t=clock, force=end), None

        after, _ = jax.lax.scan(fine, state, jnp.arange(self.substeps, dtype=h.dtype))
        return after._replace(t=t, force=force)

    def _links(
        self, states: tuple[Any, ...], t: Any, stretch: Array, rates: tuple[Any, ...] | None = None
    ) -> tuple[tuple[Any, ...], Array]:
        """States of the parts and forces of the links at these stretches. With `rates`, those before and
        after a step and its length, parts in rate form follow the trapezoidal rule."""
        after, z = [], jnp.zeros_like(stretch)
        for (link, part), own in zip(self.parts, states, strict=True):
            if rates is not None and isinstance(part, AbstractRateForm):
                v, v1, h = rates
                force = part.after(own.z, v[link], v1[link], h)
                own = own._replace(u=stretch[link], z=force)
            else:
                own, force = part.step(own, t, stretch[link])
            after.append(own)
            z = z.at[link].add(force)
        return tuple(after), z

    def _newmark(
        self, system: System, at: CoupledState, t: Array, h: Array, force: Vector
    ) -> CoupledState:
        """One step of average acceleration."""
        M, C, K, L = system

        def motion(a1: Array) -> tuple[Array, Array, Any]:
            y1 = at.displacement + h * at.velocity + 0.25 * h * h * (at.acceleration + a1)
            v1 = at.velocity + 0.5 * h * (at.acceleration + a1)
            return y1, v1, self._links(at.parts, t, L @ y1, (L @ at.velocity, L @ v1, h))

        def off(a1: Array) -> Array:
            y1, v1, (_, z) = motion(a1)
            return M @ a1 + C @ v1 + K @ y1 + L.T @ z - force

        a1 = root_of(off, at.acceleration)
        y1, v1, (parts, _) = motion(a1)
        return at._replace(displacement=y1, velocity=v1, acceleration=a1, parts=parts)

    def _runge_kutta(
        self, system: System, at: CoupledState, t: Array, h: Array, force: Vector
    ) -> CoupledState:
        """One step of the classical Runge-Kutta method; parts begin in their states before the step."""
        M, C, K, L = system

        def slopes(motion: Any, share: float) -> Any:
            y, v = motion
            push = at.force + (force - at.force) * share
            left = push - C @ v - K @ y - L.T @ self._links(at.parts, t, L @ y)[1]
            return v, jnp.linalg.solve(M, left)

        y1, v1 = runge_kutta(slopes, (at.displacement, at.velocity), h)
        _, a1 = slopes((y1, v1), 1.0)
        parts, _ = self._links(at.parts, t, L @ y1)
        return at._replace(displacement=y1, velocity=v1, acceleration=a1, parts=parts)


@eqx.filter_jit
def _all_displacements(
    model: CoupledOscillators, state: CoupledState, t: Array, forces: Array
) -> Array:
    def sample(state: CoupledState, at: tuple[Array, Array]) -> tuple[CoupledState, Array]:
        after = model.moved(state, *at)
        return after, after.displacement

    return jax.lax.scan(sample, state, (t, forces))[1]
