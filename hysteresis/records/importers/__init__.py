"""Files as rigs write them: one table out of each, whatever stands around it.

A plain CSV needs none of this. Here are what machines export: LabVIEW (.lvm, .tdms), JSON, spreadsheets,
MATLAB, HDF5, Parquet, ROS bags, the dialects of `dialects.toml`, any text with notes above or no names.
"""

from ._binary import binary as binary
from ._encoding import decode as decode
from ._file import fault as fault
from ._file import file_bytes as file_bytes
from ._file import mapped as mapped
from ._json_lines import json_lines as json_lines
from ._labview import labview as labview
from ._notes import clock_in as clock_in
from ._notes import noted_units as noted_units
from ._notes import units_behind_blanks as units_behind_blanks
from ._notes import without_settings as without_settings
from ._sheet import Layout as Layout
from ._sheet import Sheet as Sheet
from ._sheet import feet_left_out as feet_left_out
from ._sheet import feet_of as feet_of
from ._sheet import is_number as is_number
from ._sheet import trimmed as trimmed
from ._text import arranged as arranged
from ._text import splitter as splitter
from ._text import without_table as without_table
