"""What a fit gives back, and its figures of merit."""
