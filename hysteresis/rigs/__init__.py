"""Virtual test rigs, of which no model is the whole, sampled as a rig would sample them."""

from ._armor import INWARD as INWARD
from ._armor import ArmorRig as ArmorRig
from ._channel_geometry import ChannelGeometryRig as ChannelGeometryRig
from ._foam_block import FoamBlock as FoamBlock
from ._force_loop import ChannelStream as ChannelStream
from ._force_loop import ForceLoopRig as ForceLoopRig
from ._force_sensors import ForceSensor as ForceSensor
from ._force_sensors import GaugeSensor as GaugeSensor
from ._microchannel import MicrochannelRig as MicrochannelRig
from ._skin_presses import ResistiveReadout as ResistiveReadout
from ._sponge import SpongeRig as SpongeRig
from ._sponge import force_path as force_path
