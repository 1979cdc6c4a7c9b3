"""`python -m hysid` is the command `hysid`."""

from ._cli import main

main()
