"""Curves without memory, to be used alone or before and after another stage."""

from .models._curves import Clip as Clip
from .models._curves import FoamCurve as FoamCurve
from .models._curves import MonotoneCurve as MonotoneCurve
from .models._curves import MonotoneSpline as MonotoneSpline
from .models._curves import PolynomialCurve as PolynomialCurve
