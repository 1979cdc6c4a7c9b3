"""The parts of `benchmarks.deployment`."""
