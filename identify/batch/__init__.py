"""Many records at once: `fit_many`."""
