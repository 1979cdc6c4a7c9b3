"""The benchmarks of `python -m benchmarks.preisach`, and the inputs they share with others."""
