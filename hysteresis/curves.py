"""Curves without memory, to be used alone or before and after another stage."""

from ._curves import AbstractCurve as AbstractCurve
from ._curves import Clip as Clip
from ._curves import MonotoneCurve as MonotoneCurve
from ._curves import MonotoneSpline as MonotoneSpline
from ._curves import PolynomialCurve as PolynomialCurve
from ._foam_curve import FoamCurve as FoamCurve
