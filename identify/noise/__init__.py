"""The noise model: definition, restricted likelihood, adequacy, variance inflation."""
