"""Where a robot under a soft cover is touched, from the wrench at its base."""

from ..runtime._contact import ContactStatus as ContactStatus
from ._armor import Armor as Armor
from ._calibration import Presses as Presses
from ._calibration import planned_presses as planned_presses
from ._cover import Bumps as Bumps
from ._cover import Cover as Cover
from ._export import export_armor as export_armor
from ._mesh import Mesh as Mesh
from ._mesh import forearm as forearm
from ._mesh import head as head
from ._shapes import Box as Box
from ._shapes import Convex as Convex
from ._solver import ContactSolver as ContactSolver
from ._solver import ContactStream as ContactStream
from ._wrench import Motion as Motion
from ._wrench import WristSensor as WristSensor
