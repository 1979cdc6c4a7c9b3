"""The Preisach model, its densities and its memory."""

from ._coercive import GaussianDensity as GaussianDensity
from ._coercive import LogNormalDensity as LogNormalDensity
from ._coercive import LorentzianDensity as LorentzianDensity
from ._dead_band import input_noise as input_noise
from ._density import AbstractDensity as AbstractDensity
from ._density import GridDensity as GridDensity
from ._everett import EverettTable as EverettTable
from ._everett import GridPairs as GridPairs
from ._everett import read as read
from ._initial import Initial as Initial
from ._memory import MemoryTree as MemoryTree
from ._memory import memory_tree as memory_tree
from ._preisach import Preisach as Preisach
from ._preisach import PreisachInput as PreisachInput
from ._preisach import PreisachState as PreisachState
from ._stack import OpenLoops as OpenLoops
from ._sum import SumDensity as SumDensity
