"""Every method on every data set: `python -m benchmarks.methods` (docs/benchmark.md)."""
