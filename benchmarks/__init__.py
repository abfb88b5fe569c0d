"""Benchmarks of shellkit: run `python -m benchmarks --help` from the root of the repository."""
