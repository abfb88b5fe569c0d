"""The energy of a scene as a function of its unknowns, with gradient and sparse Hessian."""
