"""Densities per face: what stretching and bending cost in a material."""
