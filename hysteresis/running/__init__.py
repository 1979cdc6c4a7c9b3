"""Trees of laws over time: run, inverted and differentiated by what is compiled from the laws' own text."""
