"""The command line: console, options, one file per command."""
