"""Networks as models: differentiable, with a state, but without the laws that an inverse needs."""

from ._neural import StaircaseNetwork as StaircaseNetwork
from ._neural import StaircaseState as StaircaseState
