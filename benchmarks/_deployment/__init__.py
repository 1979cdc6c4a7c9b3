"""Parts of `benchmarks.deployment`: each module gives rows."""
