"""Files as rigs write them: one table out of each, whatever stands around it.

A plain CSV needs none of this. Here are what machines export: LabVIEW (.lvm, .tdms), JSON, spreadsheets,
MATLAB, HDF5, Parquet, ROS bags, the dialects of `dialects.toml`, any text with notes above or no names.
"""
