"""What programs built on hysteresis share with it: units, warnings about records, and rigs of its studies.

These functions and classes are documented and tested, and hysid uses them. They are not part of the public
interface: they may change with any release.
"""

from ._quantities import Units as Units
from ._quantities import conversion as conversion
from ._quantities import with_units as with_units
from .models._extrapolation import extended as extended
from .models._staircase_network import StaircaseNetwork as StaircaseNetwork
from .preisach._density import SumDensity as SumDensity
from .records._excitation import check_identifiable as check_identifiable
from .records._excitation import loop_direction as loop_direction
from .rigs._channel_geometry import ChannelGeometryRig as ChannelGeometryRig
from .rigs._foam_block import FoamBlock as FoamBlock
from .rigs._force_sensors import ForceSensor as ForceSensor
from .rigs._force_sensors import GaugeSensor as GaugeSensor
from .rigs._skin_presses import ResistiveReadout as ResistiveReadout
from .rigs._sponge import force_path as force_path
