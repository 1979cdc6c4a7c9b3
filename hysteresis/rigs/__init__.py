"""Virtual test rigs, of which no model is the whole, sampled as a rig would sample them."""

from ._armor import INWARD as INWARD
from ._armor import ArmorRig as ArmorRig
from ._microchannel import MicrochannelRig as MicrochannelRig
from ._sponge import SpongeRig as SpongeRig
