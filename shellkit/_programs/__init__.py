"""How shellkit uses JAX: programs compiled once and kept, and what is known while a transformation is at work."""
