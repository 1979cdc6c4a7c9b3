"""The Preisach model, its densities and its memory."""

from ._density import AbstractDensity as AbstractDensity
from ._density import GridDensity as GridDensity
from ._everett import EverettTable as EverettTable
from ._everett import GridPairs as GridPairs
from ._everett import read as read
from ._memory import MemoryTree as MemoryTree
from ._memory import memory_tree as memory_tree
from ._preisach import Preisach as Preisach
from ._preisach import PreisachInput as PreisachInput
from ._preisach import PreisachState as PreisachState
from ._stack import OpenLoops as OpenLoops
