"""The cards: `measure(level)` of each module yields its figures, for meshes from coarse (1) to fine (4)."""
