"""The version, and the name that the package is installed by: each is written here, and nowhere else in the code."""

__version__ = "0.1.0"

# "shellkit" on PyPI is another package; what is imported is shellkit all the same.
DISTRIBUTION = "shellkit-jax"
