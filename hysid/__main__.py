"""`python -m hysid` is the command `hysid`."""

from .cli._app import main

if __name__ == "__main__":  # the processes of a batch import it anew
    main()
