"""Sparse symmetric matrices with a pattern that is known before anything is compiled."""
