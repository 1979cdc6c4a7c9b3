"""Fits of long records beside the programs that others would use for them."""
