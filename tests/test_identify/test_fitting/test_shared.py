"""Several specimens fitted together: shared parameters are equal, the others of each."""

import numpy as np
import pytest
from scipy.optimize import least_squares

import identify
from hysteresis import Burgers, Record
from tests.refusals import refuses
from tests.thorough import rest_thorough

T = np.linspace(0, 20, 100)
U = np.where((T > 0) & (T < 12), 2.0, 0.0)
TRUE = ((1.5, 20.0, 3.0, 6.0), (1.5, 35.0, 4.0, 6.0), (1.5, 28.0, 2.5, 9.0))
KNOWN = {"offset": {"fixed": 0}}
NAMES = ("E1", "eta1", "E2", "eta2")


def specimens(spread: float = 0.0) -> list[Record]:
    random = np.random.default_rng(0)
    sigma = np.exp(spread * random.normal(size=(len(TRUE), T.size)))
    found = []
    for numbers, each in zip(TRUE, sigma, strict=True):
        y = np.asarray(Burgers(*numbers).simulate(T, U))
        y = y + 0.05 * each * random.normal(size=T.size)
        found.append(Record.from_arrays(U, y, T, sigma=each if spread else None))
    return found


@pytest.mark.parametrize("spread", rest_thorough([1.0, 0.0], 1))
def test_parameters_and_errors_are_those_of_another_solver(spread):
    records, start = specimens(spread), Burgers(1.0, 10.0, 1.0, 3.0)
    found = identify.fit_shared(records, start, share=["E1"], starts=2, parameters=KNOWN)

    def residuals(z: np.ndarray) -> np.ndarray:
        off = []
        for k, one in enumerate(records):
            values = np.exp(np.append(z[0], z[1 + 3 * k : 4 + 3 * k]))
            r = np.asarray(Burgers(*values).simulate(T, U)) - one.output
            off.append(r if one.sigma is None else r / one.sigma)
        return np.concatenate(off)

    start = np.log([1.5, *(x for numbers in TRUE for x in numbers[1:])])
    other = least_squares(residuals, start, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    variance = 2 * other.cost / (len(other.fun) - len(other.x))
    errors = np.sqrt(np.diagonal(np.linalg.inv(other.jac.T @ other.jac)) * variance)
    for k, fit in enumerate(found):
        at = [0, 1 + 3 * k, 2 + 3 * k, 3 + 3 * k]
        values = np.array([fit[name].value for name in NAMES])
        assert values == pytest.approx(np.exp(other.x[at]), rel=1e-6)
        own = np.array([fit[name].stderr for name in NAMES]) / values
        # Ours differ by each specimen's own noise, which theirs take for one.
        assert own == pytest.approx(errors[at], rel=0.2)


def records_of(change: str) -> list[Record]:
    one, other, _ = specimens()
    if change == "alone":
        return [one]
    if change == "units":
        return [one, Record.from_arrays(U, other.output, T, output_unit="mm")]
    if change == "sigma":
        return [one, Record.from_arrays(U, other.output, T, sigma=np.ones(T.size))]
    return [one, other]


@pytest.mark.parametrize(("change", "model", "share", "known"), [
    ("alone", "Burgers", ["E1"], {}), ("units", "Burgers", ["E1"], {}),
    ("sigma", "Burgers", ["E1"], {}), ("", "Preisach", ["E1"], {}),
    ("", "Burgers,LinearSponge", ["E1"], {}), ("", "Burgers", ["stiffness"], {}),
    ("", "Burgers", [], {}),
    ("", "Burgers", ["E1"], {"E1": {"prior": "log-normal(2, 1.5)"}}),
])  # fmt: skip
def test_what_cannot_be_shared_is_refused(change, model, share, known):
    how = {"share": share, "starts": 1, "parameters": known}
    refuses("bad-option", lambda: identify.fit_shared(records_of(change), model, **how), "Fix: ")
