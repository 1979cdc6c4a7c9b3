"""Parts of `benchmarks.ruggedness`."""
