"""Trees of laws over time: run, inverted and differentiated by what is compiled from the laws' own text."""

from ._numbers import Known as Known
from ._numbers import Numbers as Numbers
from ._numbers import held_at_first as held_at_first
from ._numbers import numbers_of as numbers_of
from ._numbers import place_of as place_of
from ._over_time import looks as looks
from ._over_time import run as run
from ._over_time import tangents as tangents
from ._traced import Told as Told
from ._traced import each as each
from ._traced import estimates as estimates
from ._traced import outputs as outputs
from ._traced import told as told
