"""Log-posterior, samplers, convergence diagnostics, predictive bands."""
