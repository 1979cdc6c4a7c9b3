"""Virtual test rigs: physics that no model of ours contains, sampled as a rig would sample it."""

from ._armor import INWARD as INWARD
from ._armor import ArmorPoints as ArmorPoints
from ._armor import ArmorPresses as ArmorPresses
from ._armor import ArmorRig as ArmorRig
from ._armor import force_path as force_path
from ._armor import mixed_forces as mixed_forces
from ._channel_readout import CapacitiveReadout as CapacitiveReadout
from ._channel_readout import ResistiveReadout as ResistiveReadout
from ._force_loop import ChannelStream as ChannelStream
from ._force_loop import ForceLoop as ForceLoop
from ._force_loop import ForceLoopRig as ForceLoopRig
from ._force_loop import Pressed as Pressed
from ._force_sensor import ForceSensor as ForceSensor
from ._microchannel import ChannelPresses as ChannelPresses
from ._microchannel import ChannelRecord as ChannelRecord
from ._microchannel import MicrochannelRig as MicrochannelRig
from ._sponge import SpongeCycles as SpongeCycles
from ._sponge import SpongeRig as SpongeRig
