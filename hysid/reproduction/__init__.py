"""A paper's experiments made anew on virtual laboratories."""

from ._frame import reproduce as reproduce
from ._frame import terminal as terminal
