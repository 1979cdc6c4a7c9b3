"""Force and place from the hysteretic voltages of soft microchannel sensors."""

from ._everett_network import EverettNetwork as EverettNetwork
from ._force import ForceEstimator as ForceEstimator
from ._gains import gains_in_use as gains_in_use
from ._localizer import Confusion as Confusion
from ._localizer import Localizer as Localizer
from ._localizer import Located as Located
from ._localizer import PlaceStatus as PlaceStatus
from ._logic_remedies import Remedy as Remedy
from ._logic_table import Decision as Decision
from ._logic_table import LogicStatus as LogicStatus
from ._logic_table import LogicTable as LogicTable
from ._motion import AbstractSensor as AbstractSensor
from ._motion import MotionFilter as MotionFilter
from ._multi import ContactForces as ContactForces
from ._multi import MultiContactEstimator as MultiContactEstimator
from ._multi_network import ForceNetwork as ForceNetwork
from ._multi_network import SearchEstimator as SearchEstimator
from ._multi_network import windows as windows
from ._position import Position as Position
from ._position import PositionEstimator as PositionEstimator
from ._position import standardised as standardised
from ._readout import Changes as Changes
from ._readout import ChannelStatus as ChannelStatus
from ._readout import Readout as Readout
from ._readout import ReadoutState as ReadoutState
from ._sensors import ChannelSensor as ChannelSensor
