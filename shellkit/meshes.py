"""Meshes of common shapes, in float64, without slivers, seams or duplicate points.

Spheres, discs and cylinders are centred at the origin with outward or upward normals; the rectangle spans
[0, length] x [0, width] at z = 0. Lengths are in the caller's unit.
"""

from ._mesh.grid import cylinder as cylinder
from ._mesh.grid import rectangle as rectangle
from ._mesh.rings import annulus as annulus
from ._mesh.rings import disc as disc
from ._mesh.rings import spherical_cap as spherical_cap
from ._mesh.rings import torus as torus
from ._mesh.sphere import icosphere as icosphere
from ._mesh.sphere import sphere as sphere
