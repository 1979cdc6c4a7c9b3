"""The parts of `benchmarks.trust`, one file each with a function `rows(quick)`."""
