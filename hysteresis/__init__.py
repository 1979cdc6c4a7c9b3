"""What a material or a sensor does: models with memory, records of measurements, virtual rigs."""

from ._csv import Table as Table
from ._csv import parse_condition as parse_condition
from ._csv import read_csv as read_csv
from ._csv import read_table as read_table
from ._errors import InputError as InputError
from ._fitness import check_identifiable as check_identifiable
from ._fitness import loop_direction as loop_direction
from ._model import AbstractModel as AbstractModel
from ._parameter import ParameterInfo as ParameterInfo
from ._parameter import is_concrete as is_concrete
from ._parameter import parameter_at as parameter_at
from ._parameter import parameters as parameters
from ._prandtl_ishlinskii import PlayState as PlayState
from ._prandtl_ishlinskii import PrandtlIshlinskii as PrandtlIshlinskii
from ._record import Record as Record
from ._sponge import LinearSponge as LinearSponge
from ._viscoelastic import Burgers as Burgers
from ._viscoelastic import BurgersState as BurgersState
from .preisach import KrasnoselskiiPokrovskii as KrasnoselskiiPokrovskii
from .preisach import MovingPreisach as MovingPreisach
from .preisach import OutputDependentPreisach as OutputDependentPreisach
from .preisach import Preisach as Preisach
