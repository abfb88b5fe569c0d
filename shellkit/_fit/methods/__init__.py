"""How a fit gets from one design to the next: by gradients, or by least squares."""
