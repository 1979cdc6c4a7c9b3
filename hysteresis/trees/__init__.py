"""Models as trees of laws: what `AbstractModel.tree` gives is made of this."""

from .._model import Tree as Tree
from ._node import FLAT_WIDTH as FLAT_WIDTH
from ._node import ROUNDING as ROUNDING
from ._node import curve as curve
from ._node import node as node
from ._node import plain as plain
from ._node import polygon as polygon
from ._node import series as series
from ._search import AbstractSearchedModel as AbstractSearchedModel
from ._search import common_range as common_range
from ._search import input_range as input_range
from ._search import looked_for as looked_for
from ._search import part_tree as part_tree
from ._search import precisions as precisions
from ._search import reach_of as reach_of
from ._search import search_range as search_range
from ._search import size_of as size_of
from ._search import widened as widened
