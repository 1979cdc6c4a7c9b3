"""From a file and a selection of its rows to records."""
