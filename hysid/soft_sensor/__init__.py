"""Soft sensors: training and estimating forces, places and positions."""
