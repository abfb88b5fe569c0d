"""Solvers of sparse symmetric systems, and the choice between them."""
