"""Networks as models: differentiable, with a state, but without the laws that an inverse needs."""

from .models._staircase_network import StaircaseNetwork as StaircaseNetwork
