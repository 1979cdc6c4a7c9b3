"""Exact inverses: what a model's laws find, and which models have none."""

from . import _compose as _compose
from . import _refusals as _refusals
from ._bisection import BracketedCompensator as BracketedCompensator
from ._inverse_of import inverse_of as inverse_of
