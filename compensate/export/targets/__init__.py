"""Exports for whole environments: a library, a package, a plugin around the one C99 source."""
