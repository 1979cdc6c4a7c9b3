"""Guesses of `hysid init`: the roles of the columns in an unknown file."""
