"""The laws that every model of hysid keeps."""

import jax
from hysid_duhem import Duhem

from hysteresis.testing import check_model

jax.config.update("jax_enable_x64", True)


def test_laws():
    check_model(Duhem(0.5, 1.0, 0.7), low=-2.0, high=3.0)
