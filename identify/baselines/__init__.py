"""Simple predictors that need no model: what a fit has to beat."""
