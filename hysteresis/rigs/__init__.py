"""Virtual test rigs: physics that no model of ours contains, sampled as a rig would sample it."""

from ._sponge import SpongeRig as SpongeRig
