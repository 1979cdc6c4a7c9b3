"""Whether a fit can be trusted: whiteness, profile likelihood, sloppiness, sensitivity."""
