"""Sparse second-order minimisation: matrices, linear solvers, Newton steps, derivatives. It knows nothing of shells."""
