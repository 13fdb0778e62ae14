"""A run: its directory, its stages and its metrics.

`load_agent` and `load_body_model` load what a run learned. Their modules are imported when they are
first asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from selftouch_drake.run.loading import load_agent as load_agent
    from selftouch_drake.run.loading import load_body_model as load_body_model

# The module of each function that other programs may import from here.
_HOMES = {
    "load_agent": "selftouch_drake.run.loading",
    "load_body_model": "selftouch_drake.run.loading",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
