"""Modules that are imported at their first use, because most commands do not need them.

`from selftouch_drake.lazy import trimesh` takes the place of `import trimesh`. With all that it
imports, trimesh takes 0.3 s, and `scipy.ndimage` takes 0.1 s.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any


class _Lazy(ModuleType):
    def __getattr__(self, name: str) -> Any:
        return getattr(import_module(self.__name__), name)


if TYPE_CHECKING:
    import trimesh as trimesh
    from scipy import ndimage as ndimage
else:
    ndimage = _Lazy("scipy.ndimage")
    trimesh = _Lazy("trimesh")


def names_of(modules: Mapping[str, str]) -> Callable[[str], Any]:
    """The `__getattr__` of a package that imports each of its public names at its first use.

    Args:
        modules: for each name the module that has it.
    """

    def get(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"there is no {name!r}; known are {', '.join(sorted(modules))}")
        return getattr(import_module(modules[name]), name)

    return get
