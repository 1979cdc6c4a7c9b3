"""Guards: estimates limited to the trained inputs, and told while the first state is not known."""
