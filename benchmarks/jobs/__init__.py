"""Whole jobs, each a program of its own as a user would write it: `python -m benchmarks.jobs.NAME MESH STEPS` designs
the ellipsoid of the tutorial and says when what is done."""
