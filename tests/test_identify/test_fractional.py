"""Fractional elements that sum a spectrum up: their numbers, and the ranges that the rows leave."""

from typing import Any

import numpy as np
import pytest

import identify
from tests.thorough import rest_thorough

W = np.geomspace(1e-3, 1e3, 60)


def noisy(modulus: np.ndarray, size: float) -> Any:
    random = np.random.default_rng(0)
    noise = random.normal(size=60) + 1j * random.normal(size=60)
    return identify.spectrum(identify.Response(W, modulus * (1 + size * noise), "modulus"))


@pytest.mark.parametrize(("alpha", "tau"), rest_thorough([(0.4, 0.5), (0.7, 3.0)], 1))
def test_a_fractional_zener_element_is_found_within_its_range(alpha, tau):
    x = (1j * W * tau) ** alpha
    pot, zener = noisy(2 + 8 * x / (1 + x), 0.01).fractional()
    true = np.array([2.0, 10.0, tau, alpha])
    assert zener.names == ("E_inf", "E_0", "tau", "alpha")
    assert zener.value == pytest.approx(true, rel=0.03)
    assert (zener.low < zener.value).all()
    assert (zener.value < zener.high).all()
    # Ranges of 90 %: not every one of eight holds its truth.
    assert np.sum((zener.low <= true) & (true <= zener.high)) >= 3
    assert zener.misfit < 0.01
    assert pot.misfit > 0.05
    assert "% off the spectrum" in str(zener)


def test_creep_of_one_time_constant_is_a_zener_element_of_whole_order():
    t = np.geomspace(0.1, 100, 60)
    found = identify.spectrum(identify.Response(t, 3 - 2 * np.exp(-t / 5)))
    _, zener = found.fractional()
    # J from 1 to 3 over 5: the modulus relaxes from 1 to 1/3, within 5/3.
    assert zener.value == pytest.approx([1 / 3, 1.0, 5 / 3, 1.0], rel=1e-4)
    assert zener.misfit < 1e-6
