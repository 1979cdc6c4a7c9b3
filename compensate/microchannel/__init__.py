"""Force and place from the hysteretic voltages of soft microchannel sensors."""

from ._export import export_contacts as export_contacts
from ._export import export_force as export_force
from ._localizer import Localizer as Localizer
from ._logic_table import LogicTable as LogicTable
