"""`fit` and `fit_step`: candidates, selection, the verdict."""
