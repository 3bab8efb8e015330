"""The kinds of source there are: every module of this room that ends in a `KIND`."""

from importlib import import_module
from pkgutil import iter_modules

from service import sources
from service.sources.channel import SourceKind

_MODULES = [
    import_module(f"{sources.__name__}.{module.name}")
    for module in iter_modules(sources.__path__)
    if module.name != "kinds"
]

SOURCE_KINDS: dict[str, SourceKind] = {module.KIND.name: module.KIND for module in _MODULES if hasattr(module, "KIND")}
