"""What a fit may change: parameter settings, priors, bounds as smooth transforms."""
