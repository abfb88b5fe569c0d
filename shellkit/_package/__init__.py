"""The package itself: what it is called, and the report on an installation."""
