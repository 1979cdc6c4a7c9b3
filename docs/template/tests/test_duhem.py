"""The laws that every model of hysid keeps."""

from hysid_duhem import Duhem

import hysid
from hysteresis.testing import check_model

hysid.enable_x64()


def test_laws():
    check_model(Duhem(0.5, 1.0, 0.7), low=-2.0, high=3.0)
