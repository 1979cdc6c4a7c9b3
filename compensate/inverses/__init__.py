"""Exact inverses: what a model's laws find, and which models have none."""

from ._inverse_of import BracketedCompensator as BracketedCompensator
from ._inverse_of import inverse_of as inverse_of
