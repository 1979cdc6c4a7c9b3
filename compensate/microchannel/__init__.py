"""Force and place from the hysteretic voltages of soft microchannel sensors."""

from ._everett_network import EverettNetwork as EverettNetwork
from ._export import export_contacts as export_contacts
from ._export import export_force as export_force
from ._force import BackwardsModel as BackwardsModel
from ._force import ForceEstimator as ForceEstimator
from ._gains import gains_in_use as gains_in_use
from ._localizer import Localizer as Localizer
from ._localizer import PlaceStatus as PlaceStatus
from ._logic_table import LogicStatus as LogicStatus
from ._logic_table import LogicTable as LogicTable
from ._multi import ChannelSensor as ChannelSensor
from ._multi import MotionFilter as MotionFilter
from ._multi import MultiContactEstimator as MultiContactEstimator
from ._multi_network import ForceNetwork as ForceNetwork
from ._multi_network import SearchEstimator as SearchEstimator
from ._readout import ChannelStatus as ChannelStatus
from ._readout import Readout as Readout
