"""Compensators that learn, while they run, how their sensor has changed."""
