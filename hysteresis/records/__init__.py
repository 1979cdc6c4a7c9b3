"""Measured records: arrays with units, the files they come from, warnings about the data."""
