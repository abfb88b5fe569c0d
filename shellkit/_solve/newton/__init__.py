"""Newton steps, with what they need far from the minimum."""
