"""Units of length, by the names that files and machines use."""

MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "in": 25.4}


def millimetres(owner: str, unit: str) -> float:
    """How many millimetres a unit of length is."""
    if unit not in MILLIMETRES:
        raise ValueError(f"{owner}: unit is {unit!r}; choose one of {', '.join(map(repr, MILLIMETRES))}.")
    return MILLIMETRES[unit]
