"""The benchmarks of `tools/benchmark.py`: a module for each command, and common modules."""
