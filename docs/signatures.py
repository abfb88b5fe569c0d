"""Reading API pages: an Equinox module without `__init__` takes its fields as arguments, and is shown that way."""

import griffe


class ModuleSignatures(griffe.Extension):
    """Gives each Equinox module of a package the `__init__` that Equinox makes from its fields."""

    def on_package(self, *, pkg: griffe.Module, **kwargs) -> None:
        without = [c for c in _classes(pkg) if "__init__" not in c.all_members and _is_equinox_module(c)]
        for cls in without:
            cls.set_member("__init__", _init(cls))


def _classes(parent: griffe.Module | griffe.Class):
    for member in list(parent.members.values()):
        if not member.is_alias and (member.is_module or member.is_class):
            if member.is_class:
                yield member
            yield from _classes(member)


def _is_equinox_module(cls: griffe.Class) -> bool:
    return any(getattr(base, "canonical_path", base) == "equinox.Module" for base in cls.bases) or any(
        _is_equinox_module(base) for base in cls.resolved_bases
    )


def _init(cls: griffe.Class) -> griffe.Function:
    kind = griffe.ParameterKind.positional_or_keyword
    parameters = [griffe.Parameter("self", kind=kind)]
    for owner in [*reversed(cls.mro()), cls]:
        for field in owner.members.values():
            if _is_argument(field):
                parameters.append(
                    griffe.Parameter(field.name, annotation=field.annotation, kind=kind, default=_default(field))
                )
    return griffe.Function("__init__", parent=cls, parameters=griffe.Parameters(*parameters), returns="None")


def _is_argument(member) -> bool:
    if not isinstance(member, griffe.Attribute) or member.annotation is None or "property" in member.labels:
        return False
    abstract = str(member.annotation).startswith(("AbstractVar", "AbstractClassVar", "eqx.Abstract"))
    return not abstract and "instance-attribute" in member.labels and _options(member).get("init") != "False"


def _default(field: griffe.Attribute) -> str | None:
    options = _options(field)
    if "default_factory" in options:
        return f"{options['default_factory']}()"
    return options.get("default") if options else field.value


def _options(field: griffe.Attribute) -> dict[str, str]:
    """What is said in `eqx.field(…)`, or nothing where the default stands alone."""
    if isinstance(field.value, griffe.ExprCall) and field.value.canonical_path in (
        "equinox.field",
        "dataclasses.field",
    ):
        return {a.name: str(a.value) for a in field.value.arguments if isinstance(a, griffe.ExprKeyword)}
    return {}
