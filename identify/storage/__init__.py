"""Files kept whole: checkpoints and a model as data."""
