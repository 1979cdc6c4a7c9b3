"""What programs built on compensate share with it: its compensators, and the estimators of soft sensors.

`invert`, `calibrated`, `hysid.train_force` and others give these back. They are documented and tested, and
hysid uses them. They are not part of the public interface: they may change with any release.
"""

from ._contract import Estimate as Estimate
from .armor._armor import UncertainArmor as UncertainArmor
from .armor._calibration import PressResiduals as PressResiduals
from .armor._calibration import missed_of as missed_of
from .armor._calibration import with_slip as with_slip
from .armor._calibration import without_each as without_each
from .armor._wrench import Slip as Slip
from .inverses import BracketedCompensator as BracketedCompensator
from .microchannel._force import BackwardsModel as BackwardsModel
from .microchannel._force import ForceEstimator as ForceEstimator
from .microchannel._localizer import PlaceStatus as PlaceStatus
from .microchannel._logic_table import LogicStatus as LogicStatus
from .microchannel._multi import ChannelSensor as ChannelSensor
from .microchannel._multi import ForceNetwork as ForceNetwork
from .microchannel._multi import MotionFilter as MotionFilter
from .microchannel._multi import MultiContactEstimator as MultiContactEstimator
from .microchannel._multi import SearchEstimator as SearchEstimator
from .microchannel._readout import ChannelStatus as ChannelStatus
from .microchannel._readout import Readout as Readout
from .microchannel._readout import gains_in_use as gains_in_use
from .recalibration._adaptive import Advice as Advice
from .uncertainty._calibrated import CalibratedCompensator as CalibratedCompensator
from .uncertainty._ensemble import EnsembleCompensator as EnsembleCompensator
