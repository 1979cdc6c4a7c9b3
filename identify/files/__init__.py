"""The fit folder on disk."""
