"""What a material or a sensor does: models with memory, records of measurements, virtual rigs."""

from ._errors import InputError as InputError
from ._model import AbstractModel as AbstractModel
from ._parameter import ParameterInfo as ParameterInfo
from ._parameter import is_concrete as is_concrete
from ._parameter import parameters as parameters
from ._sponge import LinearSponge as LinearSponge
from ._viscoelastic import Burgers as Burgers
from .preisach import Preisach as Preisach
