"""A run: its directory, its stages and its metrics.

What other programs load from a run is imported at its first use.
"""

from typing import TYPE_CHECKING

from selftouch_drake.lazy import names_of

if TYPE_CHECKING:
    from selftouch_drake.run.directory import RunDirectory as RunDirectory
    from selftouch_drake.run.loading import load_agent as load_agent
    from selftouch_drake.run.loading import load_body_model as load_body_model
    from selftouch_drake.run.loading import load_motion as load_motion

_MODULES = {
    "RunDirectory": "selftouch_drake.run.directory",
    "load_agent": "selftouch_drake.run.loading",
    "load_body_model": "selftouch_drake.run.loading",
    "load_motion": "selftouch_drake.run.loading",
}
__all__ = sorted(_MODULES)

__getattr__ = names_of(_MODULES)
